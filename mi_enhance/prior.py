"""A prior for fits: parameters that the samples say nothing about stay where those of the training materials are."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from . import parameters
from .data import Measurements
from .data.sampling import directions_to_rusinkiewicz
from .material import Material
from .objective import Objective

# Chosen on MERL materials that training keeps aside, for full and for odd samples.
_WEIGHT = 4e-5


class Prior:
    """What the training materials say of parameters that the samples leave open: a Gaussian over their values.

    Retro-reflective samples alone say nothing about the highlight, and leave most of the latent numbers to chance.
    Colours and frame stay free. The weight is a share of the residuals of the analytic model, over the square of the
    part of the half and difference angles that the samples visit: many samples in one place are no more than a few.

    Parameters
    ----------
    material : Material
        A network, with its library.
    measurements : Measurements
        What is fitted.
    scale : float
        Log-L1 of the analytic model on them.
    """

    def __init__(self, material: Material, measurements: Measurements, scale: float):
        space = parameters.Space(material.brdf.parameters)
        u = space.to(np.asarray(material.library, np.float64))
        free = np.concatenate(
            [np.full(p.size, p.is_colour or p.fixed or p.name in parameters.FRAME) for p in material.brdf.parameters]
        )
        kept = np.flatnonzero(~free)
        covariance = np.cov(u[:, kept].T)
        # a tenth of the variances on top: what 300 materials have in common is not certain for the next one
        covariance += np.diag(0.1 * np.diag(covariance) + 1e-6)
        self.mean, self.precision = u.mean(0), np.zeros((u.shape[1], u.shape[1]))
        weight = _WEIGHT * scale / coverage(measurements) ** 2
        self.precision[np.ix_(kept, kept)] = weight * np.linalg.inv(covariance)

    def loss(self, u: np.ndarray) -> np.ndarray:
        """Half the squared distance to the mean of the training materials, (B,), for parameters (B, P)."""
        d = u - self.mean
        return 0.5 * np.einsum("bi,ij,bj->b", d, self.precision, d)

    def added(self, problem: Objective) -> tuple[Callable, Callable]:
        """Loss and normal equations of a problem with the prior added."""

        def normal_equations(u, epsilon):
            h, g, smooth = problem.normal_equations(u, epsilon)
            return h + self.precision, g + (u - self.mean) @ self.precision, smooth

        return lambda u: problem.loss(u) + self.loss(u), normal_equations


def coverage(measurements: Measurements) -> float:
    """Part of 12 x 12 cells of theta_h and theta_d that the samples visit; about 0.8 for all directions."""
    theta_h, _, theta_d, _ = directions_to_rusinkiewicz(measurements.wi, measurements.wo)
    cells = [np.minimum(12 * a / (np.pi / 2), 11).astype(int) for a in (theta_h, theta_d)]
    return len(np.unique(np.ravel_multi_index(cells, (12, 12)))) / 144
