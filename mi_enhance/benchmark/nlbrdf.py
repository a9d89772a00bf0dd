"""A large network for all materials with a latent code for each colour channel (NLBRDF), for comparison.

The architecture of Fan et al. 2022, *Neural Layered BRDFs*, as far as it is described: 16 residual blocks of width 256,
1.06 million weights, 32 latent numbers for each channel of a material. Our reading where the description is silent: a
block is x + relu(W x + b), the inputs are NBRDF's features, the output is log(1 + f), the loss is eq. 1. NumPy only: a
network of this size is no constant of a kernel, and we compare its error on samples.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..data.measurements import Measurements
from ..system.files import replacing
from ..system.progress import Callback, Progress, silent
from ..training.training_set import TrainingSet
from .adam import Adam
from .nbrdf import nbrdf_features

WIDTH, BLOCKS, N_LATENT, _N_FEATURES = 256, 16, 32, 6
MULTIPLY_ADDS = 3 * (WIDTH * (_N_FEATURES + N_LATENT) + BLOCKS * WIDTH**2 + WIDTH)  # channel by channel
N_WEIGHTS = WIDTH * (_N_FEATURES + N_LATENT + 1) + BLOCKS * WIDTH * (WIDTH + 1) + WIDTH + 1
_PAIRS, _SAMPLES = 64, 32  # of one step: channels of materials, and samples of each
_AT_ONCE = 8192  # rows of an evaluation: bounds its memory
_MAX_Y = 20.0  # f = 5e8, far above any measurement


class Code(NamedTuple):
    """Latent numbers of a material, and the error of the samples they were fitted to."""

    latent: np.ndarray  # (3, N_LATENT)
    loss: float


def initial(n_materials: int, seed: int = 0) -> dict[str, np.ndarray]:
    """Return first weights (He et al. 2015, blocks a tenth of that) and latent numbers, (3 M, N_LATENT)."""
    rng = np.random.default_rng(seed)
    draw = lambda *shape, gain: rng.normal(0, gain * np.sqrt(2 / shape[-2]), shape).astype(np.float32)  # noqa: E731
    return {
        "W_in": draw(_N_FEATURES + N_LATENT, WIDTH, gain=1),
        "b_in": np.zeros(WIDTH, np.float32),
        "W": draw(BLOCKS, WIDTH, WIDTH, gain=0.1),
        "b": np.zeros((BLOCKS, WIDTH), np.float32),
        "W_out": draw(WIDTH, 1, gain=0.1),
        "b_out": np.zeros(1, np.float32),
        "latent": rng.normal(0, 0.1, (3 * n_materials, N_LATENT)).astype(np.float32),
    }


def train_nlbrdf(
    samples: TrainingSet,
    checkpoint: Path,
    *,
    steps: int,
    learning_rate: float = 5e-4,
    seed: int = 0,
    progress: Callback = silent,
) -> dict[str, np.ndarray]:
    """Train weights and latent numbers of all materials with Adam, or go on from a checkpoint, written every 100 steps.

    Returns
    -------
    dict of str to array
        As of :func:`initial`.
    """
    values = initial(len(samples.names), seed)
    adam = Adam(values, learning_rate, steps, warm_up=100)
    if checkpoint.exists():
        with np.load(checkpoint, allow_pickle=False) as stored:
            adam.resume(stored)
    data = samples.samples.reshape(9, len(samples.names), samples.n_samples)
    while adam.step < steps:
        rng = np.random.default_rng((seed, adam.step))
        material, channel = rng.integers(0, len(samples.names), _PAIRS), rng.integers(0, 3, _PAIRS)
        rows = data[:, material[:, None], rng.integers(0, samples.n_samples, (_PAIRS, _SAMPLES))].reshape(9, -1)
        truth = rows[6:].reshape(3, _PAIRS, _SAMPLES)[channel, np.arange(_PAIRS)].ravel()
        code = 3 * material + channel
        loss, gradient, latent = _backward(
            values,
            nbrdf_features(rows[:3].T, rows[3:6].T),
            np.repeat(values["latent"][code], _SAMPLES, 0),
            rows[5],
            truth,
        )
        gradient["latent"] = np.zeros_like(values["latent"])
        np.add.at(gradient["latent"], code, latent.reshape(_PAIRS, _SAMPLES, -1).sum(1))
        adam.advance(gradient)
        if adam.step % 100 == 0 or adam.step == steps:
            checkpoint.parent.mkdir(parents=True, exist_ok=True)
            with replacing(checkpoint) as temporary:
                np.savez(temporary, **adam.state())
        progress(Progress("train NLBRDF", adam.step, steps, {"loss": loss}))
    return values


def fit_nlbrdf(
    values: Mapping[str, np.ndarray], m: Measurements, *, steps: int = 300, batch: int = 256, seed: int = 0
) -> Code:
    """Fit the latent numbers of the three channels with Adam, from those of the training materials that are nearest."""
    rng = np.random.default_rng(seed)
    x, cos = nbrdf_features(m.wi, m.wo), m.wo[:, 2]
    look = rng.permutation(len(x))[:48]
    nearest = []
    for k in range(3):
        truth = np.log1p(m.f[look, k] * cos[look])
        losses = [
            np.abs(np.log1p(evaluate(values, x[look], latent) * cos[look]) - truth).mean()
            for latent in values["latent"]
        ]
        nearest.append(values["latent"][int(np.argmin(losses))])
    own = {"latent": np.stack(nearest).astype(np.float32)}
    adam = Adam(own, 2e-2, steps)
    losses = []
    while adam.step < steps:
        part = rng.integers(0, len(x), batch)
        loss, _, latent = _backward(
            values,
            np.tile(x[part], (3, 1)),
            np.repeat(own["latent"], batch, 0),
            np.tile(cos[part], 3),
            m.f[part].T.ravel(),
        )
        losses.append(loss)
        adam.advance({"latent": latent.reshape(3, batch, -1).sum(1)})
    return Code(own["latent"], float(np.mean(losses[-20:])))


def evaluate(values: Mapping[str, np.ndarray], features: np.ndarray, latent: np.ndarray) -> np.ndarray:
    """Return f (N,) of one channel."""
    parts = []
    for k in range(0, len(features), _AT_ONCE):
        x = features[k : k + _AT_ONCE]
        y, _ = _forward(values, np.concatenate([x, np.broadcast_to(latent, (len(x), N_LATENT))], 1))
        parts.append(np.expm1(np.clip(y, 0, _MAX_Y)))
    return np.concatenate(parts)


def _forward(values: Mapping[str, np.ndarray], x: np.ndarray) -> tuple[np.ndarray, list[np.ndarray]]:
    """Return log(1 + f), (N,), and the values before the activations, then the last hidden ones."""
    z = x @ values["W_in"] + values["b_in"]
    a, hidden = np.maximum(z, 0), [z]
    for w, b in zip(values["W"], values["b"], strict=True):
        hidden.append(a)
        z = a @ w + b
        hidden.append(z)
        a = a + np.maximum(z, 0)
    return (a @ values["W_out"] + values["b_out"])[:, 0], [*hidden, a]


def _backward(
    values: Mapping[str, np.ndarray], features: np.ndarray, latent: np.ndarray, cos: np.ndarray, truth: np.ndarray
) -> tuple[float, dict[str, np.ndarray], np.ndarray]:
    """Return the mean loss, the gradients of the weights, and that of the latent numbers of each row."""
    x = np.concatenate([features, latent], 1).astype(np.float32)
    y, hidden = _forward(values, x)
    e = np.exp(np.clip(y, -_MAX_Y, _MAX_Y))
    v = np.maximum(1 + (e - 1) * cos, 1e-6)  # 1e-6: the logarithm stays finite where f is near -1 and cos near 1
    difference = np.log(v) - np.log1p(truth * cos)
    dy = (np.sign(difference) * e * cos / (v * len(y)))[:, None].astype(np.float32)
    gradient = {"W_out": hidden[-1].T @ dy, "b_out": dy.sum(0)}
    d = dy @ values["W_out"].T
    gw, gb = np.empty_like(values["W"]), np.empty_like(values["b"])
    for k in range(BLOCKS - 1, -1, -1):
        a, z = hidden[1 + 2 * k], hidden[2 + 2 * k]
        dz = d * (z > 0)
        gw[k], gb[k] = a.T @ dz, dz.sum(0)
        d = d + dz @ values["W"][k].T
    dz = d * (hidden[0] > 0)
    gradient |= {"W": gw, "b": gb, "W_in": x.T @ dz, "b_in": dz.sum(0)}
    return float(np.abs(difference).mean()), gradient, dz @ values["W_in"][_N_FEATURES:].T
