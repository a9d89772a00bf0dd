"""Initial weights: each module first learns the term or operator that it replaces."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any, cast

import drjit as dr
import mitsuba as mi
import numpy as np
from drjit.opt import Adam

from ..analytic import geometry, parameters
from ..data.directions import sample_pairs
from ..neural.enhanced_brdf import EnhancedBRDF
from ..neural.evaluator import Evaluators
from ..neural.trainable import Trainable
from ..numerics.arrays import vector3f
from ..numerics.schedules import cosine_decay
from ..system.progress import Callback, Progress, silent


def imitate(
    brdf: EnhancedBRDF,
    *,
    steps: int = 1000,
    batch: int = 8192,
    seed: int = 0,
    lr: float = 5e-3,
    progress: Callback = silent,
) -> EnhancedBRDF:
    """Teach each module the term or operator it replaces, so that training starts where the analytic model is.

    Parameters
    ----------
    brdf : EnhancedBRDF
        The imitation starts from its modules.
    steps, batch : int
        Random pairs of directions, each with random parameters, per step.
    seed : int
        Of directions and parameters.
    lr : float
        Learning rate, falling to 0 along a cosine.
    progress : callable
        Hears of every step, see :mod:`mi_enhance.system.progress`.

    Returns
    -------
    EnhancedBRDF
        With modules close to the original terms.
    """
    rng = np.random.default_rng(seed)
    trainable = Trainable(brdf.modules)
    optimizer = Adam(lr=lr, params={"weights": trainable.weights})
    for step in range(steps):
        wi, wo = (vector3f(w) for w in sample_pairs(batch, seed=rng))
        params = parameters.unflatten(brdf.parameters, [mi.Float(v) for v in _random(brdf.parameters, batch, rng)])
        loss = imitation_error(brdf, wi, wo, params, trainable)
        dr.backward(loss)
        dr.set_grad(optimizer["weights"], trainable.gradient())
        optimizer.set_learning_rate(lr * cosine_decay(step, steps, low=0))
        optimizer.step()
        trainable.weights = cast(mi.Float, optimizer["weights"])
        progress(Progress("imitate", step + 1, steps))
    return dataclasses.replace(brdf, modules=trainable.modules())


def imitation_error(brdf: EnhancedBRDF, wi: Any, wo: Any, params: Mapping, evaluators: Evaluators) -> Any:
    """Compute the mean squared difference of the logarithms of each module and the term or operator it replaces.

    Same arguments as a call of `brdf`; the operands of an operator are those of the analytic model.
    """
    frame = geometry.frame_of(params)
    up = mi.Vector3f(0, 0, 1)
    local_i, local_o = (dr.select(v.z > 0.01, v, up) for v in (frame.to_local(wi), frame.to_local(wo)))
    record = {**geometry.quantities(local_i, local_o), **params}
    functions = brdf.replacements(record, wi, wo, evaluators, brdf.fold(params, evaluators))
    # 1e-3: a Fresnel term or an albedo below it is dark; its logarithm need not be met
    log = lambda v: dr.log(v + 1e-3)  # noqa: E731
    error: Any = 0
    for slot in brdf.modules:
        node = brdf.model.graph.find(slot)
        value = functions[slot](*(a(record) for a in node.args)) if node.args else functions[slot](record)
        error += dr.mean(dr.square(log(value) - log(node(record))), axis=None)
    return error


def _random(space, n: int, rng: np.random.Generator) -> np.ndarray:
    """Random parameter vectors, (P, n): uniform (log-uniform where optimized so); neural ones as they start."""
    rows = []
    for p in space:
        for _ in range(p.size):
            if p.fixed or p.is_neural:
                # These stay: a module must not learn to ignore them, since materials differ in them.
                row = np.full(n, p.initial)
            elif p.log:
                row = np.exp(rng.uniform(np.log(max(p.low, 3e-3)), np.log(p.high), n))
            else:
                row = rng.uniform(p.low, p.high, n)
            rows.append(row)
    return np.asarray(rows, np.float32)
