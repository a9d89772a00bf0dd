"""The paper's recipe: RMSProp on all samples."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import drjit as dr
import mitsuba as mi
import numpy as np

from ..analytic import parameters
from ..analytic.parameter_space import Space
from ..data.measurements import Measurements
from ..neural.enhanced_brdf import EnhancedBRDF
from ..system.progress import Callback, Progress, silent
from .analytic_fit import objective
from .objective import Objective

_EVERY = 50  # steps from report to report


def fit_rmsprop(
    brdf: EnhancedBRDF,
    measurements: Measurements,
    *,
    hold: Sequence[str] = (),
    n_steps: int = 1000,
    progress: Callback = silent,
) -> tuple[np.ndarray, float]:
    """Fit by the paper's recipe (sections 4.3 and 5.1), in the space in which roughness is a logarithm.

    The paper starts every material from the same values, those of :func:`mi_enhance.analytic.parameters.initial`.

    Returns
    -------
    array (P,), float
        Parameters and their loss.
    """
    from drjit.opt import RMSProp

    problem = objective(brdf, measurements)
    first = parameters.flatten(brdf.parameters, parameters.initial(brdf.parameters))
    optimizer = RMSProp(lr=1e-3, alpha=0.9, params={"u": mi.Float(problem.space.to_free(first).astype(np.float32))})

    def report(step, loss):
        if step % _EVERY == 0:
            progress(Progress("rmsprop", step, n_steps, {"loss": float(dr.mean(loss)[0])}))

    u = descend(problem, optimizer, Space(brdf.parameters, hold), n_steps, report)
    return problem.space.to_physical(u), float(problem.loss(u[None])[0])


def descend(problem: Objective, optimizer, space: Space, n_steps: int, callback: Callable) -> np.ndarray:
    """Take steps with gradients of all samples inside the box of `space`, and return the parameters, (P,).

    Parameters
    ----------
    problem : Objective
        Of one material.
    optimizer : drjit.opt.Optimizer
        Whose variable ``"u"`` holds the start.
    space : Space
    n_steps : int
    callback : callable
        ``callback(step, loss)`` after every step, with the loss of each sample before it.
    """
    low, high = (mi.Float(v.astype(np.float32)) for v in (space.low, space.high))
    for step in range(n_steps):
        flat = mi.Float(dr.detach(optimizer["u"]))
        dr.enable_grad(flat)
        loss, gradient = problem.gradient(flat)
        dr.set_grad(optimizer["u"], gradient)
        optimizer.step()
        optimizer["u"] = dr.clip(dr.detach(optimizer["u"]), low, high)
        callback(step, loss)
    return np.array(dr.detach(optimizer["u"]), np.float64)
