"""Values between the points of a grid: linear in every axis, around its ends where an axis is an angle of a turn."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np


def interpolate(table: np.ndarray, index: Sequence[np.ndarray], periodic: Sequence[bool]) -> np.ndarray:
    """Interpolate a table whose last axis are channels.

    Parameters
    ----------
    table : array (n_1, ..., n_D, C)
        NaN in the first channel where nothing was measured: such points are left out.
    index : sequence of D arrays (N,)
        Coordinates that are whole at the points, from 0 to n - 1; of a periodic axis any number.
    periodic : sequence of D bool
        Whether the point n of an axis is the point 0.

    Returns
    -------
    array (N, C), float32
        NaN where none of the points around has a value.

    Examples
    --------
    >>> interpolate(np.array([[0.0], [2.0], [6.0]]), [np.array([0.5, 2.5])], [True]).tolist()
    [[1.0], [3.0]]
    """
    low = [np.floor(x) for x in index]
    inside = [x - i for x, i in zip(index, low, strict=True)]
    n = len(low[0])
    total, weights = np.zeros((n, table.shape[-1])), np.zeros((n, 1))
    for corner in np.ndindex(*(2,) * len(low)):
        weight = np.prod([t if c else 1 - t for t, c in zip(inside, corner, strict=True)], axis=0)[:, None]
        at = [(i + c).astype(np.int64) for i, c in zip(low, corner, strict=True)]
        # beyond the last point the weight is 0
        places = [
            i % size if turns else np.minimum(i, size - 1)
            for i, size, turns in zip(at, table.shape, periodic, strict=False)
        ]
        value = table[tuple(places)]
        there = ~np.isnan(value[:, :1])
        total += np.where(there, weight * value, 0)
        weights += np.where(there, weight, 0)
    with np.errstate(invalid="ignore"):  # 0 / 0 where nothing was measured: NaN, as documented
        return (total / weights).astype(np.float32)


def nearest(table: np.ndarray, index: Sequence[np.ndarray], periodic: Sequence[bool]) -> np.ndarray:
    """Return the values (N, C) at the points nearest to the coordinates of :func:`interpolate`."""
    at = [np.floor(x + 0.5).astype(np.int64) for x in index]
    places = [
        i % size if turns else np.clip(i, 0, size - 1)
        for i, size, turns in zip(at, table.shape, periodic, strict=False)
    ]
    return table[tuple(places)]
