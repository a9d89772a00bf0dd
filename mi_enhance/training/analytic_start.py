"""Where a training starts, and how it is judged: analytic fits of all materials."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..analytic import parameters
from ..fitting.analytic_fit import fit_analytic
from ..fitting.objective import Objective
from ..neural.enhanced_brdf import EnhancedBRDF
from ..numerics import levenberg_marquardt
from ..system import npz
from ..system.files import replacing
from .training_set import TrainingSet, first_samples

_START_SAMPLES = 1024  # per material, for the analytic fit that training starts from


def analytic_start(brdf: EnhancedBRDF, samples: TrainingSet, cache: Path | None = None) -> np.ndarray:
    """Where the materials start: the best fit of the analytic model, latent numbers at their initial value.

    With `cache`, a ``.npz`` file, the analytic fits are kept there or taken from there.
    """
    n = min(_START_SAMPLES, samples.n_samples)
    if cache and cache.exists():
        where, shape = f'analytic fits "{cache}"', (len(samples.names), parameters.count(brdf.model.parameters))
        analytic = npz.numbers(npz.read(cache, ["analytic"], where), "analytic", shape, where).astype(np.float64)
    else:
        analytic = fit_analytic(EnhancedBRDF(brdf.model, {}), *first_samples(samples, n), n)
    if cache and not cache.exists():
        with replacing(cache) as temporary:
            np.savez(temporary, analytic=analytic)
    start = np.tile(parameters.flatten(brdf.parameters, parameters.initial(brdf.parameters)), (len(analytic), 1))
    start[:, : analytic.shape[1]] = analytic
    return start


def representative(kinds: list[str]) -> np.ndarray:
    """Materials that fits start from: all measured ones, and of the made-up ones as many, evenly spaced."""
    made_up = np.array([kind in ("nps-mixtures", "synthetic", "two-lobes", "assorted") for kind in kinds])
    measured, rest = np.flatnonzero(~made_up), np.flatnonzero(made_up)
    n = min(len(rest), max(len(measured), 250))
    return np.sort(np.append(measured, rest[np.linspace(0, len(rest) - 1, n).astype(int)] if n else rest))


def validate(brdf: EnhancedBRDF, samples: TrainingSet, start: np.ndarray) -> np.ndarray:
    """Loss of materials the networks do not train on, (M,), each fitted by a few steps from `start`."""
    n = min(_START_SAMPLES, samples.n_samples)
    problem = Objective(brdf, *first_samples(samples, n), n)
    _, losses = levenberg_marquardt.minimize(
        problem.loss,
        problem.normal_equations,
        problem.space.to_free(start),
        problem.space.low,
        problem.space.high,
        steps=20,
    )
    return losses
