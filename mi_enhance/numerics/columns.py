"""Many Dr.Jit arrays of one width as a NumPy matrix, and back, without a copy of each."""

from __future__ import annotations

from collections.abc import Sequence

import drjit as dr
import mitsuba as mi
import numpy as np


def pack(columns: Sequence[mi.Float]) -> mi.Float:
    """Write C arrays of N lanes one after the other into one array; ``dr.eval`` and :func:`matrix` come next.

    Examples
    --------
    >>> matrix(pack([mi.Float(1, 2), mi.Float(3, 4)]), 2)
    array([[1., 2.],
           [3., 4.]], dtype=float32)
    """
    n = dr.width(columns)
    buffer, index = dr.empty(mi.Float, n * len(columns)), dr.arange(mi.UInt32, n)
    for k, column in enumerate(columns):
        dr.scatter(buffer, dr.detach(column), index + k * n, mode=dr.ReduceMode.NoConflicts)
    return buffer


def matrix(buffer: mi.Float, n_columns: int) -> np.ndarray:
    """Return what :func:`pack` wrote as an array (C, N) on the same memory, where the backend shares it."""
    return np.asarray(buffer.numpy()).reshape(n_columns, -1)


def unpack(buffer: mi.Float, n_columns: int) -> list[mi.Float]:
    """Return the C arrays of an array that holds them one after the other."""
    n = len(buffer) // n_columns
    index = dr.arange(mi.UInt32, n)
    return [dr.gather(mi.Float, buffer, index + k * n) for k in range(n_columns)]


def lanes(rows: np.ndarray) -> list[mi.Float]:
    """Return the rows of an array (C, N) as C arrays of N lanes.

    Examples
    --------
    >>> lanes(np.array([[1.0, 2.0], [3.0, 4.0]]))[1]
    [3, 4]
    """
    return unpack(mi.Float(np.ascontiguousarray(rows, np.float32).ravel()), len(rows))
