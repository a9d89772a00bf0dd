"""The space in which parameters move during a fit."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import drjit as dr
import numpy as np

from .parameters import Parameter

# By how much of its range a sigmoid overshoots both ends: an albedo of exactly 0 or 1 can be reached, and left again.
_OVERSHOOT = 1e-3


class Space:
    """The space in which parameters are optimized: the logarithm of those that ask for it, a box for all.

    Parameters
    ----------
    parameters : sequence of Parameter
    hold : sequence of str
        Names that stay at their initial value, besides those that are fixed.

    Attributes
    ----------
    low, high : array (P,)
        The box.

    Examples
    --------
    >>> from mi_enhance.analytic.parameters import ALPHA_X, F0
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
        """Map physical values, (..., P), to free ones."""
        return np.where(self._log, np.log(np.where(self._log, physical, 1)), physical)

    def to_physical(self, free: Any) -> Any:
        """Map free values to physical ones: an array (..., P), or a list of P Dr.Jit arrays."""
        if isinstance(free, np.ndarray):
            return np.where(self._log, np.exp(np.where(self._log, free, 0)), free)
        return [dr.exp(v) if log else v for v, log in zip(free, self._log, strict=True)]

    def slope(self, free: np.ndarray) -> np.ndarray:
        """Return the derivatives of the physical values, (..., P), with respect to the free ones."""
        return np.where(self._log, self.to_physical(free), 1.0)


@dataclasses.dataclass(frozen=True)
class BoundedSpace:
    """The space in which the numbers of one parameter move when steps may leave its range.

    Their logarithm moves if the parameter asks for it. Numbers whose least value is 0 (albedos, F0, shares) are a
    sigmoid of the free ones; all others move as they are. A value outside of the range counts as the nearest inside.

    Parameters
    ----------
    parameter : Parameter
        Range and logarithm; its size is not used, a texture has a number for each texel.

    Examples
    --------
    >>> from mi_enhance.analytic.parameters import F0
    >>> space = BoundedSpace(F0)
    >>> space.to_physical(np.array([-100.0, 0.0, 100.0])).round(3)
    array([0. , 0.5, 1. ])
    """

    parameter: Parameter

    @property
    def _is_sigmoid(self) -> bool:
        return not self.parameter.log and self.parameter.low == 0

    @property
    def bounds(self) -> tuple[float, float]:
        """Range of the free values."""
        low, high = self.to_free(np.array([self.parameter.low, self.parameter.high]))
        return float(low), float(high)

    def to_free(self, physical: np.ndarray) -> np.ndarray:
        """Map physical values to free ones."""
        physical = np.clip(physical, self.parameter.low, self.parameter.high)
        if self.parameter.log:
            return np.log(physical)
        if self._is_sigmoid:
            share = (physical / self.parameter.high + _OVERSHOOT) / (1 + 2 * _OVERSHOOT)
            return np.log(share / (1 - share))
        return np.asarray(physical, np.float64)

    def to_physical(self, free: np.ndarray) -> np.ndarray:
        """Map free values to physical ones."""
        free = np.clip(free, *self.bounds)
        if self.parameter.log:
            free = np.exp(free)
        elif self._is_sigmoid:
            free = (_sigmoid(free) * (1 + 2 * _OVERSHOOT) - _OVERSHOOT) * self.parameter.high
        return np.clip(free, self.parameter.low, self.parameter.high)

    def slope(self, free: np.ndarray) -> np.ndarray:
        """Return the derivatives of the physical values with respect to the free ones."""
        if self.parameter.log:
            return np.exp(free)
        if self._is_sigmoid:
            share = _sigmoid(free)
            return share * (1 - share) * (1 + 2 * _OVERSHOOT) * self.parameter.high
        return np.ones_like(free)


def _sigmoid(free: np.ndarray) -> np.ndarray:
    return 1 / (1 + np.exp(-free))
