"""Levenberg-Marquardt for many small L1 problems at once; knows no optics.

Each problem has its own unknowns, box and damping. L1 is minimized as reweighted least squares: the smooth loss
sqrt(r^2 + epsilon^2) with an epsilon that follows the loss down.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .threads import one_thread

# Residuals below this share of the mean loss count quadratically; smaller values follow L1 closer but step less far.
_SMOOTH = 0.1


def minimize(
    loss: Callable,
    normal_equations: Callable,
    u: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    *,
    steps: int = 40,
    tolerance: float = 1e-4,
    tries: int = 2,
    callback: Callable | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Minimise B independent losses inside a box.

    Parameters
    ----------
    loss : callable
        ``loss(u) -> (B,)`` for `u` of shape (B, P).
    normal_equations : callable
        ``normal_equations(u, epsilon) -> h (B, P, P), g (B, P), smooth loss (B,)``.
    u : array (B, P)
        Start, inside the box.
    low, high : array (P,)
        The box.
    steps : int
        Most linearizations.
    tolerance : float
        Stop when three steps in a row improve no problem by more than this share.
    tries : int
        Lengths of a step, each with more damping, before the next linearization.
    callback : callable, optional
        ``callback(step, losses)`` after each step.

    Returns
    -------
    u : array (B, P)
        Best points found; never worse than the start.
    losses : array (B,)

    References
    ----------
    Marquardt 1963, *An Algorithm for Least-Squares Estimation of Nonlinear Parameters*; weights 1/|r|: Lawson 1961.

    Examples
    --------
    >>> equations = lambda u, e: (np.ones((1, 1, 1)), u - 3, (u[:, 0] - 3) ** 2 / 2)
    >>> loss = lambda u: (u[:, 0] - 3) ** 2 / 2
    >>> minimize(loss, equations, np.zeros((1, 1)), np.zeros(1), np.full(1, 9.0))[0].round(3)
    array([[3.]])
    """
    with one_thread():
        return _minimize(loss, normal_equations, u, low, high, steps, tolerance, tries, callback)


def _minimize(loss, normal_equations, u, low, high, steps, tolerance, tries, callback) -> tuple[np.ndarray, np.ndarray]:
    u = np.clip(u, low, high)
    damping = np.ones(len(u))  # a careful first step: long ones end in worse minima
    best = loss(u)
    idle = 0
    for step in range(steps):
        h, g, _ = normal_equations(u, np.maximum(_SMOOTH * best, 1e-6))
        before = best.copy()
        done = np.zeros(len(u), bool)
        for _ in range(tries):  # retry with more damping what did not improve
            trial = np.where(done[:, None], u, np.clip(u + _direction(h, g, u, low, high, damping), low, high))
            value = loss(trial)
            better = ~done & (value < best)  # NaN compares false: such a trial is never taken
            u, best = np.where(better[:, None], trial, u), np.where(better, value, best)
            lower, higher = np.maximum(damping / 3, 1e-7), np.minimum(damping * 4, 1e7)
            damping = np.where(better, lower, np.where(done, damping, higher))
            done |= better
            if done.all():
                break
        if callback:
            callback(step, best)
        idle = 0 if (before - best > tolerance * before).any() else idle + 1
        if idle == 3:
            break
    return u, best


def _direction(h, g, u, low, high, damping) -> np.ndarray:
    """Damped Gauss-Newton step; unknowns at a bound that the gradient pushes outwards stay there."""
    free = ~(((u <= low) & (g > 0)) | ((u >= high) & (g < 0)))
    diagonal = np.einsum("bpp->bp", h)
    # Unknowns the data says nothing about have a zero row: this floor keeps the matrix regular, their step is 0.
    # Held ones do not count: behind a colour held at 0 a factor may have grown without bound, and its row with it.
    floor = 1e-6 * np.where(free, diagonal, 0).max(1, keepdims=True) + 1e-30
    scale = np.maximum(diagonal, floor)
    a = np.where(free[:, :, None] & free[:, None, :], h, 0.0)
    index = np.arange(u.shape[1])
    a[:, index, index] = np.where(free, diagonal + damping[:, None] * scale, scale)
    b = np.where(free, -g, 0.0)
    # symmetric scaling to a unit diagonal: log alpha and a latent number differ by many orders of magnitude
    s = 1 / np.sqrt(a[:, index, index])
    return s * np.linalg.solve(a * s[:, :, None] * s[:, None, :], (b * s)[:, :, None])[:, :, 0]
