"""One step of Adam on NumPy arrays."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..numerics.schedules import cosine_decay


class Adam:
    """Optimizer of arrays, which it moves in place; its rate falls to 0 along a cosine.

    Parameters
    ----------
    values : dict of str to array, float32
    learning_rate : float
        At the start.
    steps : int
        At the last of them the rate is 0.
    warm_up : int
        Steps in which the rate rises first.

    References
    ----------
    Kingma and Ba 2015, algorithm 1, with the corrections for the start in the rate.

    Examples
    --------
    >>> values = {"x": np.full(3, 5.0, np.float32)}
    >>> adam = Adam(values, 0.5, 100)
    >>> for _ in range(100):
    ...     adam.advance({"x": 2 * values["x"]})
    >>> bool(np.abs(values["x"]).max() < 0.1)
    True
    """

    def __init__(self, values: Mapping[str, np.ndarray], learning_rate: float, steps: int, warm_up: int = 0):
        self.values, self.learning_rate, self.steps, self.warm_up = values, learning_rate, steps, warm_up
        self.step = 0
        self._moments = {name: (np.zeros_like(v), np.zeros_like(v)) for name, v in values.items()}

    def advance(self, gradient: Mapping[str, np.ndarray]) -> None:
        """Take one step."""
        rate = self.learning_rate * cosine_decay(self.step, self.steps, low=0, warm_up=self.warm_up)
        self.step += 1
        rate *= np.sqrt(1 - 0.999**self.step) / (1 - 0.9**self.step)
        for name, g in gradient.items():
            mean, square = self._moments[name]
            mean += 0.1 * (g - mean)
            square += 0.001 * (g * g - square)
            self.values[name][...] -= np.float32(rate) * mean / (np.sqrt(square) + 1e-8)

    def state(self) -> dict[str, Any]:
        """Return values, moments and step as arrays by name, for a checkpoint."""
        moments = {f"{name}_{k}": m for name, pair in self._moments.items() for k, m in enumerate(pair)}
        return {**self.values, **moments, "step": self.step}

    def resume(self, state: Mapping[str, np.ndarray]) -> None:
        """Go on from a checkpoint."""
        self.step = int(state["step"])
        for name, value in self.values.items():
            for array, key in ((value, name), *zip(self._moments[name], (f"{name}_0", f"{name}_1"), strict=True)):
                array[...] = state[key]
