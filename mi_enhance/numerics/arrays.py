"""Rows of NumPy to lanes of Dr.Jit, and back."""

from __future__ import annotations

import mitsuba as mi
import numpy as np


def vector3f(rows: np.ndarray) -> mi.Vector3f:
    """Return rows (N, 3) as a vector of N lanes.

    Examples
    --------
    >>> vector3f(np.array([[0.0, 0.6, 0.8]]))
    [[0, 0.6, 0.8]]
    """
    return mi.Vector3f(_columns(rows))


def color3f(rows: np.ndarray) -> mi.Color3f:
    """Return rows (N, 3) as a colour of N lanes.

    Examples
    --------
    >>> color3f(np.array([[1.0, 0.5, 0.0]]))
    [[1, 0.5, 0]]
    """
    return mi.Color3f(_columns(rows))


def _columns(rows: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(np.asarray(rows, np.float32).T)
