"""Between NumPy rows and Dr.Jit lanes, for the tests."""

from __future__ import annotations

import mi_enhance  # noqa: F401  (before mitsuba)

import mitsuba as mi  # isort: skip
import numpy as np

from mi_enhance.neural.trainable import fused


def vectors(w):
    """(N, 3) to mi.Vector3f."""
    return mi.Vector3f(np.ascontiguousarray(np.asarray(w, np.float32).T))


def floats(x):
    """(N, C) to C arrays of N lanes."""
    return [mi.Float(np.ascontiguousarray(column, np.float32)) for column in np.asarray(x).T]


def parameters(p):
    """Dictionary of (N, size) to the dictionary an EnhancedBRDF takes."""
    result = {}
    for name, v in p.items():
        columns = floats(v)
        result[name] = columns[0] if len(columns) == 1 else mi.Color3f(*columns) if len(columns) == 3 else columns
    return result


def evaluate(brdf, wi, wo, p, evaluators=None):
    """f_r as an array (N, 3), float64, with parameters of each lane; ``Material.evaluate`` has one set for all."""
    evaluators = fused(brdf.networks) if evaluators is None else evaluators
    f = brdf(vectors(wi), vectors(wo), parameters(p), evaluators)
    return np.array(f, np.float64).T
