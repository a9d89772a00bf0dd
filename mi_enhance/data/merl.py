"""MERL `.binary`: 90 x 90 x 180 cells in (theta_h, theta_d, phi_d), three channels of float64, 35 MB.

Cell j of theta_h covers (j/90)^2 pi/2 to ((j+1)/90)^2 pi/2 (fine near the highlight); theta_d and phi_d are uniform
over [0, pi/2] and [0, pi]; phi_d + pi is the same cell by reciprocity. Values belong to the middle of their cell, in
the index, and are interpolated linearly between middles. Cells that were never measured hold -1: samples that fall
into one are drawn again, and next to one the interpolation leaves it out. Other negative values are real: they are
clamped to 0 and counted.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np

from ..system.files import material_name, replacing, require_file
from . import grid
from .directions import half_difference, rusinkiewicz_to_directions, sample_pairs
from .measurements import Measurements, clamp_negative
from .registry import reader

_SHAPE = (90, 90, 180)  # theta_h, theta_d, phi_d; the last varies fastest
_PERIODIC = (False, False, True)
_SCALE = np.array([1.0, 1.15, 1.66]) / 1500  # exposure of the camera's channels, from MERL's own reading code
_SIZE = 12 + 3 * 8 * 90 * 90 * 180
_INVALID = -1.0


def function(path: str | Path) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """Return the reflectance of a file; see :func:`mi_enhance.data.functions.function_of`.

    Where nothing was measured, which is next to the horizon, the nearest measured cell of smaller theta_d counts.
    """
    table = read_table(path)
    for k in range(1, _SHAPE[1]):
        table[:, k] = np.where(np.isnan(table[:, k]), table[:, k - 1], table[:, k])
    table = np.nan_to_num(table, nan=0.0)  # a column without any value
    return lambda wi, wo: np.maximum(lookup(table, wi, wo), 0)


@reader("merl", about="MERL .binary", suffixes=(".binary",), magic=np.array(_SHAPE, "<i4").tobytes(), function=function)
def read(path: str | Path, *, n_samples: int = 100_000, seed: int = 0) -> Measurements:
    """Draw samples of the measured material in `path`.

    Parameters
    ----------
    path : str or Path
        ``<material>.binary``.
    n_samples, seed : int
        As for `mi_enhance.data.loading.load`.

    Returns
    -------
    Measurements

    Raises
    ------
    ValueError
        If the file has another length or other dimensions, or holds NaN.

    References
    ----------
    Matusik, Pfister, Brand, McMillan, "A Data-Driven Reflectance Model", 2003.

    Examples
    --------
    >>> read("gold-metallic-paint.binary").name  # doctest: +SKIP
    'gold-metallic-paint'
    """
    table = read_table(path)

    def measured(wi: np.ndarray, wo: np.ndarray) -> np.ndarray:
        return ~np.isnan(grid.nearest(table, _coordinates(wi, wo), _PERIODIC)[:, 0])

    wi, wo = sample_pairs(n_samples, seed=seed, accept=measured)
    f, clamped_fraction = clamp_negative(lookup(table, wi, wo))
    return Measurements(wi, wo, f, material_name(path), f"MERL file {path}", clamped_fraction)


def read_table(path: str | Path) -> np.ndarray:
    """Read the whole table.

    Returns
    -------
    array (90, 90, 180, 3), float32
        f_r in 1/sr, linear RGB, over theta_h, theta_d, phi_d; NaN in cells without a measurement.
    """
    where = f'data.load("{path}")'
    path = require_file(path, where)
    size = os.path.getsize(path)
    if size < 12:
        raise ValueError(
            f"{where}: {size} bytes are too few for a MERL file ({_SIZE} are expected). Download it again."
        )
    dims = tuple(np.fromfile(path, "<i4", 3).tolist())
    if dims != _SHAPE:
        raise ValueError(
            f"{where}: the header says {dims}, a MERL file has {_SHAPE}. The file is damaged or another "
            "format (360 instead of 180: a table without reciprocity, which is not supported)."
        )
    if size != _SIZE:
        raise ValueError(
            f"{where}: {size} bytes, a MERL file has {_SIZE}. It is cut off or damaged; download it again."
        )
    raw = np.fromfile(path, "<f8", offset=12).reshape(3, *_SHAPE)
    invalid = (raw <= _INVALID).any(0)  # a marked cell; real negatives of dark materials are far smaller
    with np.errstate(over="ignore", invalid="ignore"):
        table = np.moveaxis(raw * _SCALE[:, None, None, None], 0, -1).astype(np.float32, order="C")
    bad = ~np.isfinite(table).all(-1)
    if bad.any():
        cell = tuple(int(i) for i in np.argwhere(bad)[0])
        raise ValueError(
            f"{where}: cell {cell} (theta_h, theta_d, phi_d) holds NaN, infinity or an absurd value, and "
            f"so do {int(bad.sum()) - 1} more. The file is damaged; download it again."
        )
    table[invalid] = np.nan
    return table


def lookup(table: np.ndarray, wi: np.ndarray, wo: np.ndarray) -> np.ndarray:
    """Interpolate a table of `read_table`.

    Parameters
    ----------
    table : array (90, 90, 180, 3)
    wi, wo : array (N, 3)
        Unit vectors; by reciprocity the order does not matter.

    Returns
    -------
    array (N, 3), float32
        f_r in 1/sr; NaN where none of the eight cells around holds a measurement.
    """
    return grid.interpolate(table, _coordinates(wi, wo), _PERIODIC)


def write_merl(path: str | Path, f: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> None:
    """Tabulate a reflectance function into a MERL file; what reads MERL then reads this material.

    Parameters
    ----------
    path : str or Path
    f : callable
        ``f(wi, wo) -> array (N, 3)``, f_r in 1/sr. Isotropic and reciprocal, or the table cannot hold it. Called
        for the middles of the cells, where both directions are above the horizon; all others are marked -1.

    Examples
    --------
    >>> write_merl("grey.binary", lambda wi, wo: np.full((len(wi), 3), 0.2 / np.pi))  # doctest: +SKIP
    """
    raw = np.full((3, *_SHAPE), _INVALID)
    middles_d, middles_phi = (np.arange(90) + 0.5) / 90 * np.pi / 2, (np.arange(180) + 0.5) / 180 * np.pi
    theta_d, phi_d = np.meshgrid(middles_d, middles_phi, indexing="ij")
    for j in range(_SHAPE[0]):
        wi, wo = rusinkiewicz_to_directions(((j + 0.5) / 90) ** 2 * np.pi / 2, 0.0, theta_d, phi_d)
        above = (wi[..., 2] > 0) & (wo[..., 2] > 0)
        values = np.asarray(f(wi[above], wo[above]), np.float64)
        if values.shape != (above.sum(), 3) or not np.isfinite(values).all():
            raise ValueError(
                f"write_merl(): f returned shape {values.shape} or values that are not finite for "
                f"{above.sum()} pairs; it must return finite (N, 3)."
            )
        raw[:, j, above] = (values / _SCALE).T
    with replacing(path) as temporary, open(temporary, "wb") as file:
        np.array(_SHAPE, "<i4").tofile(file)
        raw.astype("<f8").tofile(file)


def _coordinates(wi: np.ndarray, wo: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the index of each pair, as real numbers that are whole in the middle of a cell."""
    theta_h, _, d = half_difference(wi, wo)
    theta_d = np.arctan2(np.hypot(d[:, 0], d[:, 1]), d[:, 2])
    phi_d = np.mod(np.arctan2(d[:, 1], d[:, 0]), np.pi)
    u, v = np.sqrt(theta_h / (np.pi / 2)) * 90 - 0.5, theta_d / (np.pi / 2) * 90 - 0.5
    return np.clip(u, 0, 89), np.clip(v, 0, 89), phi_d / np.pi * 180 - 0.5
