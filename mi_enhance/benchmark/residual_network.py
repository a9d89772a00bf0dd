"""A network added to an analytic lobe, for comparison."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping

import drjit as dr
import mitsuba as mi
import numpy as np

from ..analytic import geometry
from ..data.measurements import Measurements
from ..material.material import Material
from ..neural import baked
from ..neural import inputs as inputs_module
from ..numerics.arrays import vector3f
from ..specialization import distillation

_RESIDUAL_HIDDEN = (16, 16)
_RESIDUAL_SAMPLES = 16_384
_DEAD = 0.01  # slope below 0, where f is cut off: a sample there must still be able to come back


def train_residual(lobe: Material, measurements: Measurements, *, seed: int = 0) -> tuple[list, float]:
    """Train what the fitted analytic `lobe` lacks as a small network of this material, added to it and cut off at 0.

    The obvious alternative to ours (the paper's Fig. 8), here with a network of its own for each material, which
    favours it: the same inputs, sizes and optimizer as :func:`mi_enhance.specialization.specialize`.

    Returns
    -------
    layers : list of (W, b)
        For :func:`residual_function`.
    seconds : float
    """
    start = time.perf_counter()
    rng = np.random.default_rng(seed)
    index = rng.permutation(len(measurements.f))[:_RESIDUAL_SAMPLES]
    wi, wo, truth = measurements.wi[index], measurements.wo[index], measurements.f[index].astype(np.float64)
    cos, base = wo[:, 2:].astype(np.float64), lobe.evaluate(wi, wo).astype(np.float64)
    inputs = _inputs(lobe, vector3f(wi), vector3f(wo))
    x = np.stack([np.array(v + dr.zeros(mi.Float, len(wi)), np.float64) for v in inputs], 1)
    mean, std = x.mean(0), x.std(0) + 1e-6  # 1e-6: an input that is constant for this material

    def residuals(y: np.ndarray, index: slice) -> tuple[np.ndarray, np.ndarray]:
        f = base[index] + y
        slope = np.where(f > 0, 1, _DEAD)
        v = np.maximum(f, _DEAD * np.maximum(f, -10)) * cos[index]
        r = np.log1p(np.maximum(v, -0.9)) - np.log1p(truth[index] * cos[index])  # -0.9: a finite logarithm
        d = slope * cos[index] / (1 + np.maximum(v, -0.9))
        return r / 3, d[:, :, None] * np.eye(3) / 3

    first = distillation.first((x.shape[1], *_RESIDUAL_HIDDEN, 3), np.zeros(3), rng)
    layers, _ = distillation.train(first, (x - mean) / std, residuals, steps=60)
    return distillation.on_raw_inputs(layers, mean, std), time.perf_counter() - start


def residual_function(lobe: Material, layers: list) -> Callable:
    """f(wi, wo) of `lobe` and the network of :func:`train_residual` in Dr.Jit."""
    params = lobe.as_drjit()
    dr.make_opaque(params)

    def f(wi: mi.Vector3f, wo: mi.Vector3f) -> mi.Color3f:
        return dr.maximum(lobe.brdf(wi, wo, params) + mi.Color3f(baked.dense(layers, _inputs(lobe, wi, wo, params))), 0)

    return f


def _inputs(lobe: Material, wi: mi.Vector3f, wo: mi.Vector3f, params: Mapping | None = None) -> list:
    """Return the features that `specialize` uses, with those that tell viewer from light."""
    params = {**(params or lobe.as_drjit()), "asymmetry": mi.Float(1)}
    local_i, local_o, _ = geometry.local_directions(wi, wo, params)
    named = inputs_module.named({**geometry.quantities(local_i, local_o), **params})
    return [named[name] for name in ("sin2_h", "lobe", "cos_d", "product", "log_product", "sin_d", "difference")]
