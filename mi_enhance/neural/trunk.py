"""One network for several slots, which every material reads out by weights of its own.

The factor of a slot is *analytic term x exp(read-out)*, in RGB or scalar. With a read-out of 0 the BRDF is the analytic
model, so nothing has to be imitated, and the logarithm of a factor is linear in the read-out.

A read-out is *free*, hundreds of numbers for one material with many samples, or of *low rank*: for each slot a *code*
of a few numbers times a matrix, the basis, that all materials share. A code of 0 is the analytic model, too.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from .baked import _head, _leaky
from .mlp import MLP

# Their places among the networks of a BRDF, beside the slots.
NAME, BASIS = "trunk", "basis"


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
    basis : MLP, optional
        One linear layer. Its outputs, slot after slot, number of the code after number, channel after channel, are what
        a code is multiplied with. None: read-outs are free.

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
    basis: MLP | None = None

    @property
    def rank(self) -> int:
        """Numbers of a code for each slot; 0: read-outs are free."""
        return self.basis.sizes[-1] // self.n_outputs if self.basis else 0

    @property
    def n_codes(self) -> int:
        """Numbers of a code."""
        return self.rank * len(self.slots)

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
        """Of one evaluation, the constant inputs folded; a code of one material makes a read-out of its own."""
        return self.mlp.multiply_adds + self.n_units * self.n_outputs

    @property
    def networks(self) -> dict[str, MLP]:
        """The networks that all materials share, by their names among those of a BRDF."""
        return {NAME: self.mlp, **({BASIS: self.basis} if self.basis else {})}

    def with_networks(self, networks: Mapping[str, MLP]) -> Trunk:
        """Return the trunk with other weights, of the same shapes as :attr:`networks`."""
        return dataclasses.replace(self, mlp=networks[NAME], basis=networks.get(BASIS))

    def numbers_of(self, slot: str) -> slice:
        """Return the place of the numbers of a slot in the read-out."""
        n = self.channels * (self.n_units + 1)
        return slice(n * self.slots.index(slot), n * (self.slots.index(slot) + 1))

    def describe(self) -> dict:
        """Return all but the weights, as JSON."""
        rank = {"rank": self.rank} if self.basis else {}
        return {"slots": list(self.slots), "hidden": list(self.mlp.sizes[1:]), "channels": self.channels, **rank}

    def matrix(self, read_out: np.ndarray) -> np.ndarray:
        """Return read-outs (..., size) as matrices (..., outputs, K + 1); the last column is the constant."""
        return read_out.reshape(*read_out.shape[:-1], self.n_outputs, self.n_units + 1)

    def read_outs(self, codes: np.ndarray) -> np.ndarray:
        """Return codes (..., n_codes) as read-outs (..., size).

        Examples
        --------
        >>> from mi_enhance.neural.mlp import xavier
        >>> rng = np.random.default_rng(0)
        >>> trunk = Trunk(("B",), xavier((15, 8), 5, rng), basis=xavier((8, 4 * 3), 0, rng))
        >>> trunk.read_outs(np.zeros(4)).shape, trunk.size
        ((27,), 27)
        """
        assert self.basis is not None
        (w, b) = self.basis.layers[0]
        matrix = np.append(w, b[:, None], 1).astype(np.float64).reshape(len(self.slots), self.rank, -1)
        parts = codes.reshape(*codes.shape[:-1], len(self.slots), self.rank)
        return np.einsum("...sr,srk->...sk", parts, matrix).reshape(*codes.shape[:-1], self.size)

    def logs(self, slots: Sequence[str], units: Sequence[Any], record: Mapping, evaluators: Any) -> list[Any]:
        """Return the logarithms of the factors of some slots, channel after channel.

        Parameters
        ----------
        slots : sequence of str
        units : list of mi.Float
            Of the last hidden layer, before the leaky ReLU.
        record : dict
            Holds ``read_out``, or else ``code``.
        evaluators : dict of str to Evaluator, or Trainable
        """
        if "read_out" in record:
            return read_out(units, [v for slot in slots for v in record["read_out"][self.numbers_of(slot)]])
        basis = evaluators[BASIS]
        found = basis(active(units), basis.fold([]))
        result = []
        for slot in slots:
            first = self.rank * self.slots.index(slot)
            for channel in range(self.channels):
                terms = [
                    record["code"][k] * found[k * self.channels + channel] for k in range(first, first + self.rank)
                ]
                result.append(sum(terms[1:], terms[0]))
        return result


read_out = _head  # the logarithms of all factors, from the units before the leaky ReLU and the material's numbers


def active(units: Sequence[Any]) -> list:
    """Return the units as they are read out: after the leaky ReLU."""
    return [_leaky(v) for v in units]
