"""The weights of a neural module: sizes, initialization, one flat vector.

Paper, section 3 and Fig. 3: four fully connected layers, 16, 32, 16 hidden neurons, leaky ReLU, last layer linear.
:mod:`mi_enhance.neural.evaluator` says how a module is evaluated.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from ..system.messages import shortened

HIDDEN = (16, 32, 16)
SLOPE = 0.01  # of the leaky ReLU below 0; PyTorch's and Dr.Jit's default, the paper names none
# More than any use of modules needs, and little enough that a few characters of a file cannot ask for all memory.
MAX_LAYERS, MAX_UNITS = 8, 1024


def check_sizes(hidden: Sequence[int], where: str) -> tuple[int, ...]:
    """Return the sizes of hidden layers; raise ValueError unless they are 1 to 8 whole numbers from 1 to 1024.

    Examples
    --------
    >>> check_sizes([16, 32, 16], "example")
    (16, 32, 16)
    """
    good = isinstance(hidden, (list, tuple)) and 1 <= len(hidden) <= MAX_LAYERS
    if not good or not all(isinstance(n, (int, np.integer)) and 1 <= n <= MAX_UNITS for n in hidden):
        raise ValueError(
            f"{where}: hidden layers {shortened(hidden)} are out of range: 1 to {MAX_LAYERS} layers of 1 to "
            f"{MAX_UNITS} units, as [16, 32, 16]."
        )
    return tuple(hidden)


@dataclasses.dataclass(frozen=True)
class MLP:
    """Weights of one module.

    Parameters
    ----------
    layers : tuple of (W, b)
        Float32 arrays, W of shape (out, in), b of shape (out,).
    n_folded : int
        The first `n_folded` inputs are constant over a material and can be folded into a bias.
    modulated : bool
        The last layer belongs to the material: its weights and biases are W z + b of the folded inputs z. The last of
        `layers` is then (W, b), W of shape (out * (hidden + 1), n_folded).
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
        """False if all inputs are constant over a material: a module without directions."""
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

    @property
    def multiply_adds(self) -> int:
        """Of one evaluation, the constant inputs folded."""
        sizes = (self.sizes[0] - self.n_folded, *self.sizes[1:])
        return sum(a * b for a, b in zip(sizes, sizes[1:], strict=False)) if self.varies else 0


def xavier(sizes: Sequence[int], n_folded: int, rng: np.random.Generator, modulated: bool = False) -> MLP:
    """Draw Xavier (Glorot) uniform weights and zero biases: the paper's initialization (section 4.3).

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
    """Return the weights in storage order, with the folded part of the first matrix before the varying one."""
    (w, b), *rest = mlp.layers
    return [w[:, : mlp.n_folded], w[:, mlp.n_folded :], b, *(v for layer in rest for v in layer)]


def flatten(modules: Mapping[str, MLP]) -> np.ndarray:
    """Return all weights as one float32 vector."""
    return np.concatenate([np.zeros(0, np.float32), *(v.ravel() for mlp in modules.values() for v in _split(mlp))])


def unflatten(modules: Mapping[str, MLP], flat: np.ndarray) -> dict[str, MLP]:
    """Return modules of the same shapes as `modules` with the weights of :func:`flatten`."""
    offset, result = 0, {}
    for slot, mlp in modules.items():
        parts = []
        for v in _split(mlp):
            parts.append(flat[offset : offset + v.size].reshape(v.shape).astype(np.float32))
            offset += v.size
        folded, varying, bias, *rest = parts
        first = np.concatenate([folded, varying], axis=1), bias
        layers = (first, *zip(rest[::2], rest[1::2], strict=True))
        result[slot] = dataclasses.replace(mlp, layers=layers)
    return result
