"""Small networks that replace all modules of one material; :mod:`mi_enhance.specialization.specialize` makes them.

For one material all parameters are constants, so a network of the directions alone will do: a tenth of the size, one
for all factors of the BRDF, with its weights as constants of the compiled function. Colours, D and the frame stay
outside.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Mapping, Sequence

import numpy as np

from ..system.messages import shortened
from . import baked
from .inputs import NAMES, named
from .mlp import check_sizes


@dataclasses.dataclass(frozen=True)
class DistilledNetwork:
    """One network of the directions, whose outputs are the logarithms of several slots.

    Parameters
    ----------
    slots : tuple of str
        The slots that the outputs replace; an operator stands for all that it joins.
    inputs : tuple of str
        Names of features, see :func:`mi_enhance.neural.inputs.named`.
    layers : tuple of (W, b)
        Every layer sees the inputs and all that the layers before it give: W has shape
        (out, inputs + all hidden units so far). Leaky ReLU, the last layer is linear. Weights of 0 cost nothing.
    channels : int
        1: the outputs stand for the slots themselves, alike in all channels. 3: they are factors of the analytic terms
        in RGB, three outputs for each slot.

    Examples
    --------
    >>> c = DistilledNetwork(("B",), ("cos_d",), ((np.ones((2, 1)), np.zeros(2)), (np.array([[0, 1, 0]]), np.zeros(1))))
    >>> c.sizes, c.multiply_adds
    ((1, 2, 1), 3)
    """

    slots: tuple[str, ...]
    inputs: tuple[str, ...]
    layers: tuple[tuple[np.ndarray, np.ndarray], ...]
    channels: int = 1

    @property
    def sizes(self) -> tuple[int, ...]:
        """Number of inputs, of hidden units of each layer, of outputs."""
        return (len(self.inputs), *(len(b) for _, b in self.layers))

    @property
    def n_weights(self) -> int:
        """Number of floats."""
        return sum(w.size + b.size for w, b in self.layers)

    @property
    def multiply_adds(self) -> int:
        """Multiply-adds of one evaluation."""
        return sum(int(np.count_nonzero(w)) for w, _ in self.layers)

    def __call__(self, record: Mapping) -> list:
        """Compute the outputs for the quantities and parameters of a record."""
        features = named(record)
        return baked.dense(self.layers, [features[name] for name in self.inputs])

    def without(self, slots: Collection[str], inputs: Collection[str]) -> DistilledNetwork | None:
        """Return the network without some outputs, and without inputs that are 0; None if no output is left."""
        left = [slot for slot in self.slots if slot not in slots]
        rows = [self.channels * self.slots.index(slot) + c for slot in left for c in range(self.channels)]
        keep = [name not in inputs for name in self.inputs]
        if not rows:
            return None
        if len(left) == len(self.slots) and all(keep):
            return self
        *hidden, (w, b) = self.layers
        layers = [(w[:, _columns(w, keep)], b) for w, b in (*hidden, (w[rows], b[rows]))]
        return DistilledNetwork(
            tuple(left),
            tuple(name for name, kept in zip(self.inputs, keep, strict=True) if kept),
            tuple(layers),
            self.channels,
        )

    def shifted(self, slot: str, logs: np.ndarray) -> DistilledNetwork:
        """Return the network with numbers, one per channel, added to the outputs of a slot."""
        *hidden, (w, b) = self.layers
        b = b.copy()
        k = self.slots.index(slot) * self.channels
        b[k : k + self.channels] += logs
        return dataclasses.replace(self, layers=(*hidden, (w, b)))

    # ------------------------------------------------------------------ files

    def describe(self) -> dict:
        """Return all but the weights, as JSON; :attr:`flat` has the weights."""
        return {"slots": self.slots, "inputs": self.inputs, "hidden": self.sizes[1:-1], "channels": self.channels}

    @property
    def flat(self) -> np.ndarray:
        """All weights as one float32 vector."""
        return np.concatenate([v.ravel() for layer in self.layers for v in layer]).astype(np.float32)


def restore(descriptions: Sequence[Mapping], flat: np.ndarray) -> tuple[DistilledNetwork, ...]:
    """Rebuild networks from their descriptions and their weights.

    Parameters
    ----------
    descriptions : sequence of dict
        From :meth:`DistilledNetwork.describe`.
    flat : array
        :attr:`DistilledNetwork.flat` of all networks, one after the other.

    Returns
    -------
    tuple of DistilledNetwork

    Raises
    ------
    ValueError
        If the number of weights, a size or the name of an input is wrong.
    """
    result = []
    for description in descriptions:
        network, flat = _first(description, flat)
        result.append(network)
    if len(flat):
        raise ValueError(f"distilled networks: {len(flat)} weights too many")
    return tuple(result)


def _first(description: Mapping, flat: np.ndarray) -> tuple[DistilledNetwork, np.ndarray]:
    """Return the network whose weights come first in `flat`, and the weights that follow."""
    slots, inputs = tuple(description["slots"]), tuple(description["inputs"])
    where = f"distilled network {slots}"
    # Before any array is made: a few characters must not ask for all the memory there is. Pruning may leave no layer.
    hidden = check_sizes(description["hidden"], where) if description["hidden"] else ()
    if len(inputs) > len(NAMES) or not set(inputs) <= set(NAMES):
        raise ValueError(f"{where}: inputs {shortened(inputs)} must be some of {', '.join(NAMES)}")
    channels = description.get("channels", 1)
    if channels not in (1, 3):
        raise ValueError(f"{where}: channels must be 1 or 3; got {shortened(channels)}")
    layers, seen = [], len(inputs)
    for n in (*hidden, channels * len(slots)):
        w, b, flat = np.split(flat, [n * seen, n * (seen + 1)])
        if b.size != n:
            raise ValueError(f"{where}: there are too few weights")
        layers.append((w.reshape(n, seen), b))
        seen += n
    return DistilledNetwork(slots, inputs, tuple(layers), channels), flat


def _columns(w: np.ndarray, keep: Sequence[bool]) -> np.ndarray:
    """Return the places of the columns of `w` to keep: inputs by `keep`, and all hidden units after them."""
    return np.concatenate([keep, np.ones(w.shape[1] - len(keep), bool)]).nonzero()[0]
