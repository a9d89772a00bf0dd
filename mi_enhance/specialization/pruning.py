"""Pruning, exact for one material: hidden units that are linear over all directions need no unit.

With the parameters of one material folded in, about half of the leaky ReLUs have the same sign everywhere. Such a unit
is an affine function of what its layer sees, and goes into the weights of the next layer, which then sees that, too.
Whether that is cheaper is counted, layer by layer.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence

import numpy as np

from ..neural.distilled_network import DistilledNetwork
from ..neural.mlp import MLP, SLOPE

Layers = Sequence[tuple[np.ndarray, np.ndarray]]


def fold(mlp: MLP, constant: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Layers of a network of the directions alone, float64.

    Parameters
    ----------
    mlp : MLP
    constant : array (n_folded,)
        The inputs that are constant for a material.
    """
    (w, b), *rest = [(w.astype(np.float64), b.astype(np.float64)) for w, b in mlp.layers]
    layers = [(w[:, mlp.n_folded :], b + w[:, : mlp.n_folded] @ constant), *rest]
    if mlp.modulated:
        w, b = layers.pop()
        own = (w @ constant + b).reshape(mlp.sizes[-1], -1)
        layers.append((own[:, :-1], own[:, -1]))
    return layers


def prune(slot: str, layers: Layers, inputs: Mapping[str, np.ndarray]) -> DistilledNetwork:
    """The same function in the form that needs the fewest multiply-adds.

    Parameters
    ----------
    slot : str
        What the network stands for.
    layers : list of (W, b)
        Each sees the layer before it.
    inputs : dict of str to array (N,)
        Its inputs for many directions, by name of the feature: they decide which units are linear.

    Returns
    -------
    DistilledNetwork

    Examples
    --------
    >>> w = [(np.ones((9, 1)), np.arange(9.0)), (np.ones((1, 9)), np.zeros(1))]
    >>> prune("B", w, {"cos_d": np.linspace(0.1, 1, 5)}).multiply_adds
    1
    """
    x, slopes = np.stack(list(inputs.values()), 1), []
    for w, b in layers[:-1]:
        z = x @ w.T + b
        positive, negative = (z > 0).all(0), (z <= 0).all(0)
        slopes.append(np.where(positive, 1, np.where(negative, SLOPE, np.nan)))  # NaN: not linear
        x = np.where(z > 0, z, SLOPE * z)
    candidates = [
        DistilledNetwork((slot,), tuple(inputs), _rewrite(layers, slopes, choice))
        for choice in itertools.product((False, True), repeat=len(slopes))
    ]
    return min(candidates, key=lambda c: c.multiply_adds)


def _rewrite(layers: Layers, slopes: Sequence[np.ndarray], choice: Sequence[bool]) -> tuple:
    """Layers that see all before them, without the linear units of the chosen layers."""
    n = layers[0][0].shape[1]
    a, c = np.eye(n), np.zeros(n)  # what a layer sees, as an affine function of the inputs and the units that are left
    result = []
    for (w, b), slope, chosen in zip(layers[:-1], slopes, choice, strict=True):
        w, b = w @ a, w @ c + b
        linear = np.isfinite(slope) & chosen
        if not linear.all():  # a layer of no units is none
            result.append((w[~linear], b[~linear]))
        units = np.zeros((len(b), np.count_nonzero(~linear)))
        units[~linear] = np.eye(units.shape[1])
        a = np.concatenate([np.where(linear, slope, 0)[:, None] * w, units], 1)
        c = np.where(linear, slope * b, 0)
    w, b = layers[-1]
    result.append((w @ a, w @ c + b))
    return tuple((w.astype(np.float32), b.astype(np.float32)) for w, b in result)
