"""Loss and cost of a candidate."""

from __future__ import annotations

import time

import drjit as dr
import mitsuba as mi
import numpy as np

from ..analytic import parameter_space, parameters
from ..fitting.objective import Objective
from ..neural.enhanced_brdf import EnhancedBRDF
from ..training.training_set import TrainingSet, first_samples

_JUDGED_AT_ONCE = 1 << 19  # lanes: bounds the memory of a judgement


def judge(brdf: EnhancedBRDF, values: np.ndarray, samples: TrainingSet) -> float:
    """Return the mean loss (eq. 1) of materials with parameters (M, P); infinite where it is not a number."""
    n, space = samples.n_samples, parameter_space.Space(brdf.parameters)
    at_once = max(1, _JUDGED_AT_ONCE // n)
    losses = []
    for first in range(0, len(values), at_once):
        part = slice(first, first + at_once)
        losses.append(Objective(brdf, *first_samples(samples, n, part), n).loss(space.to_free(values[part])))
    mean = float(np.concatenate(losses).mean())
    return mean if np.isfinite(mean) else float("inf")


def cost(brdf: EnhancedBRDF, values: np.ndarray, how: str) -> float:
    """Return the cost of one evaluation: thousands of multiply-adds, or (``"measured"``) nanoseconds."""
    if how == "multiply-adds":
        return brdf.multiply_adds / 1000
    n = 1 << 18
    rng = np.random.default_rng(0)
    wi, wo = (mi.warp.square_to_uniform_hemisphere(mi.Point2f(rng.random((2, n)).astype(np.float32))) for _ in "io")
    row = [mi.Float(float(v)) for v in values[0]]
    dr.make_opaque(row, wi, wo)
    seconds = []
    for _ in range(7):
        begun = time.perf_counter()
        dr.eval(brdf(wi, wo, parameters.unflatten(brdf.parameters, row)))
        dr.sync_thread()
        seconds.append(time.perf_counter() - begun)
    return float(np.median(seconds[2:])) / n * 1e9
