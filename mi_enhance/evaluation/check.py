"""Can a material be trusted? NaN, negative values, reciprocity, albedo, samples that follow their density."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from ..analytic import geometry
from ..material.material import Material
from ..numerics import sequences
from ..numerics.arrays import vector3f
from ..output.table import write_table
from ..system.progress import Callback, Progress, silent
from ..system.variants import require_variant
from .check_picture import draw
from .chi_square import SIGNIFICANCE, chi_square

RECIPROCITY = 1e-6  # relative: float32 knows no more of a product of a dozen factors
ALBEDO = 1 + 1e-4
_DARK = 1e-6  # 1/sr: differences count relative to f, or to this where f is darker
_HUNT = 1 << 18  # pairs of each kind
_VIEWS = (0.0, 30.0, 60.0, 80.0, 89.0)  # degrees, of the chi-square tests
_AZIMUTH = 0.5
# Degrees at which the albedo is taken: it changes most towards the horizon.
_ANGLES = (*range(0, 80, 10), 75, 80, 82.5, 85, 87, 88, 89, 89.5, 89.9, 89.99)
_AZIMUTHS, _SAMPLES = 8, 1 << 13  # of each angle; samples of each azimuth
_MAP = 45  # angles along either side of the map of reciprocity

# key of a row: (header, format)
COLUMNS = {"check": ("check", ""), "value": ("found", ".3g"), "allowed": ("allowed", ""), "verdict": ("", "")}


@dataclasses.dataclass(frozen=True)
class CheckReport:
    """Result of a check.

    Parameters
    ----------
    ok : bool
        False if a value is NaN, infinite or negative, if the samples do not follow their density, or if reciprocity
        (:attr:`Material.reciprocal`) or bounded energy (:attr:`Material.bound_energy`) is claimed and missed.
    rows : list of dict
        One for each check, with ``check``, ``value``, ``allowed``, ``verdict`` ("ok", "off", or "" for information).
    files : dict of str to str
        The files written, by suffix.
    """

    ok: bool
    rows: list[dict]
    files: dict[str, str]


def check(
    material: Material, folder: str | Path | None = None, *, seed: int = 0, progress: Callback = silent
) -> CheckReport:
    """Examine a material as it is rendered: its values, its sampling, and the physics it claims.

    Parameters
    ----------
    material : Material
    folder : str or Path, optional
        Folder for ``check.png`` (albedo over angle, map of the reciprocity error, peak of f) and the table
        ``check.csv``, ``.json``, ``.md``; nothing is written if left out.
    seed : int
    progress : callable
        Hears of every part before it begins, see :mod:`mi_enhance.system.progress`.

    Returns
    -------
    CheckReport

    Raises
    ------
    RuntimeError
        If no JIT variant with RGB colours is active.

    Examples
    --------
    >>> check(Material.analytic("ggx")).ok
    True
    """
    require_variant("check()", rgb=True, jit=True)
    bsdf = material.bsdf()
    rows: list[dict] = []
    parts = ["values", "reciprocity", "albedo", *(f"chi-square at {degrees:g} degrees" for degrees in _VIEWS)]
    steps = iter(parts)

    def begin() -> None:
        part = next(steps)
        progress(Progress(part, parts.index(part), len(parts)))

    def add(name: str, value: float, allowed: str = "", ok: bool | None = None) -> None:
        rows.append({
            "check": name, "value": value, "allowed": allowed, "verdict": "" if ok is None else "ok" if ok else "off",
        })  # fmt: skip

    begin()
    found = _hunt(bsdf, material, seed)
    add("NaN or infinite", found["not_finite"], "0", found["not_finite"] == 0)
    add("negative", found["negative"], "0", found["negative"] == 0)
    add("evaluations", found["evaluations"])
    add("largest f, 1/sr", found["peak"])
    add("largest f cos / pdf", found["weight"])
    begin()
    reciprocity, worst = _reciprocity(bsdf)
    add("reciprocity, relative", worst, *_claim(material.reciprocal, worst, RECIPROCITY))
    begin()
    phi = np.arange(_AZIMUTHS) / _AZIMUTHS * 2 * np.pi
    albedos, peaks = albedo(bsdf, np.cos(np.deg2rad(_ANGLES)), phi)
    largest = float(albedos.max())
    add("largest albedo", largest, *_claim(material.bound_energy, largest, ALBEDO))
    params, tests = material.as_drjit(), []
    for degrees in _VIEWS:
        begin()
        wi = _direction(np.cos(np.deg2rad(degrees)), _AZIMUTH)
        result = chi_square(bsdf, wi, params, material.brdf.model, test_count=len(_VIEWS), seed=seed)
        tests += [(degrees, result)] if result else []
    for degrees, result in tests:
        allowed = f"{1 - (1 - SIGNIFICANCE) ** (1 / len(_VIEWS)):.4f}"
        add(f"chi-square at {degrees:g}°, p at least", result["p_value"], allowed, result["passed"])
    add("density over its integral", max((abs(r["normalization"] - 1) for _, r in tests), default=0.0) + 1)
    files: dict[str, str] = {}
    if folder is not None:
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        draw(np.array(_ANGLES), albedos, peaks, reciprocity, folder / "check.png", title=str(material.brdf))
        paths = {**write_table(rows, folder / "check", COLUMNS), "png": folder / "check.png"}
        files = {suffix: str(path) for suffix, path in paths.items()}
    return CheckReport(all(row["verdict"] != "off" for row in rows), rows, files)


def _claim(claimed: bool, value: float, allowed: float) -> tuple[str, bool | None]:
    """Return the limit, and whether it holds; nothing where nothing is claimed."""
    return (f"{allowed:g}", value <= allowed) if claimed else ("", None)


def _direction(cos: Any, phi: Any) -> np.ndarray:
    """Unit vectors (..., 3)."""
    cos, phi = np.broadcast_arrays(cos, phi)
    sin = np.sqrt(1 - np.square(cos))
    return np.stack([sin * np.cos(phi), sin * np.sin(phi), cos], -1)


def _hit(wi: np.ndarray) -> mi.SurfaceInteraction3f:
    si = dr.zeros(mi.SurfaceInteraction3f, len(wi))
    si.wi = vector3f(wi)
    return si


def _hunt(bsdf: mi.BSDF, material: Material, seed: int) -> dict[str, Any]:
    """Values, densities and samples at random and at extreme pairs of directions."""
    rng, n = np.random.default_rng(seed), _HUNT
    phi = lambda: rng.uniform(0, 2 * np.pi, n)  # noqa: E731
    grazing = lambda: np.exp(rng.uniform(np.log(1e-7), np.log(1e-2), n))  # noqa: E731
    wi = _direction(1 - rng.random(n), phi())
    side = phi()
    axes = geometry.frame_of(material.as_drjit())
    normal = np.array(axes.n).ravel()
    mirrored = 2 * (wi @ normal)[:, None] * normal - wi
    mirrored += rng.normal(size=(n, 3)) * np.exp(rng.uniform(np.log(1e-8), 0, (n, 1)))  # ever closer to the peak
    mirrored /= np.linalg.norm(mirrored, axis=1, keepdims=True)
    pairs = [
        (wi, _direction(1 - rng.random(n), phi())),
        (wi, mirrored),
        (_direction(grazing(), phi()), _direction(grazing(), phi())),
        (_direction(grazing(), side), _direction(grazing(), side + 1e-3 * (rng.random(n) - 0.5))),
        (wi, wi),
        (wi, -wi),
    ]
    context = mi.BSDFContext()
    result: dict[str, Any] = {"not_finite": 0, "negative": 0, "evaluations": 0, "peak": 0.0, "weight": 0.0}
    for wi, wo in pairs:
        si, wo = _hit(wi), vector3f(wo)
        value, pdf = _eval(bsdf, si, wo), bsdf.pdf(context, si, wo)
        u = rng.random((3, n)).astype(np.float32)
        u[:, :64] = rng.choice([0, 0.5, 1 - 2**-24], (3, 64))  # the rim of the cube, where warps are singular
        bs, weight = _sample(bsdf, si, [mi.Float(v) for v in u])
        for v in (*value, pdf, *weight, bs.pdf, *bs.wo):
            result["not_finite"] += _count(~dr.isfinite(v))
        for v in (*value, pdf, *weight, bs.pdf):
            result["negative"] += _count(v < 0)
        # 1e-7: no direction is closer to the horizon in float32, and none below counts
        f = dr.select(wo.z > 0, dr.max(value) / dr.maximum(wo.z, 1e-7), 0)
        result["peak"] = max(result["peak"], float(np.array(f).max()))
        result["weight"] = max(result["weight"], float(np.array(weight).max()))
        result["evaluations"] += 2 * n
    return result


def _count(mask: mi.Bool) -> int:
    return int(np.count_nonzero(np.array(mask)))


# Evaluated at once: two kernels serve all parts, where one for each question would compile for long.


def _eval(bsdf: mi.BSDF, si: mi.SurfaceInteraction3f, wo: mi.Vector3f) -> mi.Spectrum:
    value = bsdf.eval(mi.BSDFContext(), si, wo)
    dr.eval(value)
    return value


def _sample(bsdf: mi.BSDF, si: mi.SurfaceInteraction3f, u: Any) -> tuple[mi.BSDFSample3f, mi.Spectrum]:
    dr.eval(u)
    bs, weight = bsdf.sample(mi.BSDFContext(), si, u[0], mi.Point2f(u[1], u[2]))
    dr.eval(bs, weight)
    return bs, weight


def _f(bsdf: mi.BSDF, wi: np.ndarray, wo: np.ndarray) -> np.ndarray:
    """Reflectance (N, 3)."""
    return np.array(_eval(bsdf, _hit(wi), vector3f(wo)), np.float64).T / np.float32(wo[:, 2:])


def _reciprocity(bsdf: mi.BSDF) -> tuple[np.ndarray, float]:
    """Relative difference of f(a, b) and f(b, a), for both polar angles the largest over azimuths, and the largest."""
    theta = np.deg2rad(np.linspace(0, 89.5, _MAP))
    phi = np.linspace(0, 2 * np.pi, 4 * _AZIMUTHS, endpoint=False)
    # the first azimuth turned by less than a step, so that a rotated tangent is met from all sides
    a, b, c, d = np.meshgrid(theta, theta, phi, np.arange(4) * 0.7, indexing="ij")
    wi, wo = _direction(np.cos(a), d).reshape(-1, 3), _direction(np.cos(b), c + d).reshape(-1, 3)
    one, other = _f(bsdf, wi, wo), _f(bsdf, wo, wi)
    error = np.abs(one - other) / np.maximum(np.maximum(one, other), _DARK)
    return error.reshape(_MAP, _MAP, -1).max(2), float(error.max())


def albedo(
    bsdf: mi.BSDF, cosines: np.ndarray, phi: np.ndarray, n: int = _SAMPLES, first: int = 0
) -> tuple[np.ndarray, np.ndarray]:
    """Directional albedo by the BSDF's own samples.

    Parameters
    ----------
    bsdf : mi.BSDF
    cosines, phi : array (A,), (B,)
        Views: cosines to the surface's normal, azimuths in radians.
    n : int
        Samples of each view.
    first : int
        Index of the first point of the sequence that they come from: another one, other samples.

    Returns
    -------
    array (A, B, 3)
        Albedo.
    array (A,)
        Largest f in 1/sr that was met.

    Examples
    --------
    >>> white = mi.load_dict({"type": "diffuse", "reflectance": {"type": "rgb", "value": 1.0}})
    >>> albedo(white, np.ones(1), np.zeros(1))[0].round(3).ravel()
    array([1., 1., 1.])
    """
    wi = _direction(np.asarray(cosines)[:, None], phi).reshape(-1, 3)
    lanes = len(wi) * n
    u = sequences.even_numbers(lanes, dr.arange(mi.UInt32, lanes) % n + first)
    si = dr.zeros(mi.SurfaceInteraction3f, lanes)
    si.wi = dr.repeat(vector3f(wi), n)
    bs, weight = _sample(bsdf, si, u)
    peak = dr.max(weight) * bs.pdf / dr.maximum(bs.wo.z, 1e-7)  # 1e-7: as in _hunt
    mean = np.array([dr.block_sum(c, n) for c in weight], np.float64).T / n
    return mean.reshape(len(cosines), len(phi), 3), np.array(peak).reshape(len(cosines), -1).max(1)
