"""Fits of analytic models."""

from __future__ import annotations

import numpy as np

from ..analytic import parameters
from ..data.measurements import Measurements
from ..neural.enhanced_brdf import EnhancedBRDF
from ..numerics import levenberg_marquardt
from .objective import Objective
from .problems import stacked


def objective(brdf: EnhancedBRDF, measurements: Measurements) -> Objective:
    """Return the loss of one material on its samples."""
    return stacked(brdf, measurements.wi, measurements.wo, measurements.f[None])


def analytic_starts(brdf: EnhancedBRDF) -> np.ndarray:
    """Return the starts of an analytic model, (S, P), which between them lead to its minima."""
    values = parameters.initial(brdf.parameters)
    return np.array([parameters.flatten(brdf.parameters, {**values, **start}) for start in brdf.model.starts])


def fit_analytic(brdf: EnhancedBRDF, wi, wo, f, n: int) -> np.ndarray:
    """Return the best analytic parameters of B materials at once, (B, P): every start in turn, the best kept.

    Parameters
    ----------
    brdf : EnhancedBRDF
        Without neural modules.
    wi, wo, f : Dr.Jit arrays, B * n lanes
        As :class:`mi_enhance.fitting.objective.Objective` takes them.
    n : int
        Samples per material.
    """
    problem = Objective(brdf, wi, wo, f, n)
    space = problem.space
    best, least = np.zeros((problem.n_problems, brdf.n_parameters)), np.full(problem.n_problems, np.inf)
    for row in analytic_starts(brdf):
        u = np.tile(space.to_free(row), (problem.n_problems, 1))
        u, loss = levenberg_marquardt.minimize(
            problem.loss, problem.normal_equations, u, space.low, space.high, steps=30
        )
        better = loss < least
        best, least = np.where(better[:, None], u, best), np.where(better, loss, least)
    return space.to_physical(best)
