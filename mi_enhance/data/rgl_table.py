"""Write RGL `.bsdf` files: any reflectance as the tables that Mitsuba's plugin `measured` reads.

The file holds f cos_o sigma(wi) 4 / D(m) over half vectors m, for some directions wi of the viewer (eq. 9 of the
paper, solved for the table). Where on the sphere of m the entries lie is the choice of the file: `vndf` is a density
over m, and the entries are spread evenly in its cumulative distribution, so that a highlight has many of them.
`luminance` is a density over the entries, which the plugin draws samples from. D (`ndf`) and sigma only have to be the
same in the writer and the reader; the closer D is to the true one, the smoother is the rest of the table.

References
----------
Dupuy and Jakob, "An Adaptive Parameterization for Efficient Material Acquisition and Rendering", 2018. The layout:
Mitsuba 3, src/bsdfs/measured.cpp.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..system import tensor_file
from ..system.files import replacing
from ..system.variants import require_variant
from .directions import direction, rusinkiewicz_to_directions
from .functions import Function, asymmetry, difference, isotropic, turned, values

_HALF = np.pi / 2
_LAST = np.deg2rad(89.4)  # of theta_i: 1/cos has no limit; beyond, the plugin takes the last table
# Share of the entries that lie evenly in m; the rest follows D. Of 0.2, 0.5, 0.8 and 0.9 the one of least error.
_EVEN = 0.8
_FLOOR = 1e-3  # of D, in parts of its median: f cos / D stays finite where a material is black
_BELOW = 1e-3  # weight of half vectors whose light is below the horizon: entries there are wasted, rows must not be 0
_DEFENSIVE = 0.02  # share of samples drawn evenly from the entries: none may have weight without being drawn
_ISOTROPIC = 3e-3  # log-L1 below which a material counts as isotropic: fits leave tilts of 0.002 in isotropic ones
_SAME = 1e-4  # log-L1 below which a symmetry is taken for one
_MIN_COS = 1e-4  # of the light: below, f cos is 0


class Grid(NamedTuple):
    """Numbers of entries."""

    phi: int  # azimuths of the viewer
    theta: int  # polar angles of the viewer
    ndf: tuple[int, int]  # azimuths and polar angles of half vectors
    table: int  # entries on a side


_GRIDS = {  # by the fraction of a turn that the azimuths of the viewer cover
    "isotropic": Grid(1, 32, (32, 256), 64),
    "quarter": Grid(13, 20, (48, 96), 32),
    "half": Grid(17, 20, (48, 96), 32),
    "full": Grid(33, 20, (48, 96), 32),
}
_SPANS = {"quarter": (-np.pi, -_HALF), "half": (-np.pi, 0.0), "full": (-np.pi, np.pi)}  # as the plugin folds them


def symmetry_of(f: Function) -> str:
    """Return "isotropic", or the part of a turn that tells all of f: "quarter", "half" or "full".

    A quarter tells all if f is the same in the mirrors of both axes, a half if it is the same after half a turn.

    Examples
    --------
    >>> symmetry_of(lambda wi, wo: np.full((len(wi), 3), 0.1))
    'isotropic'
    """
    if asymmetry(f) < _ISOTROPIC:
        return "isotropic"
    if difference(f, turned(f, np.pi)) > _SAME:
        return "full"
    return "quarter" if difference(f, turned(f, 0.0, mirrored=True)) <= _SAME else "half"


def write_rgl(path: str | Path, f: Function, *, description: str = "", spectral: bool = False) -> str:
    """Tabulate a reflectance function into an RGL file; Mitsuba's ``measured`` then renders it.

    Parameters
    ----------
    path : str or Path
        Replaced as a whole or not at all.
    f : callable
        ``f(wi, wo) -> array (N, 3)``, f_r in 1/sr, linear RGB, >= 0. It need not be reciprocal. If it is nearly
        isotropic, its mean over azimuths is written: 3 MB; else one table for each azimuth, 9 MB and more.
    description : str
        What programs show as the name of the material.
    spectral : bool
        Write spectra, for programs that read no RGB files: pbrt-v4, and Mitsuba's spectral variants. Colours become
        reflectance spectra by the basis of Mallett and Yuksel 2019.

    Returns
    -------
    str
        The symmetry it was written with, see `symmetry_of`.

    Raises
    ------
    RuntimeError
        If the active variant is not ``llvm_ad_rgb`` or ``cuda_ad_rgb``.
    ValueError
        If f returns another shape or values that are not finite.

    Examples
    --------
    >>> write_rgl("grey.bsdf", lambda wi, wo: np.full((len(wi), 3), 0.2 / np.pi))  # doctest: +SKIP
    'isotropic'
    """
    where = "write_rgl()"
    require_variant(where, rgb=True, jit=True)
    symmetry = symmetry_of(f)
    if spectral and symmetry != "isotropic":
        symmetry = "full"  # pbrt-v4 folds nothing
    tensors = _tensors(isotropic(f) if symmetry == "isotropic" else f, _GRIDS[symmetry], _SPANS.get(symmetry), where)
    if spectral:
        tensors |= _spectra(tensors.pop("rgb"))
    text = np.frombuffer((description or Path(path).stem).encode(), np.uint8)
    with replacing(path) as temporary:
        tensor_file.write(temporary, {"description": text, "jacobian": np.ones(1, np.uint8), **tensors})
    return symmetry


def _tensors(f: Function, grid: Grid, span: tuple[float, float] | None, where: str) -> dict[str, np.ndarray]:
    """Return all tables of a file by name, float32."""
    import mitsuba as mi

    mitsuba: Any = mi  # its stubs do not type the distributions
    phi_i = np.zeros(1) if span is None else np.linspace(*span, grid.phi)
    even = np.linspace(0, 1, grid.theta)
    # between even angles, for Fresnel, and even cosines, for the projected area
    theta_i = 0.5 * (even * _LAST + np.arccos(1 - even * (1 - np.cos(_LAST))))
    ndf = _ndf(f, grid.ndf, span is None, where)
    sigma = _sigma(ndf, span is None)
    vndf = _vndf(ndf, phi_i, theta_i)
    # Mitsuba's own distributions: what the plugin will do with the tables, to the last bit
    one, two = mitsuba.MarginalContinuous2D0, mitsuba.MarginalContinuous2D2
    warp = two(vndf, [a.astype(np.float32).tolist() for a in (phi_i, theta_i)])
    along = np.linspace(0, 1, grid.table)
    phi, theta, y, x = (a.ravel() for a in np.meshgrid(phi_i, theta_i, along, along, indexing="ij"))
    u, pdf = warp.sample(mi.Point2f(x, y), mi.Vector2f(phi, theta))
    view = mi.Point2f(np.sqrt(theta / _HALF), (phi + np.pi) / (2 * np.pi))
    over = np.array(one(sigma, [], False, False).eval(view)) / np.array(one(ndf, [], False, False).eval(u))
    u_theta, u_phi = np.array(u, np.float64)
    theta_m, phi_m = u_theta**2 * _HALF, (2 * u_phi - 1) * np.pi
    wi, m = direction(theta, phi), direction(theta_m, phi_m)  # for isotropic ones phi_i is 0, and phi_m relative to it
    cos = np.sum(wi * m, axis=1)
    wo = 2 * cos[:, None] * m - wi
    above = (wo[:, 2] > _MIN_COS) & (cos > 0)
    reflected = np.zeros((len(wo), 3))
    reflected[above] = np.maximum(values(f, wi[above], wo[above], where), 0) * wo[above, 2:]
    shape = (grid.phi, grid.theta, grid.table, grid.table)
    jacobian = np.maximum(2 * np.pi**2 * u_theta * np.sin(theta_m), 1e-6) * 4 * np.maximum(cos, 0)  # 1e-6: as there
    drawn = (reflected.mean(1) * jacobian / np.array(pdf)).reshape(shape)
    # 1e-6: a black material, too, has to be drawn somehow
    drawn += above.reshape(shape) * (_DEFENSIVE * drawn.mean((2, 3), keepdims=True) + 1e-6)
    table = (reflected * (4 * over)[:, None]).reshape(*shape, 3)
    result = {
        "phi_i": phi_i, "theta_i": theta_i, "ndf": ndf, "sigma": sigma, "vndf": vndf, "luminance": drawn,
        "rgb": np.moveaxis(table, -1, 2),
    }  # fmt: skip
    return {name: np.ascontiguousarray(a, np.float32) for name, a in result.items()}


def _spectra(rgb: np.ndarray) -> dict[str, np.ndarray]:
    """Return wavelengths, nm, and the table over them; the basis adds up to 1, so grey stays grey."""
    from colour.recovery import MSDS_BASIS_FUNCTIONS_sRGB_MALLETT2019 as BASIS

    every = slice(None, None, 4)  # 20 of its 5 nm
    spectra = np.einsum("wc,ptcyx->ptwyx", BASIS.values[every].astype(np.float32), rgb)
    return {"wavelengths": BASIS.wavelengths[every].astype(np.float32), "spectra": np.ascontiguousarray(spectra)}


def _axes(n_phi: int, n_theta: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return azimuths, the square roots that the file counts polar angles in, and polar angles of half vectors."""
    u = np.linspace(0, 1, n_theta)
    return np.linspace(-np.pi, np.pi, n_phi), u, u**2 * _HALF


def _ndf(f: Function, size: tuple[int, int], is_isotropic: bool, where: str) -> np.ndarray:
    """Return D over azimuth and polar angle: what f does where viewer and light stand around m, not only at it."""
    phi, _, theta = _axes(2 if is_isotropic else size[0], size[1])
    turn = np.zeros(1) if is_isotropic else phi
    difference_angles = np.deg2rad([0.0, 15.0, 30.0, 45.0, 60.0])
    # sideways: so both directions are above the horizon for all m
    angles = np.meshgrid(np.minimum(theta, _LAST), turn, difference_angles, [-_HALF, _HALF], indexing="ij")
    wi, wo = rusinkiewicz_to_directions(*angles)
    f_m = values(f, wi.reshape(-1, 3), wo.reshape(-1, 3), where).mean(1).reshape(angles[0].shape).mean((2, 3)).T
    # Without the cosine f cos / D of a diffuse surface would grow to the horizon; 0.02 keeps it from being 0 / 0 there.
    d = np.maximum(f_m, 0) * np.maximum(np.cos(theta), 0.02)
    d = np.maximum(d, _FLOOR * np.median(d) + 1e-8)
    return np.array(np.broadcast_to(d, (len(phi), len(theta))), np.float32)


def _sigma(ndf: np.ndarray, is_isotropic: bool) -> np.ndarray:
    """Return the projected area of the surface with this D over azimuth and polar angle of the viewer."""
    n_phi, n_theta = ndf.shape
    phi, _, theta = _axes(n_phi, n_theta)
    fine_phi, fine_theta = (np.arange(64) + 0.5) / 64 * 2 * np.pi - np.pi, (np.arange(256) + 0.5) / 256 * _HALF
    rows = np.stack([np.interp(fine_phi, phi, column) for column in ndf.T])
    d = np.stack([np.interp(np.sqrt(fine_theta / _HALF), np.linspace(0, 1, n_theta), row) for row in rows.T])
    m = _grid(fine_theta, fine_phi)
    weight = (d * np.sin(fine_theta)).ravel()[:, None] * m * (_HALF / 256 * 2 * np.pi / 64)
    turn = phi[:1] if is_isotropic else phi
    views = _grid(theta, turn).astype(np.float32)
    area = np.array([np.maximum(weight.astype(np.float32) @ wi, 0).sum() for wi in views]).reshape(len(turn), n_theta)
    return np.array(np.broadcast_to(area, (n_phi, n_theta)), np.float32)


def _vndf(ndf: np.ndarray, phi_i: np.ndarray, theta_i: np.ndarray) -> np.ndarray:
    """Return the density that the entries follow, over azimuths and polar angles of the viewer and of m."""
    n_phi = _GRIDS["isotropic"].ndf[0] if len(phi_i) == 1 else ndf.shape[0]
    phi, u, theta = _axes(n_phi, ndf.shape[1])
    m = _grid(theta, phi)
    d = np.broadcast_to(ndf[:1] if len(phi_i) == 1 else ndf, (n_phi, len(theta)))
    area = 2 * np.pi**2 * u * np.sin(theta)  # of m to u
    result = np.empty((len(phi_i), len(theta_i), n_phi, len(theta)), np.float32)
    for k, a in enumerate(phi_i):
        for j, t in enumerate(theta_i):
            wi = direction(t, a)
            cos = np.maximum(m @ wi, 0)
            seen = cos * np.where(2 * cos * m[:, 2] > wi[2], 1, _BELOW)
            seen = seen.reshape(n_phi, len(theta))
            follows = d * area * seen
            result[k, j] = (1 - _EVEN) * follows / follows.mean() + _EVEN * seen / seen.mean()
            result[k, j] += 1e-6  # no empty row: its sum divides
    return result


def _grid(theta: np.ndarray, phi: np.ndarray) -> np.ndarray:
    """Return directions, azimuth after azimuth, (len(phi) * len(theta), 3)."""
    p, t = np.meshgrid(phi, theta, indexing="ij")
    return direction(t.ravel(), p.ravel())
