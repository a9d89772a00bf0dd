"""Numbers, vectors and poses in the JSON files that say how photographs were taken."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..system.messages import shortened

_RIGID = 1e-3  # largest deviation from a rotation: files hold 4 to 7 digits
_LARGEST = 1e15  # of a number: beyond it is a mistake, and float32 overflows in the cube

Entries = Mapping[str, Any]


def number(entries: Entries, key: str, default: float, where: str) -> float:
    """Return an entry that must be a number.

    Raises
    ------
    ValueError
    """
    value = entries.get(key)
    if value is None:
        return float(default)
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not abs(value) < _LARGEST:
        raise ValueError(f"{where}: {key} must be a number; got {shortened(value)}.")
    return float(value)


def positive(entry: Entries, name: str, where: str) -> float:
    """Return a number that must be above 0."""
    value = entry.get(name)
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0 < value < _LARGEST:
        raise ValueError(f"{where}: {name} is {shortened(value)}; it must be a number above 0.")
    return float(value)


def vector(entry: Entries, name: str, where: str) -> np.ndarray:
    """Return three numbers."""
    try:
        v = np.array(entry.get(name), np.float64)
    except (TypeError, ValueError, OverflowError):
        v = np.full(1, np.nan)
    if v.shape != (3,) or not np.isfinite(v).all():
        raise ValueError(f"{where}: {name} is {shortened(entry.get(name))}; it must be three numbers.")
    return v


def pose(matrix: object, where: str) -> np.ndarray:
    """Return camera to world, 4 x 4, from 4 x 4 or 3 x 4 numbers, in rows or one after the other.

    Raises
    ------
    ValueError
        If it is no rotation and translation.
    """
    try:
        m = np.array(matrix, np.float64)
    except (TypeError, ValueError, OverflowError):
        m = np.zeros(0)
    if m.shape in ((16,), (12,)):
        m = m.reshape(-1, 4)
    if m.shape == (3, 4):
        m = np.vstack([m, [0, 0, 0, 1]])
    if m.shape != (4, 4) or not np.isfinite(m).all() or np.abs(m).max() > 1e9:
        raise ValueError(f"{where}: transform_matrix must be 4 x 4 numbers, camera to world; got {shortened(matrix)}.")
    rotation = m[:3, :3]
    error = max(np.abs(rotation @ rotation.T - np.eye(3)).max(), np.abs(m[3] - [0, 0, 0, 1]).max())
    if error > _RIGID or np.linalg.det(rotation) < 0:
        raise ValueError(
            f"{where}: transform_matrix is not a rotation and a translation (off by {error:.2g}, determinant "
            f"{np.linalg.det(rotation):.3g}). Take scale and mirroring out of it."
        )
    return m
