"""One network for several slots, which every material reads out by weights of its own.

The factor of a slot is *analytic term x exp(read-out)*, in RGB or scalar. With a read-out of 0 the BRDF is the analytic
model, so nothing has to be imitated, and the logarithm of a factor is linear in the read-out.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from .baked import _head, _leaky
from .mlp import MLP

NAME = "trunk"  # its place among the networks of a BRDF, beside the slots


@dataclasses.dataclass(frozen=True)
class Trunk:
    """One network of the directions and of the material's ``latent`` numbers, whose last hidden layer is read out.

    Parameters
    ----------
    slots : tuple of str
        Terms that get a factor, in the order of the read-out.
    mlp : MLP
        Its outputs are the K units of the last hidden layer, before the leaky ReLU; the folded inputs are ``latent``.
    channels : int
        Of each factor: 3 (RGB) or 1 (the same for all three).

    Examples
    --------
    >>> from mi_enhance.neural.mlp import xavier
    >>> trunk = Trunk(("B", "G"), xavier((10 + 5, 32, 32, 64), 5, np.random.default_rng(0)))
    >>> trunk.n_units, trunk.size
    (64, 390)
    """

    slots: tuple[str, ...]
    mlp: MLP
    channels: int = 3

    @property
    def n_units(self) -> int:
        """K, the units that are read out."""
        return self.mlp.sizes[-1]

    @property
    def n_outputs(self) -> int:
        """Factors times channels."""
        return len(self.slots) * self.channels

    @property
    def size(self) -> int:
        """Numbers of a read-out: for every output K weights and a constant."""
        return self.n_outputs * (self.n_units + 1)

    @property
    def multiply_adds(self) -> int:
        """Of one evaluation, the constant inputs folded."""
        sizes = (self.mlp.sizes[0] - self.mlp.n_folded, *self.mlp.sizes[1:], self.n_outputs)
        return sum(a * b for a, b in zip(sizes, sizes[1:], strict=False))

    def numbers_of(self, slot: str) -> slice:
        """Return the place of the numbers of a slot in the read-out."""
        n = self.channels * (self.n_units + 1)
        return slice(n * self.slots.index(slot), n * (self.slots.index(slot) + 1))

    def describe(self) -> dict:
        """Return all but the weights, as JSON."""
        return {"slots": list(self.slots), "hidden": list(self.mlp.sizes[1:]), "channels": self.channels}

    def matrix(self, read_out: np.ndarray) -> np.ndarray:
        """Return read-outs (..., size) as matrices (..., outputs, K + 1); the last column is the constant."""
        return read_out.reshape(*read_out.shape[:-1], self.n_outputs, self.n_units + 1)


read_out = _head  # the logarithms of all factors, from the units before the leaky ReLU and the material's numbers


def active(units: Sequence[Any]) -> list:
    """Return the units as they are read out: after the leaky ReLU."""
    return [_leaky(v) for v in units]
