"""Anisotropic materials of MIT (Ngan, Durand, Matusik 2005): `.dat`, bins in theta_in, theta_out, phi_diff, phi_in.

16 integers (int32): the number of bins of the four angles; two reserved; parameterization (1: standard); binning
(0: uniform); one reserved; half_data (1: phi_diff covers [0, pi], 0: [0, 2 pi]); channels (3); five reserved. Then
float32 values: a plane for each of R, G and B, in which the last angle varies fastest. theta covers [0, pi/2], phi_in
[0, 2 pi]; phi_diff is phi_out - phi_in; `in` is the light. Values belong to the middle of a bin and are interpolated.
Bins that were not measured are negative; they are left out as MERL's are.

The published description says no unit. The values are taken as they are; the BRDF Explorer shows ten times as much.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from ..system.files import material_name, require_file
from . import grid
from .directions import sample_pairs
from .measurements import Measurements
from .registry import reader
from .rows import finite

_HEADER = 16
_MOST_BINS = 1 << 28  # 3 GB of values


def _knows(head: bytes) -> bool:
    """Tell whether the header is one of theirs; text never looks like small integers."""
    if len(head) < 4 * _HEADER:
        return False
    h = np.frombuffer(head, "<i4", _HEADER)
    return bool((h[:4] > 0).all() and (h[:4] < 1 << 16).all() and h[6] == 1 and h[7] == 0 and h[10] == 3)


def function(path: str | Path) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """Return the reflectance of a file; see :func:`mi_enhance.data.functions.function_of`.

    0 where nothing was measured.
    """
    table, half = read_table(path)

    def f(wi: np.ndarray, wo: np.ndarray) -> np.ndarray:
        return np.nan_to_num(grid.interpolate(table, _coordinates(table.shape, half, wi, wo), _periodic(half)))

    return f


@reader("mit", about="MIT anisotropic .dat", knows=_knows, function=function)
def read(path: str | Path, *, n_samples: int = 100_000, seed: int = 0) -> Measurements:
    """Draw samples of the measured material in `path`, only where bins were measured.

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
        If header and length do not agree, or nearly nothing was measured.

    References
    ----------
    Ngan, Durand, Matusik, "Experimental Analysis of BRDF Models", 2005; header: the page of its data, as the
    BRDF Explorer quotes it.

    Examples
    --------
    >>> read("brushed_aluminum.dat").name  # doctest: +SKIP
    'brushed_aluminum'
    """
    table, half = read_table(path)

    def measured(wi: np.ndarray, wo: np.ndarray) -> np.ndarray:
        return ~np.isnan(grid.nearest(table, _coordinates(table.shape, half, wi, wo), _periodic(half))[:, 0])

    wi, wo = sample_pairs(n_samples, seed=seed, accept=measured)
    f = grid.interpolate(table, _coordinates(table.shape, half, wi, wo), _periodic(half))
    return Measurements(wi, wo, f, material_name(path), f"MIT file {path}")


def read_table(path: str | Path) -> tuple[np.ndarray, bool]:
    """Read the whole table.

    Returns
    -------
    table : array (theta_in, theta_out, phi_diff, phi_in, 3), float32
        f_r in 1/sr, linear RGB; NaN in bins without a measurement.
    half : bool
        phi_diff covers [0, pi] only: the material is the same on both sides.
    """
    where = f'data.load("{path}")'
    file = require_file(path, where)
    size = file.stat().st_size
    with file.open("rb") as opened:
        head = opened.read(4 * _HEADER)
    if not _knows(head):
        raise ValueError(
            f"{where}: does not begin with a header of MIT's anisotropic data (16 integers: 4 sizes, then 1 for the "
            "standard parameterization, 0 for uniform bins, 3 channels). It is damaged or of another kind."
        )
    header = np.frombuffer(head, "<i4", _HEADER)
    shape = tuple(int(n) for n in header[:4])
    expected = 4 * _HEADER + 12 * int(np.prod(shape, dtype=object))
    if size != expected or np.prod(shape, dtype=object) > _MOST_BINS or header[9] not in (0, 1):
        raise ValueError(
            f"{where}: {size} bytes, but a header of {shape} bins and half_data {header[9]} asks for {expected}. It is "
            "cut off or damaged; get it again."
        )
    raw = np.moveaxis(np.fromfile(file, "<f4", offset=4 * _HEADER).reshape(3, *shape), 0, -1)
    finite(raw.reshape(-1, 3), where)
    return np.where((raw < 0).any(-1, keepdims=True), np.float32(np.nan), raw), bool(header[9])


def _coordinates(shape: tuple[int, ...], half: bool, wi: np.ndarray, wo: np.ndarray) -> list[np.ndarray]:
    """Return the index of each pair, real numbers that are whole in the middle of a bin; the light is `in`."""
    thetas = [np.arctan2(np.hypot(w[:, 0], w[:, 1]).astype(np.float64), w[:, 2]) for w in (wo, wi)]
    phi_in, phi_out = (np.arctan2(w[:, 1].astype(np.float64), w[:, 0]) for w in (wo, wi))
    difference = np.mod(phi_out - phi_in, 2 * np.pi)
    if half:
        difference = np.minimum(difference, 2 * np.pi - difference)
    index = [np.clip(t / (np.pi / 2) * n - 0.5, 0, n - 1) for t, n in zip(thetas, shape[:2], strict=True)]
    k = difference / (np.pi if half else 2 * np.pi) * shape[2] - 0.5
    index.append(np.clip(k, 0, shape[2] - 1) if half else k)
    index.append(phi_in / (2 * np.pi) * shape[3] - 0.5)
    return index


def _periodic(half: bool) -> tuple[bool, ...]:
    return False, False, not half, True
