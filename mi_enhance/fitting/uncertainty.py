"""Standard deviation of each fitted parameter, and the parameters that the samples leave open."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..analytic import parameter_space, parameters
from ..data.measurements import Measurements
from ..material.material import Material
from ..numerics.arrays import color3f, vector3f
from ..numerics.threads import one_thread
from .problems import objective_of

# Residuals count as at least this much: below it is what float32 and the model's own shape leave, not information.
LEAST_RESIDUAL = 1e-4
# Eigenvalues of the normal matrix, scaled to a unit diagonal, that are 0 up to the rounding of its float32 products.
_SINGULAR = 1e-6
# Undetermined: the samples narrow a parameter down to no less than this share of what it might have been without any.
OPEN = 0.5


def determined(
    material: Material, measurements: Measurements, log_l1: float, hold: Sequence[str] = ()
) -> tuple[dict[str, list[float]], list[str]]:
    r"""Return standard deviations of the parameters of a fit, and the names of those that the samples leave open.

    The residuals of the loss are taken for independent, with a Laplace distribution of the mean size b they have:
    least absolute deviations then have the covariance :math:`b^2 (J^T J)^{-1}`. The inverse covariance of a uniform
    prior over the range of each parameter is added, so that the sum is invertible. Errors of the model are not
    independent: take the numbers for lower bounds, and for a ranking. A colour is told for the factors as they are:
    its size is that of the mean factor, which read-outs could take over, and which is held at 1.

    Parameters
    ----------
    material : Material
        Fitted to `measurements`.
    measurements : Measurements
    log_l1 : float
        Mean absolute residual of the fit.
    hold : sequence of str
        Parameters that the fit did not move.

    Returns
    -------
    std : dict of str to list of float
        In the unit of the parameter, as :attr:`Material.params`.
    undetermined : list of str
        ``"F0"``, ``"rho_s.R"``, ``"latent.07"``: their standard deviation is above half of that of a number anywhere
        in their range (of the logarithm, where fits move that).

    References
    ----------
    Koenker and Bassett 1978, *Regression Quantiles*, theorem 4.1: the covariance of least absolute deviations.

    Examples
    --------
    >>> from mi_enhance.data.synthetic import ggx_anisotropic
    >>> m, _ = ggx_anisotropic(3, n_samples=500, noise=0)
    >>> determined(Material.analytic("ggx").edit(rho_s=0), m, 0.1)[1][:4]
    ['n_x', 'n_y', 't_theta', 'alpha_x']
    """
    brdf = material.brdf
    space = parameter_space.Space(brdf.parameters, hold)
    u = space.to_free(material.as_vector())
    spread = (space.high - space.low) / np.sqrt(12)  # of a number anywhere in the range
    free = np.flatnonzero(spread)
    n = len(measurements.f)
    problem = objective_of(brdf, vector3f(measurements.wi), vector3f(measurements.wo), color3f(measurements.f), n)
    # residuals far below `same` all have the same weight, 1 / same: what is left is J^T J
    same = 1e3
    h = problem.normal_equations(u[None], np.array([same]))[0][0] * (3 * n * same)
    std = np.zeros(len(u))

    def found_std(k: np.ndarray) -> np.ndarray:
        return np.sqrt(np.diag(posterior(h[np.ix_(k, k)], log_l1, np.diag(1 / spread[k] ** 2))))

    std[free] = found_std(free)
    names = [name for p in brdf.parameters for name in parameters.components(p)]
    of_factor = np.array([name.startswith(("read_out", "code")) for name in names])
    if of_factor.any():
        is_colour = np.array([p.is_colour for p in brdf.parameters for _ in range(p.size)])
        others = free[~of_factor[free]]
        std[others] = np.where(is_colour[others], found_std(others), std[others])
    undetermined = [names[k] for k in free if not of_factor[k] and std[k] > OPEN * spread[k]]
    found = parameters.unflatten(brdf.parameters, std * space.slope(u))
    # not of the hundreds of numbers of a read-out, none of which means anything by itself
    return {name: v.tolist() for name, v in found.items() if name not in ("read_out", "code")}, undetermined


def posterior(normal: np.ndarray, residual: float | np.ndarray, precision: np.ndarray) -> np.ndarray:
    """Return the covariance of parameters that samples tell about, on top of what was known before.

    Parameters
    ----------
    normal : array (..., P, P)
        J^T J of the residuals; symmetric, and up to rounding or noise of no negative eigenvalue.
    residual : float or array (...)
        Mean absolute residual of the fit.
    precision : array (P, P) or (..., P, P)
        Inverse covariance without the samples, positive definite.

    Examples
    --------
    >>> posterior(np.diag([1e6, 0.0]), 0.1, np.diag([1.0, 0.25])).round(4)
    array([[0., 0.],
           [0., 4.]])
    """
    size = np.sqrt(np.maximum(np.diagonal(normal, axis1=-2, axis2=-1), 0))
    scale = np.where(size > 0, size, 1)
    with one_thread():
        values, vectors = np.linalg.eigh(normal / (scale[..., :, None] * scale[..., None, :]))
    root = vectors * np.sqrt(np.where(values > _SINGULAR, values, 0))[..., None, :] * scale[..., :, None]
    before = np.swapaxes(np.linalg.inv(np.linalg.cholesky(precision)), -1, -2)  # times its transpose: the covariance
    root = np.swapaxes(before, -1, -2) @ root / np.maximum(np.asarray(residual), LEAST_RESIDUAL)[..., None, None]
    told = np.eye(normal.shape[-1]) + root @ np.swapaxes(root, -1, -2)
    return before @ np.linalg.inv(told) @ np.swapaxes(before, -1, -2)
