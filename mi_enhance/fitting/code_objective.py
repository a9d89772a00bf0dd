"""The loss of materials whose read-outs are codes times a shared basis: few unknowns, for texels and few samples."""

from __future__ import annotations

from typing import cast

import mitsuba as mi
import numpy as np

from ..neural.mlp import MLP
from ..numerics import columns
from ..numerics.threads import in_threads
from .trunk_objective import TrunkObjective

_SHARES = 8  # of the problems, taken by threads


class CodeObjective(TrunkObjective):
    """As :class:`mi_enhance.fitting.trunk_objective.TrunkObjective`, of a BRDF whose trunk has a basis.

    What a number of a code is multiplied with is the same for all problems: one product of matrices, and the Jacobian
    of the codes are its rows times one number per factor.
    """

    def __init__(self, brdf, wi, wo, f, n: int):
        super().__init__(brdf, wi, wo, f, n)
        (w, b), *_ = cast(MLP, self.trunk.basis).layers
        self._basis = np.append(w, b[:, None], 1)

    def normal_equations(self, u: np.ndarray, epsilon: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """See :meth:`Objective.normal_equations`."""
        trunk, b, n = self.trunk, self.n_problems, self.n
        leaves, record, above, units = self._units(u, grad=True)
        found = self._rows(self._matrix(columns.pack(units), len(units)))
        rows = self._linearized(leaves, record, above, self._lanes_of(self._sums(u, found)))
        read = trunk.matrix(trunk.read_outs(u[:, self.n_rest :]).astype(np.float32))
        h, g, total = np.zeros((b, u.shape[1], u.shape[1])), np.zeros(u.shape), np.zeros(b)
        for c in range(3):
            direct, slopes, value = np.split(rows[:, c], [self.n_rest, -1], axis=1)
            channel = c if trunk.channels == 3 else 0
            own = read[:, channel :: trunk.channels, :-1]
            direct = direct + self._through(units, leaves, np.matmul(own.transpose(0, 2, 1), slopes))
            codes = found[:, :, :, channel] * slopes[:, :, None]
            smooth = np.sqrt(np.square(value) + np.square(epsilon, dtype=np.float32)[:, None, None])
            total += smooth.sum((1, 2), dtype=np.float64)
            j = np.concatenate([direct, codes.reshape(b, -1, n), value], 1) * np.sqrt(1 / smooth)
            # float32 products of at most a few thousand samples, added up in float64
            for part in np.array_split(j, max(1, n // 4096), axis=2):
                shares = in_threads(lambda a: a @ a.transpose(0, 2, 1), np.array_split(part, min(b, _SHARES)))
                product = np.concatenate(shares).astype(np.float64)
                h += product[:, :-1, :-1]
                g += product[:, :-1, -1]
        return h / (3 * n), g / (3 * n), total / (3 * n)

    def _logs(self, u: np.ndarray, phi: np.ndarray) -> list[mi.Float]:
        return self._lanes_of(self._sums(u, self._rows(phi)))

    def _rows(self, phi: np.ndarray) -> np.ndarray:
        """Return what the numbers of a code are multiplied with, (problems, slots, rank, channels, samples)."""
        found = np.matmul(self._basis[:, :-1], phi) + self._basis[:, -1:]
        return found.reshape(len(phi), len(self.trunk.slots), self.trunk.rank, self.trunk.channels, -1)

    def _sums(self, u: np.ndarray, found: np.ndarray) -> np.ndarray:
        """Return the logarithms of the factors, (problems, outputs, samples)."""
        b, slots, rank, channels, n = found.shape
        codes = u[:, self.n_rest :].astype(np.float32).reshape(b, slots, 1, rank)
        return np.matmul(codes, found.reshape(b, slots, rank, channels * n)).reshape(b, slots * channels, n)
