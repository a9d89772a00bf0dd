"""Priors for fits: parameters that the samples say nothing about stay where those of the training materials are."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np

from ..analytic import parameter_space, parameters
from ..data.directions import directions_to_rusinkiewicz
from ..material.material import Material
from .objective import Objective

# Chosen on MERL materials that training keeps aside, for full and for odd samples.
_WEIGHT = 4e-5
_AS_MANY = 6000  # samples for which it is right for read-outs, too


@dataclasses.dataclass(frozen=True)
class Prior:
    """A Gaussian over the optimized parameters, added to the loss of every problem.

    Parameters
    ----------
    mean : array (P,) or (B, P)
        One for all problems, or one each.
    precision : array (P, P) or (B, P, P)
        Inverse covariance times the weight of the prior; 0 for parameters that stay free.

    Examples
    --------
    >>> Prior(np.zeros(2), np.diag([1.0, 0.0])).loss(np.array([[2.0, 5.0]]))
    array([2.])
    """

    mean: np.ndarray
    precision: np.ndarray

    def loss(self, u: np.ndarray) -> np.ndarray:
        """Return half the squared distance to the mean, (B,), for parameters (B, P)."""
        d = u - self.mean
        return 0.5 * (self._force(d) * d).sum(1)

    def added(self, problem: Objective) -> tuple[Callable, Callable]:
        """Return loss and normal equations of a problem with the prior added."""

        def normal_equations(u, epsilon):
            h, g, smooth = problem.normal_equations(u, epsilon)
            return h + self.precision, g + self._force(u - self.mean), smooth

        return lambda u: problem.loss(u) + self.loss(u), normal_equations

    def __add__(self, other: Prior) -> Prior:
        """Return the product of two Gaussians; their losses add up, but for a constant."""
        precision = self.precision + other.precision
        force = np.matmul(self.precision, self.mean[..., None]) + np.matmul(other.precision, other.mean[..., None])
        # 1e-12: a parameter that neither says anything about has no mean, and needs none
        return Prior(np.linalg.solve(precision + 1e-12 * np.eye(precision.shape[-1]), force)[..., 0], precision)

    def of(self, index: np.ndarray) -> Prior:
        """Return the prior of some of the problems, which may repeat."""
        mean, precision = self.mean, self.precision
        return Prior(mean[index] if mean.ndim == 2 else mean, precision[index] if precision.ndim == 3 else precision)

    def _force(self, d: np.ndarray) -> np.ndarray:
        return np.matmul(d[:, None, :], self.precision)[:, 0]


def from_library(material: Material, weight: float | np.ndarray) -> Prior:
    """Return a Gaussian over the training materials, for parameters that the samples leave open.

    Retro-reflective samples alone say nothing about the highlight, and leave most of the latent numbers to chance.
    Colours and frame stay free.

    Parameters
    ----------
    material : Material
        A network, with its library. A library of one material leaves all parameters free.
    weight : float or array (B,)
        How much the prior counts beside a mean loss, for all problems or for each.
    """
    space = parameter_space.Space(material.brdf.parameters)
    u = space.to_free(np.asarray(material.library, np.float64))
    if material.brdf.has_free_read_out:
        return _of_read_outs(material, u, np.asarray(weight))
    free = np.concatenate(
        [np.full(p.size, p.is_colour or p.fixed or p.name in parameters.FRAME) for p in material.brdf.parameters]
    )
    kept = np.flatnonzero(~free)
    precision = np.zeros((u.shape[1], u.shape[1]))
    if len(u) > 1:  # one material says nothing of how much others differ from it
        covariance = np.cov(u[:, kept].T)
        # a tenth of the variances on top: what 300 materials have in common is not certain for the next one
        covariance += np.diag(0.1 * np.diag(covariance) + 1e-6)
        precision[np.ix_(kept, kept)] = np.linalg.inv(covariance)
    return Prior(u.mean(0), np.asarray(weight)[..., None, None] * precision)


def _of_read_outs(material: Material, u: np.ndarray, weight: np.ndarray) -> Prior:
    """Return a Gaussian over latent numbers and read-outs, each for itself; a read-out of 0 is the analytic model.

    Covariances of hundreds of numbers from as many materials are mostly noise: they made fits worse.
    """
    mean, precision = np.zeros(u.shape[1]), np.zeros(u.shape[1])
    names = np.array([p.name for p in material.brdf.parameters for _ in range(p.size)])
    for name in ("asymmetry", "latent"):
        k = names == name
        mean[k], precision[k] = u[:, k].mean(0), 1 / (u[:, k].var(0) + 1e-2)  # 1e-2: one material varies by nothing
    k = names == "read_out"
    # 1e-3: a unit that no training material reads is not certain to be read by none
    precision[k] = 1 / (np.square(u[:, k]).mean(0) + 1e-3)
    return Prior(mean, weight[..., None, None] * np.diag(precision))


def weight(wi: np.ndarray, wo: np.ndarray, scale: float) -> float:
    """Return a share of `scale`, the log-L1 of the analytic model on samples of the directions `wi`, `wo` (n, 3).

    Divided by the square of the part of the half and difference angles that the samples visit: many samples in one
    place are no more than a few.
    """
    return _WEIGHT * scale / coverage(wi, wo) ** 2


def weight_of_read_outs(wi: np.ndarray, wo: np.ndarray, scale: float) -> float:
    """As :func:`weight`, for hundreds of numbers: it falls with the root of the number of samples."""
    return weight(wi, wo, scale) * float(np.sqrt(_AS_MANY / len(wi)))


def coverage(wi: np.ndarray, wo: np.ndarray) -> float:
    """Return the part of 12 x 12 cells of theta_h and theta_d that the samples visit; about 0.8 for all directions."""
    theta_h, _, theta_d, _ = directions_to_rusinkiewicz(wi, wo)
    cells = [np.minimum(12 * a / (np.pi / 2), 11).astype(int) for a in (theta_h, theta_d)]
    return len(np.unique(np.ravel_multi_index(cells, (12, 12)))) / 144
