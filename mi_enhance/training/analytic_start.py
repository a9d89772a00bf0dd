"""The start of a training and its judgement: fits of all materials."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..analytic import parameters
from ..fitting.analytic_fit import fit_analytic
from ..fitting.problems import objective_of
from ..neural.enhanced_brdf import EnhancedBRDF
from ..numerics import levenberg_marquardt
from ..system import npz
from ..system.cache import cached
from .training_set import TrainingSet, first_samples

START_SAMPLES = 1024  # per material, for the analytic fit that training starts from


def analytic_start(brdf: EnhancedBRDF, samples: TrainingSet, cache: Path | None = None) -> np.ndarray:
    """Return the parameters that materials start from, (M, P): the best analytic fit, the rest at its initial value.

    With `cache`, a ``.npz`` file, the analytic fits are kept there or taken from there.
    """
    n = min(START_SAMPLES, samples.n_samples)

    def fit() -> np.ndarray:
        return fit_analytic(EnhancedBRDF(brdf.model, {}), *first_samples(samples, n), n)

    def read(path: Path) -> np.ndarray:
        where, shape = f'analytic fits "{path}"', (len(samples.names), parameters.count(brdf.model.parameters))
        return npz.numbers(npz.read(path, ["analytic"], where), "analytic", shape, where).astype(np.float64)

    analytic = cached(cache, fit, read, lambda path, v: np.savez(path, analytic=v)) if cache else fit()
    start = np.tile(parameters.flatten(brdf.parameters, parameters.initial(brdf.parameters)), (len(analytic), 1))
    start[:, : analytic.shape[1]] = analytic
    return start


def representative(kinds: list[str]) -> np.ndarray:
    """Return the indices of the materials that fits start from: all measured ones and as many others, evenly spaced."""
    made_up = np.array([kind not in ("nps", "nbrdf", "file", "given") for kind in kinds])
    measured, rest = np.flatnonzero(~made_up), np.flatnonzero(made_up)
    n = min(len(rest), max(len(measured), 250))
    return np.sort(np.append(measured, rest[np.linspace(0, len(rest) - 1, n).astype(int)] if n else rest))


def validate(brdf: EnhancedBRDF, samples: TrainingSet, start: np.ndarray) -> np.ndarray:
    """Return the loss of materials that are not trained on, (M,), each fitted by a few steps from `start`."""
    n = min(START_SAMPLES, samples.n_samples)
    problem = objective_of(brdf, *first_samples(samples, n), n)
    _, losses = levenberg_marquardt.minimize(
        problem.loss,
        problem.normal_equations,
        problem.space.to_free(start),
        problem.space.low,
        problem.space.high,
        steps=20,
    )
    return losses
