"""The hybrid of :mod:`mi_enhance.benchmark.hybrid` fitted to one material, and evaluated in Dr.Jit."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from ..data.measurements import Measurements
from ..material.material import Material
from ..neural import baked
from ..system import npz
from ..system.bundled_files import rival_file
from .hybrid import HIGH, LOW, SHAPES, Batch, analytic, combined, evaluate, forward, inputs_of, slope_of, start_from_ggx
from .nbrdf import turned

N_NUMBERS = len(LOW)
N_WEIGHTS = sum(int(np.prod(shape)) for shape in SHAPES.values())
# what the first layer makes of the latent numbers is a constant of the material
MULTIPLY_ADDS = sum(int(np.prod(SHAPES[name])) for name in ("W1", "W2", "W3")) - 4 * 32
_OF_GGX = ("rho_d", "rho_s", "F0", "alpha_x", "alpha_y")
_STARTS, _LOOK, _FIRST, _LAST = 5, 256, 1024, 8192  # training materials to start from; samples of each stage


def read_network(file: Path | None = None) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Return weights and the numbers of the training materials, (M, 12), float64; the bundled ones by default."""
    file = file or rival_file("hybrid.npz")
    where = f'network of the hybrid "{file}"'
    stored = npz.read(file, [*SHAPES, "u"], where)
    weights = {name: npz.numbers(stored, name, shape, where).astype(np.float64) for name, shape in SHAPES.items()}
    return weights, npz.numbers(stored, "u", (len(stored["u"]), N_NUMBERS), where).astype(np.float64)


def fit_hybrid(lobe: Material, measurements: Measurements, *, seed: int = 0) -> tuple[np.ndarray, float]:
    """Fit the twelve numbers of a material: SciPy's bounded least squares, several starts, the same loss (soft L1).

    Parameters
    ----------
    lobe : Material
        GGX, fitted to the same samples: one of the starts, beside the training materials that are nearest.
    measurements : Measurements
    seed : int
        Of the samples that are used.

    Returns
    -------
    u : array (12,)
    seconds : float
        Without the fit of `lobe`.
    """
    begun = time.perf_counter()
    network, library = read_network()
    order = np.random.default_rng(seed).permutation(len(measurements.f))

    def samples(n: int) -> tuple[Batch, np.ndarray]:
        index = order[:n]
        wi, wo, f = (a[index].astype(np.float64) for a in (measurements.wi, measurements.wo, measurements.f))
        return Batch.of(wi, wo), np.log1p(f * wo[:, 2:])

    batch, truth = samples(_LOOK)
    look = [np.abs(np.log1p(evaluate(network, batch, u[None]) * batch.cos) - truth).mean() for u in library]
    starts = [start_of(lobe.params), *library[np.argsort(look)[:_STARTS]]]
    found = [_least_squares(network, *samples(_FIRST), u, 15) for u in starts]
    u, _ = _least_squares(network, *samples(_LAST), min(found, key=lambda pair: pair[1])[0], 30)
    return u, time.perf_counter() - begun


def start_of(params: Mapping) -> np.ndarray:
    """Return the numbers (12,) that are nearest to the parameters of a GGX material."""
    rho_d, rho_s, F0, alpha_x, alpha_y = (np.atleast_2d(params[k]) for k in _OF_GGX)
    return start_from_ggx(rho_d, rho_s, F0, np.concatenate([alpha_x, alpha_y], 1))[0]


def _least_squares(
    network: Mapping, batch: Batch, truth: np.ndarray, u: np.ndarray, evaluations: int
) -> tuple[np.ndarray, float]:
    """Return the numbers found and their mean error."""
    from scipy.optimize import least_squares

    def residuals(u: np.ndarray) -> np.ndarray:
        return (np.log1p(evaluate(network, batch, u[None]) * batch.cos) - truth).ravel()

    def jacobian(u: np.ndarray) -> np.ndarray:
        core, slopes = analytic(batch, u[None])
        y, (z1, z2) = forward(network, inputs_of(batch, u[None]))
        f, added, gate = combined(y, core)
        columns = list(np.moveaxis(gate[:, :, None] * slopes, 2, 0))
        for row in network["W1"][6:]:
            dy = ((slope_of(z1) * row) @ network["W2"] * slope_of(z2)) @ network["W3"]
            columns.append(added * dy[:, :3] + core * gate * (1 - gate) * dy[:, 3:])
        return (np.stack(columns, 2) * (batch.cos / (1 + f * batch.cos))[:, :, None]).reshape(-1, N_NUMBERS)

    inside = np.clip(u, LOW + 1e-6, HIGH - 1e-6)  # SciPy starts strictly inside of the bounds
    found = least_squares(
        residuals, inside, jacobian, bounds=(LOW, HIGH), loss="soft_l1", f_scale=0.01, max_nfev=evaluations
    )
    return found.x, float(np.abs(found.fun).mean())


def hybrid_function(network: Mapping[str, np.ndarray], u: np.ndarray) -> Callable:
    """Return f(wi, wo) in Dr.Jit, weights as constants of the compiled function.

    Examples
    --------
    >>> network, library = read_network()
    >>> hybrid_function(network, library[0])(mi.Vector3f(0, 0, 1), mi.Vector3f(0, 0.6, 0.8)).shape
    (3, 1)
    """
    layers = [(network[f"W{k}"].T, network[f"b{k}"].tolist()) for k in (1, 2, 3)]
    w, b = layers[0]
    layers[0] = np.delete(w[:, :6], 1, 1), (b + w[:, 6:] @ u[8:]).tolist()  # the second input is 0
    diffuse, eta = np.exp(u[:3]) / np.pi, 1 + np.exp(u[3:6])
    alpha = [float(v) for v in np.exp(u[6:8])]

    def activation(z: Any) -> Any:
        return z * dr.clip(dr.fma(z, 1 / 3, 0.5), 0, 1)

    def f(wi: mi.Vector3f, wo: mi.Vector3f) -> mi.Color3f:
        x: list = turned(wi, wo)
        for k, (w, b) in enumerate(layers):
            x = baked.affine(w, x if k == 0 else [activation(v) for v in x], b)
        core = diffuse_and_ggx(wi, wo)
        return mi.Color3f([dr.exp(dr.minimum(x[k], 15)) + core[k] / (1 + dr.exp(-x[k + 3])) for k in range(3)])

    def diffuse_and_ggx(wi: mi.Vector3f, wo: mi.Vector3f) -> list:
        h = wi + wo
        length = dr.norm(h)
        h /= length
        s = dr.square(h.x / alpha[0]) + dr.square(h.y / alpha[1]) + dr.square(h.z)
        value = 1 / (4 * dr.pi * alpha[0] * alpha[1] * dr.square(s) * wi.z * wo.z)
        for v in (wi, wo):
            tan2 = (dr.square(alpha[0] * v.x) + dr.square(alpha[1] * v.y)) / dr.square(v.z)
            value *= 2 / (1 + dr.sqrt(1 + tan2))
        c = dr.minimum(length / 2, 1)
        result = []
        for rho, n in zip(diffuse.tolist(), eta.tolist(), strict=True):
            g = dr.sqrt(n * n - 1 + dr.square(c))
            rs, rp = (c - g) / (c + g), (n * n * c - g) / (n * n * c + g)
            result.append(rho + value * (dr.square(rs) + dr.square(rp)) / 2)
        return result

    return f
