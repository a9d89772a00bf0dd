"""RGL (EPFL) material files, evaluated by Mitsuba's own `measured` plugin: isotropic or not, RGB or spectral.

Mitsuba maps the file and trusts it, so everything in it is checked first. Its `eval` is f cos_theta_o with `si.wi`
the viewer and `wo` the light; the files are not quite reciprocal, so that order matters. Spectral files, and azimuths
from 0 to 2 pi, are first brought into the form that Mitsuba reads (``rgl_forms.py``).
"""

from __future__ import annotations

import contextlib
import json
import tempfile
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import NoReturn

import numpy as np

from ..system import tensor_file
from ..system.files import material_name, require_file
from ..system.variants import require_variant
from . import rgl_forms, spectra
from .directions import sample_pairs
from .measurements import Measurements, clamp_negative
from .registry import reader

# the fields `measured` reads: type and number of dimensions
_FIELDS = {
    "description": ("u1", 1),
    "jacobian": ("u1", 1),
    "phi_i": ("f4", 1),
    "theta_i": ("f4", 1),
    "ndf": ("f4", 2),
    "sigma": ("f4", 2),
    "vndf": ("f4", 4),
    "luminance": ("f4", 4),
}
_VALUES = {"rgb": {"rgb": ("f4", 5)}, "spectra": {"spectra": ("f4", 5), "wavelengths": ("f4", 1)}}
_MAX_VALUE = 1e9  # sharp chrome reaches 2e4; products of three such values stay finite in float32


def function(path: str | Path) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """Return the reflectance of a file; see :func:`mi_enhance.data.functions.function_of`."""
    f = opened(path)
    return lambda wi, wo: np.maximum(f(wi, wo), 0)


@reader("rgl", about="RGL .bsdf", suffixes=(".bsdf",), magic=tensor_file.MAGIC, function=function)
def read(path: str | Path, *, n_samples: int = 100_000, seed: int = 0) -> Measurements:
    """Draw samples of the measured material in `path`.

    Parameters
    ----------
    path : str or Path
        ``<material>_rgb.bsdf`` or ``<material>_spec.bsdf``.
    n_samples, seed : int
        As for `mi_enhance.data.loading.load`.

    Returns
    -------
    Measurements
        Negative values (colours outside sRGB) are 0 and counted in `clamped_fraction`.

    Raises
    ------
    RuntimeError
        If the active variant is not ``llvm_ad_rgb`` or ``cuda_ad_rgb``.
    ValueError
        If the file is damaged or not a measured material.

    References
    ----------
    Dupuy and Jakob, "An Adaptive Parameterization for Efficient Material Acquisition and Rendering", 2018.

    Examples
    --------
    >>> import mitsuba as mi
    >>> mi.set_variant("llvm_ad_rgb")
    >>> read("mi_enhance/bundled/rgl/aurora_white_rgb.bsdf", n_samples=10).name
    'aurora_white'
    """
    wi, wo = sample_pairs(n_samples, seed=seed)
    f, clamped_fraction = clamp_negative(evaluate(path, wi, wo))
    spectral = "rgb" not in tensor_file.fields(path, f'data.load("{path}")')
    source = f"RGL file {path}" + (f"; {spectra.NOTE}" if spectral else "")
    return Measurements(wi, wo, f, material_name(path), source, clamped_fraction)


def evaluate(path: str | Path, wi: np.ndarray, wo: np.ndarray) -> np.ndarray:
    """Return the reflectance the file holds for given directions, negative values included.

    Parameters
    ----------
    path : str or Path
    wi, wo : array (N, 3)
        Unit vectors towards the viewer and the light, above the horizon.

    Returns
    -------
    array (N, 3), float32
        f_r in 1/sr, linear sRGB.
    """
    return opened(path)(wi, wo)


def opened(path: str | Path) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """Check a file once and return `evaluate` of it, ``f(wi, wo)``."""
    import mitsuba as mi  # only this reader needs it

    from ..numerics.arrays import vector3f

    where = f'data.load("{path}")'
    path = require_file(path, where)
    fields = _checked(path, where)
    require_variant(where, rgb=True, jit=True)
    with _as_mitsuba_reads(path, fields, where) as readable:
        try:
            bsdf = mi.load_dict({"type": "measured", "filename": str(readable.resolve())})
        except RuntimeError as error:
            raise ValueError(f"{where}: Mitsuba refuses this file: {error}") from error

    def f(wi: np.ndarray, wo: np.ndarray) -> np.ndarray:
        light = vector3f(wo)
        si = mi.SurfaceInteraction3f()
        si.wi = vector3f(wi)
        f = np.array(bsdf.eval(mi.BSDFContext(), si, light)) / np.array(light.z)
        if not np.isfinite(f).all():
            raise ValueError(
                f"{where}: evaluates to NaN or infinity for some directions. The file is damaged; download it again."
            )
        return f.T

    return f


def is_renderable(path: str | Path) -> bool:
    """Tell whether Mitsuba's `measured` reads the file as it is, in an RGB variant."""
    where = f'data.load("{path}")'
    fields = tensor_file.fields(require_file(path, where), where)
    needed = {"rgb", "phi_i"} <= fields.keys()
    return needed and not rgl_forms.needs_rewriting(fields, tensor_file.values(path, fields["phi_i"]))


@contextlib.contextmanager
def _as_mitsuba_reads(path: Path, fields: Mapping[str, np.ndarray], where: str) -> Iterator[Path]:
    """Yield the file itself, or a temporary one in the form that Mitsuba reads."""
    if not rgl_forms.needs_rewriting(fields, fields["phi_i"]):
        yield path
        return
    with tempfile.TemporaryDirectory() as folder:
        temporary = Path(folder) / path.name
        tensor_file.write(temporary, rgl_forms.rewritten(fields, where))
        yield temporary


def _checked(path: Path, where: str) -> dict[str, np.ndarray]:
    """Return the fields of a complete, finite material that Mitsuba can be trusted with, or raise."""
    fields = tensor_file.fields(path, where)
    values = "spectra" if "spectra" in fields and "rgb" not in fields else "rgb"
    wanted = _FIELDS | _VALUES[values]
    missing = sorted(set(wanted) - set(fields))
    if missing and _is_own_material(path, fields):
        raise ValueError(
            f"{where}: is a material of mi_enhance, not a measurement: it has no {', '.join(missing[:3])}, ... "
            'Render it with <bsdf type="enhanced">; to fit, give the measured file.'
        )
    if missing:
        raise ValueError(
            f"{where}: a tensor file, but not a measured RGL material: {', '.join(missing)} missing, "
            f"it holds {', '.join(sorted(fields)[:12])}."
        )

    def refuse(what: str) -> NoReturn:
        raise ValueError(f"{where}: {what}. The file is damaged; download it again.")

    for name, (dtype, n_dim) in wanted.items():
        if fields[name].dtype != np.dtype(dtype) or len(fields[name].shape) != n_dim or 0 in fields[name].shape:
            refuse(
                f"field {name!r} is {fields[name].dtype} with shape {fields[name].shape}, {n_dim} dimensions of "
                f"{np.dtype(dtype)} are expected"
            )
    n = (*fields["phi_i"].shape, *fields["theta_i"].shape)
    res = fields["luminance"].shape[2:]
    shapes = {
        "jacobian": (1,),
        "vndf": (*n, *fields["vndf"].shape[2:]),
        "luminance": (*n, res[0], res[0]),
        values: (*n, *(fields["wavelengths"].shape if values == "spectra" else (3,)), *res),
    }
    for name, shape in shapes.items():
        if fields[name].shape != shape:
            refuse(f"field {name!r} has shape {fields[name].shape}, the other fields ask for {shape}")
    if min(*res, *fields["vndf"].shape[2:], *fields["ndf"].shape, *fields["sigma"].shape) < 2:
        refuse("a table has only one row or column, nothing can be interpolated")
    data = {name: tensor_file.values(path, fields[name]) for name in wanted}
    for name, (dtype, _) in wanted.items():
        if dtype == "f4" and not (np.abs(data[name]) <= _MAX_VALUE).all():  # false for NaN, too
            refuse(f"field {name!r} holds NaN, infinite or absurd values")
    for name, highest in (("theta_i", np.pi / 2), ("phi_i", 2 * np.pi)):
        a = data[name]
        if (np.diff(a) <= 0).any() or a[0] < -np.pi - 1e-3 or a[-1] > highest + 1e-3:
            refuse(f"{name} does not increase within its range")
    # Mitsuba inverts running sums of these: without weight, or with negative weight, the indices become garbage.
    # `luminance` only steers sampling and real files have -4e-10 in it.
    if min(data[k].min() for k in ("ndf", "sigma", "vndf")) < 0:
        refuse("ndf, sigma or vndf is negative")
    if min(data[k].sum((-1, -2)).min() for k in ("vndf", "luminance")) <= 0:
        refuse("vndf or luminance is 0 everywhere for one direction")
    return data


def _is_own_material(path: Path, fields: Mapping[str, tensor_file.Field]) -> bool:
    """Tell whether the file is a material of ours: its `description` is a JSON object, RGL's is a plain sentence."""
    if "description" not in fields or fields["description"].dtype != np.uint8:
        return False
    try:
        text = tensor_file.values(path, fields["description"]).tobytes()
        return isinstance(json.loads(text), dict)
    except (ValueError, RecursionError):  # not JSON, not UTF-8, or nested to break the parser
        return False
