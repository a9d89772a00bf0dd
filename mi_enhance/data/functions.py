"""Reflectance as a function of directions: what is tabulated, whatever it comes from.

A file holds values for some directions and a rule for what lies between them; both together are a function
``f(wi, wo) -> (N, 3)``, as :meth:`mi_enhance.material.material.Material.evaluate` is one.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from ..system import files
from .directions import sample_pairs
from .loading import choose, recognized
from .scattered import interpolated

Function = Callable[[np.ndarray, np.ndarray], np.ndarray]

_TURNS = 8  # azimuths that a mean over all is taken of
_PROBES = 4096  # pairs that a symmetry is judged by
_MOST_SAMPLES = 1_000_000  # scattered, between which values are sought: more slow the search down and say no more
_EXACT = 1e-5  # float32 rounding: closer is equal


def function_of(path: str | Path, *, material: str | None = None) -> Function:
    """Return the reflectance that a measured file holds, for any directions.

    Parameters
    ----------
    path : str or Path
        As for :func:`mi_enhance.data.loading.load`. A table of scattered samples is interpolated, see
        :mod:`mi_enhance.data.scattered`.
    material : str, optional
        Which one, in a file with several.

    Returns
    -------
    callable
        ``f(wi, wo) -> array (N, 3)``, f_r in 1/sr, linear RGB, >= 0.

    Raises
    ------
    FileNotFoundError, ValueError, RuntimeError
        As `load` does.

    Examples
    --------
    >>> f = function_of("mi_enhance/bundled/nbrdf/merl.npz", material="blue-acrylic")
    >>> f(np.array([[0, 0, 1.0]]), np.array([[0, 0.6, 0.8]])).shape
    (1, 3)
    """
    where = f'data.function_of("{path}")'
    found = recognized(files.require_file(path, where), where)
    if found.function is None and found.scattered:
        return interpolated(found.read(path, n_samples=_MOST_SAMPLES, seed=0))
    if found.function is None:
        raise ValueError(f"{where}: {found.about} have no values between their samples. Fit them: mi-enhance fit.")
    if found.names is not None:
        return found.function(path, choose(found.names(path), material, where))
    if material is not None:
        raise ValueError(f"{where}: this file holds one material, {material!r} was asked for. Leave out material=.")
    return found.function(path)


def values(f: Function, wi: np.ndarray, wo: np.ndarray, where: str) -> np.ndarray:
    """Return ``f(wi, wo)`` in float64, once it is sure to be finite numbers (N, 3)."""
    result = np.asarray(f(wi.astype(np.float32), wo.astype(np.float32)), np.float64)
    if result.shape != wi.shape or not np.isfinite(result).all():
        raise ValueError(
            f"{where}: f returned shape {result.shape} or values that are not finite for {len(wi)} pairs; it must "
            "return finite (N, 3)."
        )
    return result


def difference(f: Function, g: Function, *, n: int = _PROBES, seed: int = 0) -> float:
    """Return the mean absolute difference of log(1 + f cos) between two functions, at random pairs.

    Examples
    --------
    >>> grey = lambda wi, wo: np.full((len(wi), 3), 0.1)
    >>> difference(grey, grey)
    0.0
    """
    wi, wo = sample_pairs(n, seed=seed)
    cos = wo[:, 2:].astype(np.float64)
    a, b = (np.log1p(np.maximum(values(h, wi, wo, "difference()"), 0) * cos) for h in (f, g))
    return float(np.abs(a - b).mean())


def turned(f: Function, angle: float, *, mirrored: bool = False) -> Function:
    """Return f of directions that are turned about the normal by `angle`, radians, and mirrored at the x axis."""
    c, s = np.cos(angle), np.sin(angle)
    sign = -1.0 if mirrored else 1.0
    matrix = np.array([[c, s, 0], [-s * sign, c * sign, 0], [0, 0, 1]])  # of row vectors: turn after the mirror
    return lambda wi, wo: f((wi @ matrix).astype(np.float32), (wo @ matrix).astype(np.float32))


def asymmetry(f: Function) -> float:
    """Return how much f depends on the azimuth of both directions together: 0 if it is isotropic."""
    return max(difference(f, turned(f, angle)) for angle in (0.7, 1.9, 3.0))  # no simple parts of a turn


def isotropic(f: Function) -> Function:
    """Return the mean of f over a turn about the normal; f itself if it is isotropic."""
    if asymmetry(f) < _EXACT:
        return f
    turns = [turned(f, 2 * np.pi * k / _TURNS) for k in range(_TURNS)]
    return lambda wi, wo: np.mean([g(wi, wo) for g in turns], axis=0)


def reciprocal(f: Function) -> Function:
    """Return the mean of f over both orders of its directions; f itself if it is reciprocal."""
    swapped: Function = lambda wi, wo: f(wo, wi)  # noqa: E731
    if difference(f, swapped) < _EXACT:
        return f
    return lambda wi, wo: 0.5 * (f(wi, wo) + f(wo, wi))
