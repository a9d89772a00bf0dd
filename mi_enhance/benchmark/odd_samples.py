"""Samples of an RGL file that are not spread over all directions (the paper's Fig. 7)."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from ..data import rgl
from ..data.directions import MIN_COS, rusinkiewicz_to_directions
from ..data.measurements import Measurements, clamp_negative
from ..system.files import material_name

_RETRO = np.deg2rad(1.5)  # of theta_d: the two directions are at most twice that apart


def retro_reflective(path: str | Path, n: int, seed: int = 0) -> Measurements:
    """Return the values of an RGL file for `n` pairs whose directions lie within 3 degrees of each other."""
    return sampled(path, n, seed, lambda angles: angles * [[1], [1], [_RETRO / (np.pi / 2)], [1]])


def in_plane(path: str | Path, n: int, seed: int = 0) -> Measurements:
    """Return the values of an RGL file for `n` pairs that lie in one plane with the normal."""
    return sampled(path, n, seed, lambda angles: np.stack([*angles[:3], np.pi * (angles[3] > np.pi)]))


def sampled(path: str | Path, n: int, seed: int, change: Callable[[np.ndarray], np.ndarray]) -> Measurements:
    """Return the values of an RGL file for random theta_h, phi_h, theta_d, phi_d (4, N) after `change`."""
    rng = np.random.default_rng(seed + 1)
    pairs: list[tuple[np.ndarray, np.ndarray]] = []
    while sum(len(wi) for wi, _ in pairs) < n:
        angles = change(rng.random((4, 2 * n)) * (np.pi / 2 * np.array([[1], [4], [1], [4]])))
        wi, wo = rusinkiewicz_to_directions(*angles)
        above = np.minimum(wi[:, 2], wo[:, 2]) >= MIN_COS
        pairs.append((wi[above], wo[above]))
    wi, wo = (np.concatenate(w)[:n].astype(np.float32) for w in zip(*pairs, strict=True))
    f, clamped_fraction = clamp_negative(rgl.evaluate(path, wi, wo))
    return Measurements(wi, wo, f, material_name(path), f"RGL file {path}", clamped_fraction)
