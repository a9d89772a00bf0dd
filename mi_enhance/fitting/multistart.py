"""Fits from many starts, of which the best go on."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..analytic import parameter_space
from ..numerics import levenberg_marquardt
from .analytic_fit import analytic_starts, objective

_NEAREST = 28  # training materials to start from, besides the analytic fit


# Samples, parameter sets that go on from the stage before, and most steps: many starts on few samples first. Chosen
# on the materials that training keeps aside; more of everything lowers the loss by 1 to 2 % at twice the time.
_STAGES = ((1024, None, 12), (2048, 12, 15), (8192, 3, 36), (None, 1, 15))


def _lm(brdf, measurements, starts, rng, callback, library=None, known=None, *, hold=()) -> tuple[np.ndarray, float]:
    """Search on a subset from many starts at once, then polish the best on everything."""
    n = len(measurements.f)
    order = rng.permutation(n)
    stage = "analytic" if not brdf.modules else "enhanced"
    if not brdf.modules:
        starts = [*starts, *analytic_starts(brdf)]
    elif library is not None:
        starts = [*starts, *_nearest(brdf, measurements, library, order[:1024])]
    space = parameter_space.Space(brdf.parameters, hold)
    u, losses, used = space.to_free(np.array(starts)), None, 0
    for samples, survivors, steps in _STAGES:
        if used == n:
            break  # a later stage would see the same samples
        used = min(samples or n, n)
        if losses is not None:
            u = u[np.argsort(losses)[:survivors]]
        problem = objective(brdf, measurements, len(u), order[:used])
        loss, normal_equations = known.added(problem) if known else (problem.loss, problem.normal_equations)
        u, losses = levenberg_marquardt.minimize(
            loss,
            normal_equations,
            u,
            space.low,
            space.high,
            steps=steps,
            tolerance=3e-4,
            callback=_reporter(callback, f"{stage}, {used} samples"),
        )
    best = int(np.argmin(losses))
    return space.to_physical(u[best]), losses[best] - (known.loss(u[best : best + 1])[0] if known else 0)


def _reporter(callback: Callable, stage: str) -> Callable:
    return lambda step, losses: callback(stage, step, float(losses.min()))


def _nearest(brdf, measurements, library: np.ndarray, index: np.ndarray) -> np.ndarray:
    """The training materials that explain the measurements best as they are."""
    candidates = objective(brdf, measurements, len(library), index)
    losses = candidates.loss(candidates.space.to_free(np.asarray(library, np.float64)))
    return library[np.argsort(losses)[:_NEAREST]]
