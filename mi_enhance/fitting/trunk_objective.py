"""The loss of materials that read out a shared trunk: the read-outs are unknowns of a linear model within each step.

The logarithm of a factor is linear in the read-out, so its part of the Jacobian is the units of the trunk times one
number per factor. It is made by matrix products and never passes through automatic differentiation.
"""

from __future__ import annotations

import itertools
from typing import Any, cast

import drjit as dr
import mitsuba as mi
import numpy as np

from ..analytic import geometry, parameters
from ..analytic.parameter_space import Space
from ..neural import trunk as trunk_module
from ..neural.enhanced_brdf import EnhancedBRDF
from ..neural.replacements import scaled
from ..neural.trunk import NAME, Trunk
from ..numerics import columns
from ..numerics.threads import in_threads
from .objective import Objective, _gradient

# Samples per float32 product, of one thread; products are added in float64.
_BLOCK = 4096
_CURVATURE = 8192  # samples whose products say how far a step goes; all of them say where to


class TrunkObjective(Objective):
    """As :class:`mi_enhance.fitting.objective.Objective`, of a BRDF with a trunk and no modules."""

    def __init__(self, brdf: EnhancedBRDF, wi, wo, f, n: int):
        super().__init__(brdf, wi, wo, f, n)
        self.trunk = cast(Trunk, brdf.trunk)
        self._rest = brdf.parameters[:-1]  # all but the read-out, or the code
        self._rest_space = Space(self._rest)
        self.n_rest = parameters.count(self._rest)

    def residuals(self, u: np.ndarray) -> list[mi.Float]:
        """See :meth:`Objective.residuals`."""
        with dr.suspend_grad():
            leaves, record, above, units = self._units(u)
            phi = self._matrix(columns.pack(units), len(units))
            logs = self._logs(u, phi)
            return self._residual(self._f(record, logs) & above)

    def normal_equations(self, u: np.ndarray, epsilon: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """See :meth:`Objective.normal_equations`."""
        trunk, b, n = self.trunk, self.n_problems, self.n
        leaves, record, above, units = self._units(u, grad=True)
        phi = self._matrix(columns.pack(units), len(units))
        found = self._linearized(leaves, record, above, self._logs(u, phi))
        read = trunk.matrix(u[:, self.n_rest :].astype(np.float32))
        h, g = np.zeros((b, u.shape[1], u.shape[1])), np.zeros(u.shape)
        diagonal, total = np.zeros(u.shape), np.zeros(b)
        place = self.n_rest + np.arange(trunk.size).reshape(len(trunk.slots), trunk.channels, -1)
        some = min(n, _CURVATURE)
        parts, indices = [], []
        for c in range(3):
            direct, slopes, value = np.split(found[:, c], [self.n_rest, -1], axis=1)
            own = read[:, c :: trunk.channels, :-1] if trunk.channels == 3 else read[:, :, :-1]
            direct = direct + self._through(units, leaves, np.matmul(own.transpose(0, 2, 1), slopes))
            indices.append(np.append(np.arange(self.n_rest), place[:, c if trunk.channels == 3 else 0]))
            smooth = np.sqrt(np.square(value) + np.square(epsilon, dtype=np.float32)[:, None, None])
            total += smooth.sum((1, 2), dtype=np.float64)
            for k, first in itertools.product(range(b), range(0, n, _BLOCK)):
                arrays = [a[k, :, first : first + _BLOCK] for a in (direct, slopes, phi, value, smooth)]
                parts.append((c, k, first < some, arrays))
        sums = in_threads(lambda part: _sums(*part[3], curved=part[2]), parts)
        for (c, k, *_), (gc, squares, product) in zip(parts, sums, strict=True):
            g[k, indices[c]] += gc
            diagonal[k, indices[c]] += squares
            if product is not None:
                h[k][np.ix_(indices[c], indices[c])] += product * (n / some)
        # A number that hardly any of these samples feels must not take a huge step: it has the curvature of all.
        at = np.arange(u.shape[1])
        h[:, at, at] = np.maximum(h[:, at, at], diagonal)
        return h / (3 * n), g / (3 * n), total / (3 * n)

    def _linearized(self, leaves: list, record: dict, above: Any, logs: list[mi.Float]) -> np.ndarray:
        """Return by channel, (problems, 3, rows, samples): slopes of parameters and logarithms, then the residual."""
        channels = self.trunk.channels
        dr.enable_grad(logs)
        r = self._residual(self._f(record, logs) & above)
        rows = []
        for c in range(3):
            own = logs[c::channels] if channels == 3 else logs
            rows += [*_gradient(r[c], [*leaves, *own], mi.Float(1)), dr.detach(r[c])]
        return self._matrix(columns.pack(rows), len(rows)).reshape(self.n_problems, 3, -1, self.n)

    def _f(self, record: dict, logs: list) -> Any:
        graph = self.brdf.model.graph
        return graph.replace(scaled(graph, self.trunk.slots, logs, record))(record)

    def _units(self, u: np.ndarray, grad: bool = False) -> tuple[list, dict, Any, list]:
        """Return the parameters but the read-out, the record, the lanes above the horizon, and the units."""
        leaves = self._lanes(u[:, : self.n_rest])
        if grad:
            dr.enable_grad(leaves)
        params = parameters.unflatten(self._rest, self._rest_space.to_physical(leaves))
        q, above = geometry.local_quantities(self.wi, self.wo, params)
        record = {**q, **params}
        folded = {NAME: self.evaluators[NAME].fold(params["latent"])}
        units = self.brdf.units(record, self.wi, self.wo, self.evaluators, folded)
        return leaves, record, above, trunk_module.active(units)

    def _matrix(self, packed: mi.Float, n_columns: int) -> np.ndarray:
        """Return columns of all lanes as an array (problems, columns, samples)."""
        return columns.matrix(packed, n_columns).reshape(n_columns, self.n_problems, self.n).transpose(1, 0, 2)

    def _logs(self, u: np.ndarray, phi: np.ndarray) -> list[mi.Float]:
        """Return the logarithms of the factors."""
        read = self.trunk.matrix(u[:, self.n_rest :].astype(np.float32))
        y = np.matmul(read[:, :, :-1], phi) + read[:, :, -1:]
        return self._lanes_of(y)

    def _lanes_of(self, y: np.ndarray) -> list[mi.Float]:
        """Return values of all outputs, (problems, outputs, samples), as lanes."""
        return columns.lanes(y.transpose(1, 0, 2).reshape(self.trunk.n_outputs, -1))

    def _through(self, units: list, leaves: list, gradient: np.ndarray) -> np.ndarray:
        """Return what a gradient of the units, (problems, K, samples), is for the parameters that the trunk sees."""
        seed = columns.lanes(gradient.transpose(1, 0, 2).reshape(len(units), -1))
        return self._matrix(columns.pack(_gradient(units, leaves, seed)), len(leaves))


def _sums(direct, slopes, phi, value, smooth, *, curved: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """Return J^T r, the diagonal of J^T J and, if `curved`, J^T J itself of some samples of one channel."""
    seen = np.append(phi, np.ones_like(value), 0)
    pull, scale = value / smooth, np.sqrt(1 / smooth)
    g = np.append(direct @ pull[0], (slopes * pull) @ seen.T)
    direct, slopes = direct * scale, slopes * scale
    squares = np.append(np.square(direct).sum(1), np.square(slopes) @ np.square(seen).T)
    if not curved:
        return g, squares, None
    rows = np.append(direct, (slopes[:, None] * seen).reshape(-1, seen.shape[1]), 0)
    return g, squares, (rows @ rows.T).astype(np.float64)
