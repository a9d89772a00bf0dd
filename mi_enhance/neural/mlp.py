"""The small networks that stand in for terms and operators: sizes, first weights, three evaluators behind one call.

The only file that touches ``drjit.nn``. Every evaluator has ``fold(features)``, which turns the inputs that are
constant for a material into a bias of the first layer (exact), and ``__call__(x, bias)`` for the inputs that vary.
Paper, section 3 and Fig. 3: four fully connected layers, 16, 32, 16 hidden neurons, leaky ReLU, last layer linear.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

HIDDEN = (16, 32, 16)
SLOPE = 0.01  # of the leaky ReLU below 0; PyTorch's and Dr.Jit's default, the paper names none


@dataclasses.dataclass(frozen=True)
class MLP:
    """Weights of one network.

    Parameters
    ----------
    layers : tuple of (W, b)
        Float32 arrays, W of shape (out, in), b of shape (out,).
    n_folded : int
        The first `n_folded` inputs are constant over a material and can be folded into a bias.
    modulated : bool
        The last layer belongs to the material: its weights and biases are an affine function of the folded inputs,
        whose matrix (out * (hidden + 1), n_folded) and offset stand in its place. Folded, it is a last layer like any.
    """

    layers: tuple[tuple[np.ndarray, np.ndarray], ...]
    n_folded: int = 0
    modulated: bool = False

    @property
    def sizes(self) -> tuple[int, ...]:
        """Input size, hidden sizes, output size."""
        sizes = [self.layers[0][0].shape[1], *(len(b) for _, b in self.layers)]
        if self.modulated:
            sizes[-1] //= sizes[-2] + 1
        return tuple(sizes)

    @property
    def varies(self) -> bool:
        """False if all inputs are constant over a material: a network without directions."""
        return self.sizes[0] > self.n_folded

    @property
    def n_weights(self) -> int:
        """Number of floats, biases included.

        Examples
        --------
        >>> xavier((45, *HIDDEN, 1), 39, np.random.default_rng(0)).n_weights
        1825
        """
        return sum(w.size + b.size for w, b in self.layers)


def xavier(sizes: Sequence[int], n_folded: int, rng: np.random.Generator, modulated: bool = False) -> MLP:
    """Xavier (Glorot) uniform weights, zero biases: the paper's initialization (section 4.3).

    A modulated last layer is the one Xavier draws plus, for folded inputs of size 1, as much again.

    ``drjit.nn.Linear`` draws from another range, so the weights are drawn here.

    References
    ----------
    Glorot and Bengio 2010, *Understanding the Difficulty of Training Deep Feedforward Neural Networks*, eq. (16).
    """
    layers = []
    for n_in, n_out in zip(sizes, sizes[1:], strict=False):
        limit = np.sqrt(6 / (n_in + n_out))
        layers.append((rng.uniform(-limit, limit, (n_out, n_in)).astype(np.float32), np.zeros(n_out, np.float32)))
    if modulated:
        w, b = layers.pop()
        spread = np.abs(w).max() / np.sqrt(n_folded)
        offset = np.append(w, b[:, None], axis=1).ravel()
        layers.append((rng.uniform(-spread, spread, (offset.size, n_folded)).astype(np.float32), offset))
    return MLP(tuple(layers), n_folded, modulated)


def _split(mlp: MLP) -> list[np.ndarray]:
    """Weights in storage order; the folded and the varying part of the first matrix are apart: each is contiguous."""
    (w, b), *rest = mlp.layers
    return [w[:, : mlp.n_folded], w[:, mlp.n_folded :], b, *(v for layer in rest for v in layer)]


def flatten(networks: dict[str, MLP]) -> np.ndarray:
    """All weights as one float32 vector."""
    return np.concatenate([np.zeros(0, np.float32), *(v.ravel() for mlp in networks.values() for v in _split(mlp))])


def unflatten(networks: dict[str, MLP], flat: np.ndarray) -> dict[str, MLP]:
    """Networks of the same shapes as `networks` with the weights of :func:`flatten`."""
    offset, result = 0, {}
    for slot, mlp in networks.items():
        parts = []
        for v in _split(mlp):
            parts.append(flat[offset : offset + v.size].reshape(v.shape).astype(np.float32))
            offset += v.size
        folded, varying, bias, *rest = parts
        first = np.concatenate([folded, varying], axis=1), bias
        layers = (first, *zip(rest[::2], rest[1::2], strict=True))
        result[slot] = dataclasses.replace(mlp, layers=layers)
    return result
