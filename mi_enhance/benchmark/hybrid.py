"""The hybrid of a GGX lobe and a small shared network of 2026, for comparison: its form, trained by us.

f = exp(a) + sigmoid(b) * (diffuse + GGX): a network 10-32-32-6 for all materials returns a colour to add and a gate for
each channel. A material is 12 numbers: diffuse albedo, index of refraction for each channel, two roughnesses, four
latent numbers. Our reading where the description is silent: the inputs are NBRDF's (half vector turned to phi_h = 0,
difference vector) and the latent numbers; the activation is x clip(x / 3 + 1/2, 0, 1); the loss is eq. 1 on f alone.
Everything is NumPy, with a hand-written backward pass; a render evaluates it in Dr.Jit.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..system.files import replacing
from ..system.progress import Callback, Progress, silent
from ..training.training_set import TrainingSet
from .adam import Adam
from .nbrdf import nbrdf_features

SHAPES = {"W1": (10, 32), "b1": (32,), "W2": (32, 32), "b2": (32,), "W3": (32, 6), "b3": (6,)}
N_LATENT = 4
# Of the numbers of a material: log albedo, log (eta - 1), log alpha, latent. eta 1.05 to 55 is F0 0.0006 to 0.93.
LOW = np.array([-9.0] * 3 + [-3.0] * 3 + [np.log(0.003)] * 2 + [-9.0] * N_LATENT)
HIGH = np.array([0.7] * 3 + [4.0] * 3 + [0.0] * 2 + [9.0] * N_LATENT)
_FIRST_BIAS = (-5.0, 4.0)  # of a and b: at first little is added, and GGX passes the gate
_MAX_A = 15.0  # f = 3e6: the exponential stays finite
_SAVES = 8  # checkpoints of a training


class Batch(NamedTuple):
    """Geometry of N samples."""

    features: np.ndarray  # (N, 6) inputs of the network
    h2: np.ndarray  # (N, 3) squares of the half vector
    slopes: np.ndarray  # (N, 2, 2) squares of x / z and y / z, of both directions
    cos_d: np.ndarray  # (N,)
    product: np.ndarray  # (N,) 4 cos_i cos_o
    cos: np.ndarray  # (N, 1) of the light

    @staticmethod
    def of(wi: np.ndarray, wo: np.ndarray) -> Batch:
        """Return what the model needs of pairs of directions (N, 3)."""
        h = wi + wo
        length = np.linalg.norm(h, axis=1)
        pair = np.stack([wi, wo], 1)
        return Batch(
            nbrdf_features(wi, wo),
            (h / length[:, None]) ** 2,
            (pair[:, :, :2] / pair[:, :, 2:]) ** 2,
            np.minimum(length / 2, 1),
            4 * wi[:, 2] * wo[:, 2],
            wo[:, 2:],
        )


def analytic(batch: Batch, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return diffuse + GGX with a dielectric's exact Fresnel term, (N, 3), and its derivatives by u[:8], (N, 3, 8).

    Parameters
    ----------
    u : array (N, 12) or (1, 12)
        Numbers of the material of each sample, as bounded by `LOW` and `HIGH`.
    """
    diffuse = np.exp(u[:, :3]) / np.pi
    eta = 1 + np.exp(u[:, 3:6])
    a2 = np.exp(2 * u[:, 6:8])
    part = batch.h2[:, :2] / a2
    s = part.sum(1) + batch.h2[:, 2]
    D = 1 / (np.pi * np.sqrt(a2[:, 0] * a2[:, 1]) * s**2)
    tan2 = batch.slopes * a2[:, None]
    r = np.sqrt(1 + tan2.sum(2))
    G = np.prod(2 / (1 + r), axis=1)
    log_slope = -1 + 4 * part / s[:, None] - (tan2 / (r * (1 + r))[:, :, None]).sum(1)
    # Fresnel: g is the cosine inside times the index
    c = batch.cos_d[:, None]
    g, v = np.sqrt(eta**2 - 1 + c**2), eta**2 * c
    rs, rp = (c - g) / (c + g), (v - g) / (v + g)
    dg, dv = eta / g, 2 * eta * c
    F = (rs**2 + rp**2) / 2
    dF = rs * -2 * c * dg / (c + g) ** 2 + rp * 2 * (g * dv - v * dg) / (v + g) ** 2
    lobe = (D * G / batch.product)[:, None]
    value = diffuse + lobe * F
    slope = np.zeros((*value.shape, 8), value.dtype)
    for k in range(3):
        slope[:, k, k] = diffuse[..., k]
        slope[:, k, 3 + k] = lobe[:, 0] * dF[:, k] * (eta[..., k] - 1)
    slope[:, :, 6:8] = (lobe * F)[:, :, None] * log_slope[:, None, :]
    return value, slope


def evaluate(network: Mapping[str, np.ndarray], batch: Batch, u: np.ndarray) -> np.ndarray:
    """Return f (N, 3) of materials with numbers `u`, (N, 12) or (1, 12)."""
    y, _ = forward(network, inputs_of(batch, u))
    return combined(y, analytic(batch, u)[0])[0]


def train_hybrid(
    samples: TrainingSet,
    start: np.ndarray,
    checkpoint: Path,
    *,
    steps: int = 20_000,
    per_material: int = 16,
    learning_rate: float = 5e-3,
    seed: int = 0,
    progress: Callback = silent,
) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Train the network and the numbers of all materials with Adam, or go on from a checkpoint.

    Parameters
    ----------
    samples : TrainingSet
    start : array (M, 12)
        Numbers of the materials to start from, see :func:`start_from_ggx`.
    checkpoint : Path
        ``.npz``, written eight times.
    steps, per_material : int
        One step sees so many samples of every material.
    learning_rate : float
        Falls to 0 along a cosine.
    seed : int
    progress : callable
        Hears of every step, with its ``loss`` (eq. 1).

    Returns
    -------
    network : dict of str to array
    u : array (M, 12)
    """
    rng = np.random.default_rng(seed)
    values = {name: np.zeros(shape, np.float32) for name, shape in SHAPES.items()}
    for name, share in (("W1", 2), ("W2", 2), ("W3", 0.1)):
        values[name][:] = rng.normal(0, np.sqrt(share / len(values[name])), values[name].shape)
    values["b3"][:] = np.repeat(_FIRST_BIAS, 3)
    values["u"] = np.clip(start, LOW, HIGH).astype(np.float32)
    adam = Adam(values, learning_rate, steps, warm_up=200)
    if checkpoint.exists():
        with np.load(checkpoint, allow_pickle=False) as stored:
            adam.resume(stored)
    data = samples.samples.reshape(9, len(samples.names), samples.n_samples)
    while adam.step < steps:
        index = np.random.default_rng((seed, adam.step)).integers(0, samples.n_samples, per_material)
        rows = data[:, :, index].reshape(9, -1)
        loss, gradient = _backward(values, Batch.of(rows[:3].T, rows[3:6].T), rows[6:].T, per_material)
        adam.advance(gradient)
        np.clip(values["u"], LOW, HIGH, out=values["u"])
        if adam.step % max(1, steps // _SAVES) == 0 or adam.step == steps:
            checkpoint.parent.mkdir(parents=True, exist_ok=True)
            with replacing(checkpoint) as temporary:
                np.savez(temporary, **adam.state())
        progress(Progress("train the hybrid", adam.step, steps, {"loss": loss}))
    return {name: values[name] for name in SHAPES}, values["u"]


def start_from_ggx(rho_d: np.ndarray, rho_s: np.ndarray, F0: np.ndarray, alpha: np.ndarray) -> np.ndarray:
    """Return the numbers (M, 12) of fitted GGX materials: their reflectance at normal incidence decides the index.

    Parameters
    ----------
    rho_d, rho_s : array (M, 3)
    F0 : array (M, 1) or (M, 3)
    alpha : array (M, 2)
    """
    root = np.sqrt(np.clip(rho_s * F0, 1e-3, 0.92))  # what an index within the bounds can reflect
    eta = (1 + root) / (1 - root)
    # 1e-4: black has no logarithm
    u = np.concatenate([np.log(np.maximum(rho_d, 1e-4)), np.log(eta - 1), np.log(alpha), np.zeros((len(alpha), 4))], 1)
    return np.clip(u, LOW, HIGH)


# ---------------------------------------------------------------------- forward and backward


def inputs_of(batch: Batch, u: np.ndarray) -> np.ndarray:
    """Return the inputs of the network, (N, 10)."""
    latent = np.broadcast_to(u[:, 8:], (len(batch.features), N_LATENT))
    return np.concatenate([batch.features, latent], 1)


def forward(w: Mapping[str, np.ndarray], x: np.ndarray) -> tuple[np.ndarray, list[np.ndarray]]:
    """Return the output (N, 6) and the values before each activation."""
    z1 = x @ w["W1"] + w["b1"]
    z2 = _activation(z1) @ w["W2"] + w["b2"]
    return _activation(z2) @ w["W3"] + w["b3"], [z1, z2]


def _activation(z: np.ndarray) -> np.ndarray:
    return z * np.clip(z / 3 + 0.5, 0, 1)


def slope_of(z: np.ndarray) -> np.ndarray:
    """Return the derivative of the activation."""
    return np.where(z > 1.5, 1, np.where(z < -1.5, 0, 2 * z / 3 + 0.5))


def combined(y: np.ndarray, core: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return f, what is added, and the gate."""
    added, gate = np.exp(np.minimum(y[:, :3], _MAX_A)), 1 / (1 + np.exp(-y[:, 3:]))
    return added + gate * core, added, gate


def _backward(
    values: Mapping[str, np.ndarray], batch: Batch, truth: np.ndarray, per_material: int
) -> tuple[float, dict[str, np.ndarray]]:
    """Return the mean loss of a batch and its gradients; the samples of a material are consecutive."""
    u = np.repeat(values["u"], per_material, axis=0)
    x = inputs_of(batch, u)
    core, slopes = analytic(batch, u)
    y, (z1, z2) = forward(values, x)
    f, added, gate = combined(y, core)
    difference = np.log1p(f * batch.cos) - np.log1p(truth * batch.cos)
    # by f; the mean is over samples and channels, but a material's numbers see their own samples only
    df = np.sign(difference) * batch.cos / (1 + f * batch.cos) / np.float32(difference.size)
    dy = np.concatenate([df * added, df * core * gate * (1 - gate)], 1)
    d2 = (dy @ values["W3"].T) * slope_of(z2)
    d1 = (d2 @ values["W2"].T) * slope_of(z1)
    gradient = {
        "W3": _activation(z2).T @ dy,
        "b3": dy.sum(0),
        "W2": _activation(z1).T @ d2,
        "b2": d2.sum(0),
        "W1": x.T @ d1,
        "b1": d1.sum(0),
    }
    own = np.concatenate([np.einsum("nc,nck->nk", df * gate, slopes), (d1 @ values["W1"].T)[:, 6:]], 1)
    gradient["u"] = own.reshape(-1, per_material, own.shape[1]).sum(1)
    return float(np.abs(difference).mean()), {k: v.astype(np.float32) for k, v in gradient.items()}
