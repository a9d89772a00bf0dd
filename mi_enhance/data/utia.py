"""UTIA's BRDF database: `.bin` and `.exr`, 6 x 48 directions of light by 6 x 48 of the viewer.

theta is 0, 15, ..., 75 degrees and phi 0, 7.5, ..., 352.5 degrees. `.bin` holds three planes (R, G, B) of 288 x 288
numbers, float64: a row for each light (theta the slower index), a column for each viewer. `.exr` is one picture of
288 x 288 pixels in the same order. The values are linear sRGB (2 degree observer, D65).

Values are linear between the points in all four angles. Beyond 75 degrees nothing was measured, so no sample is drawn
there (the database's own code extrapolates linearly, below zero at times). Negative values are clamped and counted.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from ..system.exr_channels import read_channels
from ..system.files import material_name, require_file
from . import grid
from .directions import sample_pairs
from .measurements import Measurements, clamp_negative
from .registry import reader
from .rows import finite

_THETAS, _PHIS = 6, 48
_STEP_THETA, _STEP_PHI = np.deg2rad(15.0), np.deg2rad(7.5)
_N = _THETAS * _PHIS
_SIZE = 3 * 8 * _N * _N
_PERIODIC = (False, True, False, True)
# cosine of 75 degrees, with room for float32
_MIN_COS = np.cos((_THETAS - 1) * _STEP_THETA) + 1e-6


def function(path: str | Path) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """Return the reflectance of a file; see :func:`mi_enhance.data.functions.function_of`.

    Beyond 75 degrees it is that at 75 degrees.
    """
    table = read_table(path)
    return lambda wi, wo: np.maximum(lookup(table, wi, wo), 0)


@reader("utia", about="UTIA .bin and .exr", suffixes=(".bin", ".exr"), function=function)
def read(path: str | Path, *, n_samples: int = 100_000, seed: int = 0) -> Measurements:
    """Draw samples of the measured material in `path`, none beyond 75 degrees.

    Parameters
    ----------
    path : str or Path
    n_samples, seed : int
        As for `mi_enhance.data.loading.load`.

    Returns
    -------
    Measurements

    Raises
    ------
    ValueError
        If the file has another length or size, or holds NaN.

    References
    ----------
    Filip and Vavra, "Template-Based Sampling of Anisotropic BRDFs", 2014; layout: the database's own reading code.

    Examples
    --------
    >>> read("m003_carpet01.bin").name  # doctest: +SKIP
    'm003_carpet01'
    """
    table = read_table(path)
    wi, wo = sample_pairs(n_samples, seed=seed, min_cos=_MIN_COS)
    f, clamped_fraction = clamp_negative(lookup(table, wi, wo))
    return Measurements(
        wi, wo, f, material_name(path), f"UTIA file {path}; nothing beyond 75 degrees", clamped_fraction
    )


def read_table(path: str | Path) -> np.ndarray:
    """Read the whole table.

    Returns
    -------
    array (6, 48, 6, 48, 3), float64
        f_r in 1/sr, linear RGB, over theta and phi of the light, theta and phi of the viewer.
    """
    where = f'data.load("{path}")'
    file = require_file(path, where)
    rows = _of_exr(file, where) if file.suffix.lower() == ".exr" else _of_bin(file, where)
    finite(rows.reshape(-1, 3), where)
    return rows.reshape(_THETAS, _PHIS, _THETAS, _PHIS, 3)


def lookup(table: np.ndarray, wi: np.ndarray, wo: np.ndarray) -> np.ndarray:
    """Interpolate a table of `read_table`.

    Parameters
    ----------
    table : array (6, 48, 6, 48, 3)
    wi, wo : array (N, 3)
        Towards viewer and light. Beyond 75 degrees the value at 75 degrees is returned.

    Returns
    -------
    array (N, 3), float32
        Negative values included.
    """
    index = []
    for w in (np.asarray(wo, np.float64), np.asarray(wi, np.float64)):
        theta = np.arctan2(np.hypot(w[:, 0], w[:, 1]), w[:, 2])
        index += [np.clip(theta / _STEP_THETA, 0, _THETAS - 1), np.arctan2(w[:, 1], w[:, 0]) / _STEP_PHI]
    return grid.interpolate(table, index, _PERIODIC)


def _of_bin(path: Path, where: str) -> np.ndarray:
    size = path.stat().st_size
    if size != _SIZE:
        raise ValueError(
            f"{where}: {size} bytes, a UTIA file of 6 x 48 by 6 x 48 directions has {_SIZE}. It is cut off, damaged, "
            "or of another density, which is not supported."
        )
    return np.moveaxis(np.fromfile(path, "<f8").reshape(3, _N, _N), 0, -1)


def _of_exr(path: Path, where: str) -> np.ndarray:
    channels, _ = read_channels(path, where)
    shapes = {v.shape for v in channels.values()}
    if not {"R", "G", "B"} <= set(channels) or shapes != {(_N, _N)}:
        raise ValueError(
            f"{where}: holds the channels {', '.join(sorted(channels))[:80]} of {sorted(shapes)} pixels; a UTIA "
            f"material is R, G, B of {_N} x {_N}. If this is a photograph, use fit-images."
        )
    return np.stack([channels[c].astype(np.float64) for c in "RGB"], -1)
