"""NBRDF trained by us: a 6-21-21-3 network of its own for every material, the published recipe in NumPy.

As published: Cartesian half and difference vector in, ``exp(y) - 1`` out, mean of abs(log(1 + f cos)) differences,
Adam, batches of 512, no validation set. Changed, because it helps: Adam starts at 1e-2 instead of 5e-4 and falls to 0
like a cosine; 400 epochs instead of 100; initial weights as He et al. 2015 have them; values below 0 get a gradient
while training (cut off, they would learn nothing); few samples get as many steps as 50 epochs of 1e5.

Run as a script it holds these networks against the authors', on stand-ins for MERL materials: both by the same samples.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np

from mi_enhance import data
from mi_enhance.data import nbrdf
from mi_enhance.data.sampling import half_difference
from mi_enhance.losses import log_l1

_ROOT = Path(__file__).resolve().parents[2]
_SHAPES = {"W1": (6, 21), "b1": (21,), "W2": (21, 21), "b2": (21,), "W3": (21, 3), "b3": (3,)}
_BATCH = 512
_MAX_Y = 20.0  # f = 5e8, far above any measurement
_COLUMNS = {
    "material": ("material", ""),
    "authors": ("log-L1, authors", ".5f"),
    "ours": ("ours", ".5f"),
    "ratio": ("ratio", ".3f"),
    "seconds": ("s", ".1f"),
}


def main() -> None:
    """Run the check of the command line."""
    from common import finish, machine

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("materials", nargs="*", default=["gold-metallic-paint", "blue-acrylic", "red-phenolic"])
    parser.add_argument("--samples", type=int, default=100_000)
    parser.add_argument("--epochs", type=int, default=400)
    parser.add_argument("--learning-rate", type=float, default=1e-2)
    parser.add_argument("--json", action="store_true", help="print one JSON object last")
    args = parser.parse_args()
    about = machine()
    names, networks = nbrdf.read_networks(_ROOT / "data/nbrdf/merl.npz")
    rows = []
    for name in args.materials:
        seen, unseen = (
            data.load(_ROOT / "data/nps/merl.npz", material=name, n_samples=n, seed=seed)
            for n, seed in ((args.samples, 0), (20_000, 1))
        )
        network, seconds = train(seen, epochs=args.epochs, learning_rate=args.learning_rate)
        authors = {key: w[names.index(name)] for key, w in networks.items()}
        losses = [log_l1(nbrdf.decode(w, unseen.wi, unseen.wo), unseen.f, unseen.wo[:, 2]) for w in (authors, network)]
        rows.append({"material": name, "authors": losses[0], "ours": losses[1], "seconds": seconds})
        rows[-1]["ratio"] = losses[1] / losses[0]
    finish(rows, _COLUMNS, title=f"{args.samples:,} samples, {args.epochs} epochs", about=about, as_json=args.json)


def train(measurements, *, epochs=400, learning_rate=1e-2, min_steps=10_000, seed=0) -> tuple[dict, float]:
    """Train a network on all samples of one material.

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
    """
    start = time.perf_counter()
    rng = np.random.default_rng(seed)
    x, cos = features(measurements.wi, measurements.wo), measurements.wo[:, 2:]
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


def features(wi, wo) -> np.ndarray:
    """Inputs of the network, (N, 6) float32: half vector turned to phi_h = 0, difference vector of the light."""
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


if __name__ == "__main__":
    main()
