"""The space in which parameters move during a fit."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import drjit as dr
import numpy as np

from .parameters import Parameter


class Space:
    """The space in which parameters are optimized: the logarithm of those that ask for it, a box for all.

    Parameters
    ----------
    parameters : sequence of Parameter
    hold : sequence of str
        Names that stay at their initial value, besides those that are fixed.

    Examples
    --------
    >>> space = Space([ALPHA_X, F0])
    >>> space.to_physical(space.to_free(np.array([0.1, 0.04])))
    array([0.1 , 0.04])
    """

    def __init__(self, parameters: Sequence[Parameter], hold: Sequence[str] = ()):
        parameters = [
            dataclasses.replace(p, low=p.initial, high=p.initial) if p.fixed or p.name in hold else p
            for p in parameters
        ]
        self._log = np.concatenate([np.full(p.size, p.log) for p in parameters])
        self.low = self.to_free(np.concatenate([np.full(p.size, p.low) for p in parameters]))
        self.high = self.to_free(np.concatenate([np.full(p.size, p.high) for p in parameters]))

    def to_free(self, physical: np.ndarray) -> np.ndarray:
        """Physical values, (..., P), to optimized ones."""
        return np.where(self._log, np.log(np.where(self._log, physical, 1)), physical)

    def to_physical(self, optimized):
        """Optimized values to physical ones: an array (..., P), or a list of P Dr.Jit arrays."""
        if isinstance(optimized, np.ndarray):
            return np.where(self._log, np.exp(np.where(self._log, optimized, 0)), optimized)
        return [dr.exp(v) if log else v for v, log in zip(optimized, self._log, strict=True)]

    def slope(self, optimized: np.ndarray) -> np.ndarray:
        """Derivatives of the physical values, (..., P), with respect to the optimized ones."""
        return np.where(self._log, self.to_physical(optimized), 1.0)
