"""Small networks that stand in for those of one material: what :mod:`mi_enhance.specialization.specialize` makes.

For one material all parameters are constants, so a network of the directions alone will do: a tenth of the size, one
for all factors of the BRDF, with its weights as constants of the compiled function. Colours, D and the frame stay
outside.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Mapping, Sequence

import numpy as np

from . import baked
from . import inputs as inputs_module


@dataclasses.dataclass(frozen=True)
class DistilledNetwork:
    """One network of the directions, whose outputs are the logarithms of several slots.

    Parameters
    ----------
    slots : tuple of str
        What the outputs stand for; an operator stands for all that it joins.
    inputs : tuple of str
        Names of features, see :func:`mi_enhance.neural.inputs.named`.
    layers : tuple of (W, b)
        Every layer sees the inputs and all that the layers before it give: W has shape
        (out, inputs + all hidden units so far). Leaky ReLU, the last layer is linear. What is 0 costs nothing.

    Examples
    --------
    >>> c = DistilledNetwork(("B",), ("cos_d",), ((np.ones((2, 1)), np.zeros(2)), (np.array([[0, 1, 0]]), np.zeros(1))))
    >>> c.sizes, c.multiply_adds
    ((1, 2, 1), 3)
    """

    slots: tuple[str, ...]
    inputs: tuple[str, ...]
    layers: tuple[tuple[np.ndarray, np.ndarray], ...]

    @property
    def sizes(self) -> tuple[int, ...]:
        """Inputs, hidden units of each layer, outputs."""
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
        """Outputs for the quantities and parameters of a record."""
        named = inputs_module.named(record)
        return baked.dense(self.layers, [named[name] for name in self.inputs])

    def without(self, slots: Collection[str], inputs: Collection[str]) -> DistilledNetwork | None:
        """The same network without some outputs, and without inputs that are 0; None if no output is left."""
        rows = [k for k, slot in enumerate(self.slots) if slot not in slots]
        keep = [name not in inputs for name in self.inputs]
        if not rows:
            return None
        *hidden, (w, b) = self.layers
        layers = [(w[:, _columns(w, keep)], b) for w, b in (*hidden, (w[rows], b[rows]))]
        return DistilledNetwork(
            tuple(self.slots[k] for k in rows),
            tuple(name for name, kept in zip(self.inputs, keep, strict=True) if kept),
            tuple(layers),
        )

    # ------------------------------------------------------------------ files

    def describe(self) -> dict:
        """What a description holds of it, as JSON; the weights are :attr:`flat`."""
        return {"slots": self.slots, "inputs": self.inputs, "hidden": self.sizes[1:-1]}

    @property
    def flat(self) -> np.ndarray:
        """All weights as one float32 vector."""
        return np.concatenate([v.ravel() for layer in self.layers for v in layer]).astype(np.float32)


def restore(descriptions: Sequence[Mapping], flat: np.ndarray) -> tuple[DistilledNetwork, ...]:
    """Rebuild what :meth:`DistilledNetwork.describe` and :attr:`DistilledNetwork.flat`, one after the other, took apart.

    Raises
    ------
    ValueError
        If the number of weights, a size or the name of an input is wrong.
    """
    result, start = [], 0
    for d in descriptions:
        slots, inputs, hidden = tuple(d["slots"]), tuple(d["inputs"]), [int(n) for n in d["hidden"]]
        unknown = set(inputs) - set(inputs_module.NAMES)
        # before any array is made: a few characters must not ask for all the memory there is
        if (
            unknown
            or len(hidden) > 8
            or any(not 0 < n <= 1024 for n in hidden)
            or len(inputs) > len(inputs_module.NAMES)
        ):
            raise ValueError(f"compact network {slots}: hidden layers {hidden[:8]} or inputs {sorted(unknown)} unknown")
        layers, seen = [], len(inputs)
        for n in (*hidden, len(slots)):
            parts = flat[start : start + n * seen], flat[start + n * seen : start + n * (seen + 1)]
            if parts[1].size != n:
                raise ValueError(f"compact network {slots}: {len(flat)} weights are too few")
            layers.append((parts[0].reshape(n, seen), parts[1]))
            start, seen = start + n * (seen + 1), seen + n
        result.append(DistilledNetwork(slots, inputs, tuple(layers)))
    if start != len(flat):
        raise ValueError(f"compact networks: {len(flat)} weights given, {start} needed")
    return tuple(result)


def _columns(w: np.ndarray, keep: Sequence[bool]) -> np.ndarray:
    return np.concatenate([keep, np.ones(w.shape[1] - len(keep), bool)]).nonzero()[0]
