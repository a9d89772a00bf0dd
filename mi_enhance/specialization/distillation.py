"""Small networks learn the factors of a BRDF: Levenberg-Marquardt on all weights, in NumPy.

A few hundred weights and some thousand noiseless samples: second-order steps get in a second where gradient descent
does not in a minute. The networks are :class:`mi_enhance.neural.distilled_network.DistilledNetwork`: every layer sees
all before it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ..neural.mlp import SLOPE
from ..numerics import levenberg_marquardt

Layers = Sequence[tuple[np.ndarray, np.ndarray]]

_BLOCK = 512  # samples per product: their Jacobian of a few hundred weights stays in the cache


def first(sizes: Sequence[int], bias: np.ndarray, rng: np.random.Generator) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return first weights for standardized inputs: Xavier; the outputs start near `bias`.

    Parameters
    ----------
    sizes : sequence of int
        Inputs, hidden units of each layer, outputs.
    bias : array (outputs,)
    rng : numpy.random.Generator

    Examples
    --------
    >>> [w.shape for w, _ in first((3, 4, 2), np.zeros(2), np.random.default_rng(0))]
    [(4, 3), (2, 7)]
    """
    layers, seen = [], sizes[0]
    for n in sizes[1:]:
        limit = np.sqrt(6 / (seen + n))
        # biases, too: the kinks of the units should lie at different places
        layers.append((rng.uniform(-limit, limit, (n, seen)), rng.uniform(-0.3, 0.3, n)))
        seen += n
    w, _ = layers[-1]
    layers[-1] = 0.3 * w, np.asarray(bias, np.float64)
    return layers


def forward(layers: Layers, x: np.ndarray) -> np.ndarray:
    """Return the outputs (n, outputs) for inputs (n, inputs)."""
    return _forward(layers, x)[0]


def on_raw_inputs(layers: Layers, mean: np.ndarray, std: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return the same network, float32, for raw inputs: it was trained on (x - mean) / std.

    Examples
    --------
    >>> layers = on_raw_inputs([(np.array([[1.0]]), np.array([2.0]))], np.array([3.0]), np.array([4.0]))
    >>> forward(layers, np.array([[3.0]]))
    array([[2.]])
    """
    n, result = len(mean), []
    for w, b in layers:
        own = w[:, :n] / std
        result.append((np.append(own, w[:, n:], 1).astype(np.float32), (b - own @ mean).astype(np.float32)))
    return result


def train(layers: Layers, x: np.ndarray, residuals: Callable, *, steps: int) -> tuple[Layers, float]:
    """Minimize the sum of the mean absolute residuals over all weights.

    Parameters
    ----------
    layers : list of (W, b)
    x : array (n, inputs)
    residuals : callable
        ``residuals(y, index) -> r (n, R), slopes (n, R, outputs)`` for outputs `y` at the samples `index`.
    steps : int

    Returns
    -------
    layers, loss

    Examples
    --------
    >>> x = np.random.default_rng(0).normal(size=(500, 1))
    >>> wanted = lambda y, index: (y - np.tanh(x[index]), np.ones((len(y), 1, 1)))
    >>> train(first((1, 4, 1), np.zeros(1), np.random.default_rng(1)), x, wanted, steps=30)[1] < 0.02
    True
    """
    x, shapes = x.astype(np.float32), [w.shape for w, _ in layers]
    n = len(x)

    def loss(u):
        r, _ = residuals(forward(_unflatten(u[0].astype(np.float32), shapes), x), slice(None))
        return np.array([np.abs(r).sum(dtype=np.float64) / n])

    def normal_equations(u, epsilon):
        current = _unflatten(u[0].astype(np.float32), shapes)
        p = u.shape[1]
        h, g = np.zeros((p, p)), np.zeros(p)
        for start in range(0, n, _BLOCK):
            index = slice(start, min(start + _BLOCK, n))
            y, kept = _forward(current, x[index])
            r, slopes = residuals(y, index)
            # sqrt(r^2 + eps^2): weights 1 / |r| that stay finite
            scale = (np.square(r) + np.square(epsilon[0] / r.shape[1])) ** -0.25
            a = _jacobian(current, kept, (slopes * scale[:, :, None]).astype(np.float32))
            h += a.T @ a
            g += (scale * r).T.astype(np.float32).ravel() @ a
        return h[None] / n, g[None] / n, None

    u = np.concatenate([v.ravel() for layer in layers for v in layer])[None]
    free = np.full(u.shape[1], np.inf)
    u, best = levenberg_marquardt.minimize(loss, normal_equations, u, -free, free, steps=steps, tolerance=3e-3)
    return _unflatten(u[0], shapes), float(best[0])


def _unflatten(u: np.ndarray, shapes: Sequence[tuple[int, int]]) -> list[tuple[np.ndarray, np.ndarray]]:
    layers, start = [], 0
    for n, seen in shapes:
        layers.append((u[start : start + n * seen].reshape(n, seen), u[start + n * seen : start + n * (seen + 1)]))
        start += n * (seen + 1)
    return layers


def _forward(layers: Layers, x: np.ndarray) -> tuple[np.ndarray, list]:
    """Outputs, and for every layer what it sees and the slopes of its units."""
    kept = []
    for w, b in layers:
        z = x @ w.T + b
        slope = np.where(z > 0, np.float32(1), np.float32(SLOPE))
        kept.append((x, slope))
        x = np.concatenate([x, z * slope], 1)
    return z, kept


def _jacobian(layers: Layers, kept: list, slopes: np.ndarray) -> np.ndarray:
    """Derivatives of residuals with the given slopes (n, R, outputs) to the outputs, (R * n, weights)."""
    n, n_r, _ = slopes.shape
    ends = np.cumsum([w.size + b.size for w, b in layers])
    a = np.empty((n_r, n, ends[-1]), np.float32)
    for k in range(n_r):
        dz: np.ndarray = slopes[:, k]
        dx: np.ndarray | float = 0.0
        for (w, b), (x, _), end, (_, before) in zip(
            layers[::-1], kept[::-1], ends[::-1], [*kept[-2::-1], (None, None)], strict=True
        ):
            a[k, :, end - b.size - w.size : end - b.size] = (dz[:, :, None] * x[:, None, :]).reshape(n, -1)
            a[k, :, end - b.size : end] = dz
            if before is not None:
                dx = dz @ w + dx  # of all that this layer sees; the last of it are the units of the layer before
                dx, dz = np.split(dx, [x.shape[1] - before.shape[1]], axis=1)
                dz = dz * before
    return a.reshape(n_r * n, -1)
