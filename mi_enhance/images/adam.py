"""Adam (Kingma and Ba 2015, algorithm 1) on NumPy vectors, with a state that a file can keep."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

_BETA_1, _BETA_2, _EPSILON = 0.9, 0.999, 1e-8  # those of the paper


class Adam:
    """Moments of the gradients of some vectors.

    Parameters
    ----------
    state : mapping of str to array (1 + 2 n,), optional
        Of an earlier one: for each vector the number of steps, and both moments.

    Examples
    --------
    >>> adam, x = Adam(), np.array([1.0])
    >>> for _ in range(100):
    ...     x = adam.step("x", x, 2 * x, 0.1)
    >>> bool(abs(x[0]) < 0.05)
    True
    """

    def __init__(self, state: Mapping[str, np.ndarray] | None = None):
        self.state = dict(state or {})

    def step(self, key: str, value: np.ndarray, gradient: np.ndarray, rate: float) -> np.ndarray:
        """Return a vector after a step against its gradient."""
        t, m, v = np.split(self.state.get(key, np.zeros(1 + 2 * value.size)), [1, 1 + value.size])
        t, m = t + 1, _BETA_1 * m + (1 - _BETA_1) * gradient
        v = _BETA_2 * v + (1 - _BETA_2) * gradient**2
        self.state[key] = np.concatenate([t, m, v])
        return value - rate * (m / (1 - _BETA_1**t)) / (np.sqrt(v / (1 - _BETA_2**t)) + _EPSILON)
