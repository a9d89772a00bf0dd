"""The paper's recipe: RMSProp on all samples."""

from __future__ import annotations

from collections.abc import Callable

import drjit as dr
import mitsuba as mi
import numpy as np

from ..analytic import parameter_space, parameters
from .analytic_fit import objective
from .objective import Objective


def _rmsprop(
    brdf, measurements, starts, rng, callback, library=None, known=None, *, hold=(), epochs=1000
) -> tuple[np.ndarray, float]:
    """The paper's recipe (sections 4.3 and 5.1), in the space in which roughness is a logarithm."""
    from drjit.opt import RMSProp

    del starts, rng, library, known  # the paper starts every material from the same values
    problem = objective(brdf, measurements)
    first = parameters.flatten(brdf.parameters, parameters.initial(brdf.parameters))
    optimizer = RMSProp(lr=1e-3, alpha=0.9, params={"u": mi.Float(problem.space.to_free(first).astype(np.float32))})

    def report(step, loss):
        if step % 50 == 0:
            callback("rmsprop", step, float(dr.mean(loss)[0]))

    u = descend(problem, optimizer, parameter_space.Space(brdf.parameters, hold), epochs, report)
    return problem.space.to_physical(u), float(problem.loss(u[None])[0])


def descend(problem: Objective, optimizer, space: parameter_space.Space, steps: int, callback: Callable) -> np.ndarray:
    """Take steps with gradients of all samples inside the box of `space`, and return the parameters, (P,).

    Parameters
    ----------
    problem : Objective
        Of one material.
    optimizer : drjit.opt.Optimizer
        Whose variable ``"u"`` holds the start.
    space : parameters.Space
    steps : int
    callback : callable
        ``callback(step, loss)`` after every step, with the loss of each sample before it.
    """
    low, high = (mi.Float(v.astype(np.float32)) for v in (space.low, space.high))
    for step in range(steps):
        flat = mi.Float(dr.detach(optimizer["u"]))
        dr.enable_grad(flat)
        loss, gradient = problem.gradient(flat)
        dr.set_grad(optimizer["u"], gradient)
        optimizer.step()
        optimizer["u"] = dr.clip(dr.detach(optimizer["u"]), low, high)
        callback(step, loss)
    return np.array(dr.detach(optimizer["u"]), np.float64)
