"""NBRDF, for comparison: trained on the same measurements, and evaluated in Dr.Jit.

So it renders through the same sampling as our materials (:func:`mi_enhance.bsdfs.function.function_bsdf`).
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping

import drjit as dr
import mitsuba as mi
import numpy as np

from ..data.directions import half_difference
from ..data.measurements import Measurements
from ..neural import baked
from .adam import Adam

_SHAPES = {"W1": (6, 21), "b1": (21,), "W2": (21, 21), "b2": (21,), "W3": (21, 3), "b3": (3,)}
_BATCH = 512
_MAX_Y = 20.0  # f = 5e8, far above any measurement


def train_nbrdf(
    measurements: Measurements,
    *,
    epochs: int = 400,
    learning_rate: float = 1e-2,
    min_steps: int = 10_000,
    seed: int = 0,
) -> tuple[dict, float]:
    """Train an NBRDF on all samples of one material: a 6-21-21-3 network, the published recipe in NumPy.

    As published: Cartesian half and difference vector in, ``exp(y) - 1`` out, mean of abs(log(1 + f cos)) differences,
    Adam, batches of 512, no validation set. Changed, because it helps: Adam starts at 1e-2 instead of 5e-4 and falls to
    0 like a cosine; 400 epochs instead of 100; initial weights as He et al. 2015 have them; values below 0 get a
    gradient while training (cut off, they would learn nothing); few samples get as many steps as 50 epochs of 1e5.

    Parameters
    ----------
    measurements : Measurements
    epochs : int
        Passes over the samples.
    learning_rate : float
        Of Adam at the start; 0 at the end.
    min_steps : int
        Where `epochs` are fewer steps than this, there are more epochs.
    seed : int
        Of weights and batches.

    Returns
    -------
    network : dict
        ``W1, b1, W2, b2, W3, b3``, float32: what :func:`mi_enhance.data.nbrdf.decode` takes.
    seconds : float

    References
    ----------
    Sztrajman, Rainer, Ritschel, Weyrich, "Neural BRDF Representation and Importance Sampling", 2021.

    Examples
    --------
    >>> from mi_enhance.data.synthetic import ggx_anisotropic
    >>> paint, _ = ggx_anisotropic(3, n_samples=600, noise=0)
    >>> network, seconds = train_nbrdf(paint, epochs=1, min_steps=10)
    >>> network["W2"].shape
    (21, 21)
    """
    start = time.perf_counter()
    rng = np.random.default_rng(seed)
    x, cos = nbrdf_features(measurements.wi, measurements.wo), measurements.wo[:, 2:]
    truth = np.log1p(measurements.f * cos)
    weights, network = _views()
    gradient, slots = _views()
    for name, share in (("W1", 2), ("W2", 2), ("W3", 0.1)):  # 0.1: starts near f = 0, as most of a material is
        network[name][:] = rng.normal(0, np.sqrt(share / len(network[name])), network[name].shape)
    n, batch = len(x), min(_BATCH, len(x))
    steps = max(epochs * (n // batch), min_steps)
    order, first = rng.permutation(n), 0
    adam = Adam({"weights": weights}, learning_rate, steps)
    while adam.step < steps:
        if first + batch > n:
            order, first = rng.permutation(n), 0
        part = order[first : first + batch]
        first += batch
        _backward(network, slots, x[part], cos[part], truth[part])
        adam.advance({"weights": gradient})
    return network, time.perf_counter() - start


def nbrdf_features(wi: np.ndarray, wo: np.ndarray) -> np.ndarray:
    """Return the inputs of an NBRDF, (N, 6) float32: half vector turned to phi_h = 0, difference vector."""
    theta_h, _, d = half_difference(wi, wo)
    return np.column_stack((np.sin(theta_h), np.zeros_like(theta_h), np.cos(theta_h), d)).astype(np.float32)


def _views() -> tuple[np.ndarray, dict]:
    """Return zeros for all weights: one vector, which Adam moves, and the matrices as views of it."""
    flat = np.zeros(sum(int(np.prod(shape)) for shape in _SHAPES.values()), np.float32)
    views, start = {}, 0
    for name, shape in _SHAPES.items():
        size = int(np.prod(shape))
        views[name] = flat[start : start + size].reshape(shape)
        start += size
    return flat, views


def _backward(w: dict, gradient: dict, x: np.ndarray, cos: np.ndarray, truth: np.ndarray) -> None:
    """Write the gradient of a batch's mean loss."""
    a1 = np.maximum(x @ w["W1"] + w["b1"], 0)
    a2 = np.maximum(a1 @ w["W2"] + w["b2"], 0)
    e = np.exp(np.minimum(a2 @ w["W3"] + w["b3"], _MAX_Y))
    v = np.maximum(1 + (e - 1) * cos, 1e-6)  # 1e-6: the logarithm stays finite where f is near -1 and cos near 1
    g = np.sign(np.log(v) - truth) * e * cos / (v * truth.size)
    d2 = (g @ w["W3"].T) * (a2 > 0)
    d1 = (d2 @ w["W2"].T) * (a1 > 0)
    for layer, a, d in (("3", a2, g), ("2", a1, d2), ("1", x, d1)):
        np.matmul(a.T, d, out=gradient["W" + layer])
        np.sum(d, axis=0, out=gradient["b" + layer])


def nbrdf_function(network: Mapping[str, np.ndarray], highest: float) -> Callable:
    """Return f(wi, wo) of an NBRDF in Dr.Jit, weights as constants of the compiled function.

    Parameters
    ----------
    network : dict
        As :func:`train_nbrdf` returns it.
    highest : float
        Largest value: far from its samples a network can overflow.

    Examples
    --------
    >>> from mi_enhance.data import nbrdf
    >>> names, networks = nbrdf.read_networks("mi_enhance/bundled/nbrdf/merl.npz")
    >>> f = nbrdf_function({k: w[0] for k, w in networks.items()}, 1e3)
    >>> f(mi.Vector3f(0, 0, 1), mi.Vector3f(0, 0.6, 0.8)).shape
    (3, 1)
    """
    layers = [(network[f"W{k}"].T, network[f"b{k}"].tolist()) for k in (1, 2, 3)]
    layers[0] = np.delete(layers[0][0], 1, 1), layers[0][1]  # the second input is 0

    def f(wi: mi.Vector3f, wo: mi.Vector3f) -> mi.Color3f:
        x = turned(wi, wo)
        for k, (w, b) in enumerate(layers):
            x = baked.affine(w, x if k == 0 else [dr.maximum(v, 0) for v in x], b)
        return mi.Color3f([dr.clip(dr.exp(v) - 1, 0, highest) for v in x])

    return f


def turned(wi: mi.Vector3f, wo: mi.Vector3f) -> list:
    """Return :func:`nbrdf_features` in Dr.Jit, without the second, which is 0."""
    h = dr.normalize(wi + wo)
    sin_h = dr.sqrt(dr.square(h.x) + dr.square(h.y))
    # where h is the normal, phi_h is 0 by definition
    c, s = (dr.select(sin_h > 0, v / sin_h, default) for v, default in ((h.x, 1), (h.y, 0)))
    u = c * wo.x + s * wo.y
    return [sin_h, h.z, h.z * u - sin_h * wo.z, c * wo.y - s * wo.x, sin_h * u + h.z * wo.z]
