"""Models that are not ours, made to fit the same measurements: NBRDF, a residual network, BSDFs of Mitsuba.

Each comes with an evaluator in Dr.Jit, so that it renders through the same sampling as ours
(:func:`mi_enhance.bsdfs.function.of_function`).
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping

import drjit as dr
import mitsuba as mi
import numpy as np

from .analytic import geometry
from .data.directions import half_difference
from .data.measurements import Measurements
from .material.material import Material
from .neural import baked
from .neural import inputs as inputs_module
from .specialization import distillation

# ---------------------------------------------------------------------- NBRDF

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
    >>> from mi_enhance import data
    >>> paint, _ = data.synthetic.ggx_anisotropic(3, n_samples=600, noise=0)
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
    mean, square = np.zeros_like(weights), np.zeros_like(weights)
    n, batch = len(x), min(_BATCH, len(x))
    steps = max(epochs * (n // batch), min_steps)
    order, first = rng.permutation(n), 0
    for step in range(steps):
        if first + batch > n:
            order, first = rng.permutation(n), 0
        part = order[first : first + batch]
        first += batch
        _backward(network, slots, x[part], cos[part], truth[part])
        # Kingma and Ba 2015, algorithm 1, with the corrections for the start in the rate
        mean += 0.1 * (gradient - mean)
        square += 0.001 * (gradient * gradient - square)
        rate = learning_rate * 0.5 * (1 + np.cos(np.pi * step / steps))
        rate *= np.sqrt(1 - 0.999 ** (step + 1)) / (1 - 0.9 ** (step + 1))
        weights -= np.float32(rate) * mean / (np.sqrt(square) + 1e-8)
    return network, time.perf_counter() - start


def nbrdf_features(wi: np.ndarray, wo: np.ndarray) -> np.ndarray:
    """Inputs of an NBRDF, (N, 6) float32: half vector turned to phi_h = 0, difference vector of the light."""
    theta_h, _, d = half_difference(wi, wo)
    return np.column_stack((np.sin(theta_h), np.zeros_like(theta_h), np.cos(theta_h), d)).astype(np.float32)


def _views() -> tuple[np.ndarray, dict]:
    """Zeros for all weights: one vector, which Adam moves, and the matrices as views of it."""
    flat = np.zeros(sum(int(np.prod(shape)) for shape in _SHAPES.values()), np.float32)
    views, start = {}, 0
    for name, shape in _SHAPES.items():
        size = int(np.prod(shape))
        views[name] = flat[start : start + size].reshape(shape)
        start += size
    return flat, views


def _backward(w: dict, gradient: dict, x, cos, truth) -> None:
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
    """f(wi, wo) of an NBRDF in Dr.Jit, weights as constants of the compiled function.

    Parameters
    ----------
    network : dict
        As :func:`train_nbrdf` returns it.
    highest : float
        Largest value: far from its samples a network can overflow.

    Examples
    --------
    >>> from mi_enhance.data import nbrdf
    >>> names, networks = nbrdf.read_networks("data/nbrdf/merl.npz")
    >>> f = nbrdf_function({k: w[0] for k, w in networks.items()}, 1e3)
    >>> f(mi.Vector3f(0, 0, 1), mi.Vector3f(0, 0.6, 0.8)).shape
    (3, 1)
    """
    layers = [(network[f"W{k}"].T, network[f"b{k}"].tolist()) for k in (1, 2, 3)]
    layers[0] = np.delete(layers[0][0], 1, 1), layers[0][1]  # the second input is 0

    def f(wi, wo):
        h = dr.normalize(wi + wo)
        sin_h = dr.sqrt(dr.square(h.x) + dr.square(h.y))
        # where h is the normal, phi_h is 0 by definition
        c, s = (dr.select(sin_h > 0, v / sin_h, default) for v, default in ((h.x, 1), (h.y, 0)))
        u = c * wo.x + s * wo.y
        d = h.z * u - sin_h * wo.z, c * wo.y - s * wo.x, sin_h * u + h.z * wo.z
        x = [sin_h, h.z, *d]
        for k, (w, b) in enumerate(layers):
            x = baked.affine(w, x if k == 0 else [dr.maximum(v, 0) for v in x], b)
        return mi.Color3f([dr.clip(dr.exp(v) - 1, 0, highest) for v in x])

    return f


# ---------------------------------------------------------------------- a residual network

_RESIDUAL_HIDDEN = (16, 16)
_RESIDUAL_SAMPLES = 16_384
_DEAD = 0.01  # slope below 0, where f is cut off: a sample there must still be able to come back


def train_residual(lobe: Material, measurements: Measurements, *, seed: int = 0) -> tuple[list, float]:
    """Train what the fitted analytic `lobe` lacks as a small network of this material, added to it and cut off at 0.

    The obvious alternative to ours (the paper's Fig. 8), here with a network of its own for each material, which
    favours it: the same inputs, sizes and optimiser as :func:`mi_enhance.specialization.specialize`.

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
    inputs = _inputs(lobe, *(mi.Vector3f(np.ascontiguousarray(w.T)) for w in (wi, wo)))
    x = np.stack([np.array(v + dr.zeros(mi.Float, len(wi)), np.float64) for v in inputs], 1)
    mean, std = x.mean(0), x.std(0) + 1e-6  # 1e-6: an input that is constant for this material

    def residuals(y, index):
        f = base[index] + y
        slope = np.where(f > 0, 1, _DEAD)
        v = np.maximum(f, _DEAD * np.maximum(f, -10)) * cos[index]
        r = np.log1p(np.maximum(v, -0.9)) - np.log1p(truth[index] * cos[index])  # -0.9: a finite logarithm
        d = slope * cos[index] / (1 + np.maximum(v, -0.9))
        return r / 3, d[:, :, None] * np.eye(3) / 3

    layers = distillation.first((x.shape[1], *_RESIDUAL_HIDDEN, 3), np.zeros(3), rng)
    layers, _ = distillation.train(layers, (x - mean) / std, residuals, steps=60)
    return distillation.on_raw_inputs(layers, mean, std), time.perf_counter() - start


def residual_function(lobe: Material, layers: list) -> Callable:
    """f(wi, wo) of `lobe` and the network of :func:`train_residual` in Dr.Jit."""
    params = lobe.lanes()
    dr.make_opaque(params)

    def f(wi, wo):
        return dr.maximum(lobe.brdf(wi, wo, params) + mi.Color3f(baked.dense(layers, _inputs(lobe, wi, wo, params))), 0)

    return f


def _inputs(lobe: Material, wi, wo, params: Mapping | None = None) -> list:
    """The features that :func:`mi_enhance.specialization.specialize` uses, with those that tell viewer from light."""
    params = {**(params or lobe.lanes()), "asymmetry": mi.Float(1)}
    local_i, local_o, _ = geometry.local_directions(wi, wo, params)
    named = inputs_module.named({**geometry.quantities(local_i, local_o), **params})
    return [named[name] for name in ("sin2_h", "lobe", "cos_d", "product", "log_product", "sin_d", "difference")]


# ---------------------------------------------------------------------- BSDFs of Mitsuba

# Parameters and their bounds. A parameter that is 0 when the plugin is made is left out for good: starts are inside.
MITSUBA = {
    "roughconductor": {"alpha": (1e-3, 1, 1), "specular_reflectance": (0, 1, 3)},
    "principled": {
        "base_color": (0, 1, 3),
        "roughness": (0.02, 1, 1),
        "metallic": (0, 1, 1),
        "specular": (0.01, 1, 1),
        "spec_tint": (0, 1, 1),
        "sheen": (0, 1, 1),
        "sheen_tint": (0, 1, 1),
        "clearcoat": (0, 1, 1),
        "clearcoat_gloss": (0, 1, 1),
    },
}
_MITSUBA_SAMPLES = 4096
_ROUGH = (0.1, 0.3, 0.6)  # roughness of the starts


def fit_mitsuba(plugin: str, measurements: Measurements, *, seed: int = 0) -> tuple[dict, float]:
    """Fit a BSDF of Mitsuba to measurements: SciPy's bounded least squares, several starts, the same loss (soft L1).

    Parameters
    ----------
    plugin : str
        A key of `MITSUBA`.
    measurements : Measurements
    seed : int
        Of the samples that are used.

    Returns
    -------
    dict
        For ``mi.load_dict``.
    seconds : float
    """
    from scipy.optimize import least_squares

    start = time.perf_counter()
    bounds = MITSUBA[plugin]
    low, high = (np.concatenate([np.full(n, b[k], float) for *b, n in bounds.values()]) for k in (0, 1))
    index = np.random.default_rng(seed).permutation(len(measurements.f))[:_MITSUBA_SAMPLES]
    wi, wo = (mi.Vector3f(np.ascontiguousarray(w[index].T)) for w in (measurements.wi, measurements.wo))
    truth = np.log1p(measurements.f[index] * measurements.wo[index, 2:])
    si = mi.SurfaceInteraction3f()
    si.wi = wi
    bsdf = mi.load_dict(_plugin(plugin, 0.5 * (low + high)))
    params = mi.traverse(bsdf)

    def residuals(u):
        for key, value in _values(plugin, u).items():
            name = f"{key}.value" if f"{key}.value" in params else key
            params[name] = value if np.ndim(value) else float(value)
        params.update()
        value = np.array(bsdf.eval(mi.BSDFContext(), si, wo), np.float64).T  # with the cosine
        return (np.log1p(np.maximum(np.nan_to_num(value), 0)) - truth).ravel()

    best = None
    for rough in _ROUGH:
        first = _values(plugin, 0.5 * (low + high))
        first["roughness" if "roughness" in first else "alpha"] = rough
        u = np.clip(np.concatenate([np.ravel(v) for v in first.values()]), low + 1e-3, high - 1e-3)
        # 1e-3: float32 values change by 1e-7 of themselves; smaller steps would differentiate rounding
        found = least_squares(
            residuals, u, bounds=(low, high), loss="soft_l1", f_scale=0.01, diff_step=1e-3, max_nfev=25
        )
        error = np.abs(found.fun).mean()
        best = min(best, (error, found.x), key=lambda t: t[0]) if best else (error, found.x)
    return _plugin(plugin, best[1]), time.perf_counter() - start


def _values(plugin: str, u: np.ndarray) -> dict:
    """Parameters by name; a single number, or three of a colour."""
    result, k = {}, 0
    for name, (_, _, n) in MITSUBA[plugin].items():
        result[name] = float(u[k]) if n == 1 else [float(v) for v in u[k : k + n]]
        k += n
    return result


def _plugin(plugin: str, u: np.ndarray) -> dict:
    values = {k: {"type": "rgb", "value": v} if isinstance(v, list) else v for k, v in _values(plugin, u).items()}
    extra = {"distribution": "ggx", "material": "none"} if plugin == "roughconductor" else {}
    return {"type": plugin, **extra, **values}
