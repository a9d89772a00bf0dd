"""A small network of a material's own, in RGB, and the analytic parameters, learned together from measurements."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from ..analytic import geometry, parameters
from ..analytic.models.model import Model
from ..analytic.parameter_space import Space
from ..analytic.parameters import ASYMMETRY
from ..fitting.losses import compressed
from ..fitting.objective import _gradient
from ..neural.inputs import named
from ..neural.replacements import scaled
from ..numerics import columns
from ..numerics.arrays import vector3f
from ..numerics.threads import in_threads
from .distillation import _forward

_CHANNELS = 3
_PART = 4096  # samples that one thread takes: what it reads stays in the cache
_CURVATURE = 4096  # samples whose products say how far a step goes; all of them say where to
_LARGEST_WEIGHT = 30.0  # keeps a fit from running away along a direction the data says nothing about


class OwnProblem:
    """Loss of one material over the analytic parameters and the weights of a network of its own.

    The unknowns are one vector: the parameters that move, then weight matrices and biases layer by layer. The network
    is dense (each layer sees all before it); its outputs are the logarithms of RGB factors of `slots`.

    Parameters
    ----------
    model : Model
    slots : sequence of str
    inputs : sequence of str
        Names of features.
    hidden : sequence of int
    wi, wo, f : array (N, 3)
    values : dict of str to array
        All parameters of the model, and ``asymmetry``, at the start.
    moving : array (P, Q)
        How the Q unknowns move them: free values are `values` + `moving` @ unknowns.
    mean, std : array (inputs,)
        Features are standardized by them.
    """

    def __init__(self, model: Model, slots, inputs, hidden, wi, wo, f, values, moving, mean, std):
        self.model, self.slots, self.inputs = model, tuple(slots), tuple(inputs)
        self.parameters = (*model.parameters, ASYMMETRY)
        self.space = Space(self.parameters)
        self.values = self.space.to_free(parameters.flatten(self.parameters, values))
        self.moving = moving
        self.wi, self.wo, self.n = vector3f(wi), vector3f(wo), len(wi)
        self.cos = wo[:, 2].astype(np.float32)
        self.truth = compressed(f.T.astype(np.float32), self.cos)
        self.mean, self.std = mean, std
        n_out, seen = _CHANNELS * len(self.slots), len(self.inputs)
        self.shapes = []
        for n in (*hidden, n_out):
            self.shapes.append((n, seen))
            seen += n

    # -------------------------------------------------------------------------- unknowns

    @property
    def n_unknowns(self) -> int:
        return self.moving.shape[1] + sum(a * (b + 1) for a, b in self.shapes)

    def split(self, u: np.ndarray) -> tuple[np.ndarray, list[tuple[np.ndarray, np.ndarray]]]:
        """Return the free parameter values (P,) and the layers of a vector of unknowns."""
        q = self.moving.shape[1]
        free = self.values + self.moving @ u[:q]
        layers, at = [], q
        for a, b in self.shapes:
            w = u[at : at + a * b].reshape(a, b).astype(np.float32)
            bias = u[at + a * b : at + a * (b + 1)].astype(np.float32)
            layers.append((w, bias))
            at += a * (b + 1)
        return np.clip(free, self.space.low, self.space.high), layers

    def join(self, moved: np.ndarray, layers: Sequence[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
        """Return the vector of unknowns."""
        return np.concatenate([moved, *(np.append(w.ravel(), b) for w, b in layers)])

    def box(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the bounds of the unknowns."""
        q = self.moving.shape[1]
        low, high = np.full(self.n_unknowns, -_LARGEST_WEIGHT), np.full(self.n_unknowns, _LARGEST_WEIGHT)
        at = self.moving.argmax(0) if q else np.zeros(0, int)
        low[:q], high[:q] = (self.space.low - self.values)[at], (self.space.high - self.values)[at]
        return low, high

    def inputs_at_start(self) -> np.ndarray:
        """Return the features for the parameters at the start, (N, inputs)."""
        with dr.suspend_grad():
            features = self._start(self.values, grad=False)[-1]
            return columns.matrix(columns.pack(features), len(features)).T

    def first(self, rng: np.random.Generator) -> np.ndarray:
        """Return first unknowns: the parameters as they are, Xavier hidden layers, outputs of 0: the analytic model."""
        layers = []
        for k, (a, b) in enumerate(self.shapes):
            limit = np.sqrt(6 / (a + b)) if k < len(self.shapes) - 1 else 0
            layers.append((rng.uniform(-limit, limit, (a, b)), rng.uniform(-0.5, 0.5, a) * (limit > 0)))
        return self.join(np.zeros(self.moving.shape[1]), layers)

    # -------------------------------------------------------------------------- loss

    def _start(self, free: np.ndarray, grad: bool):
        leaves = [dr.opaque(mi.Float, float(v), self.n) for v in free]
        if grad:
            dr.enable_grad(leaves)
        params = parameters.unflatten(self.parameters, self.space.to_physical(leaves))
        q, above = geometry.local_quantities(self.wi, self.wo, params)
        record = {**q, **params}
        features = named(record)
        return leaves, record, above, [features[name] + dr.zeros(mi.Float, self.n) for name in self.inputs]

    def f(self, record, above, logs) -> Any:
        graph = self.model.graph
        return mi.Color3f(graph.replace(scaled(graph, self.slots, logs))(record)) & above

    def _x(self, features) -> np.ndarray:
        x = columns.matrix(columns.pack(features), len(features)).T
        return ((x - self.mean) / self.std).astype(np.float32)

    def residuals(self, u: np.ndarray) -> np.ndarray:
        """Return the differences of the logarithms, (3, N)."""
        free, layers = self.split(u)
        with dr.suspend_grad():
            _, record, above, features = self._start(free, grad=False)
            y = _forward(layers, self._x(features))[0]
            f = self.f(record, above, columns.lanes(y.T))
            return self.truth - compressed(columns.matrix(columns.pack(list(f)), 3), self.cos)

    def loss(self, u: np.ndarray) -> np.ndarray:
        """Return the mean absolute difference of the logarithms, (1,)."""
        return np.array([np.abs(self.residuals(u[0])).mean(dtype=np.float64)])

    def normal_equations(self, u: np.ndarray, epsilon: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """See :meth:`mi_enhance.fitting.objective.Objective.normal_equations`."""
        free, layers = self.split(u[0])
        leaves, record, above, features = self._start(free, grad=True)
        x = self._x(features)
        y, kept = _forward(layers, x)
        logs = columns.lanes(y.T)
        dr.enable_grad(logs)
        f = self.f(record, above, logs)
        r = [compressed(c, self.wo.z) for c in f]
        rows = []
        for c in range(_CHANNELS):
            rows += [dr.detach(r[c]), *_gradient(r[c], [*leaves, *logs[c::3]], mi.Float(1))]
        n_p, n_s = len(leaves), len(self.slots)
        found = columns.matrix(columns.pack(rows), len(rows)).reshape(_CHANNELS, 1 + n_p + n_s, self.n)
        p, q = u.shape[1], self.moving.shape[1]
        h, g, diagonal, total = np.zeros((p, p)), np.zeros(p), np.zeros(p), 0.0
        some = min(self.n, _CURVATURE)
        moving = self.moving.astype(np.float32)
        places = self._places(q)
        indices, parts = [], []
        for c in range(_CHANNELS):
            value = found[c, 0] - self.truth[c]
            direct, dy = found[c, 1 : 1 + n_p].T, found[c, 1 + n_p :].T
            deltas, dx = _backward(layers, kept, dy, c)
            direct = (direct + self._through(features, leaves, dx / self.std)) @ moving
            indices.append(np.concatenate([np.arange(q), places[c]]))
            smooth = np.sqrt(value * value + np.float32(epsilon[0]) ** 2)
            total += float(smooth.sum(dtype=np.float64))
            weight = 1 / smooth
            pairs = [(np.ones((self.n, 1), np.float32), direct)]
            for (seen, _), dz in zip(kept, deltas, strict=True):
                pairs += [(seen, dz), (pairs[0][0], dz)]
            for first in range(0, self.n, _PART):
                parts.append((c, pairs, weight, value, slice(first, first + _PART), first < some))
        for (c, *_), (gc, squares, hc) in zip(parts, in_threads(lambda v: _sums(*v[1:]), parts), strict=True):
            g[indices[c]] += gc
            diagonal[indices[c]] += squares
            if hc is not None:
                h[np.ix_(indices[c], indices[c])] += hc * (self.n / some)
        # A weight that hardly any of these samples feels must not take a huge step: it has the curvature of all.
        np.fill_diagonal(h, np.maximum(h.diagonal(), diagonal))
        n = _CHANNELS * self.n
        return h[None] / n, g[None] / n, np.array([total / n])

    def _places(self, q: int) -> list[np.ndarray]:
        """Return, by channel, the places of the weights that it depends on."""
        at, hidden = q, []
        for a, b in self.shapes[:-1]:
            hidden.append(np.arange(at, at + a * (b + 1)))
            at += a * (b + 1)
        a, b = self.shapes[-1]
        w = at + np.arange(a * b).reshape(a, b)
        bias = at + a * b + np.arange(a)
        return [np.concatenate([*hidden, w[c::3].ravel(), bias[c::3]]) for c in range(_CHANNELS)]

    def _through(self, features, leaves, dx: np.ndarray) -> np.ndarray:
        """Return the gradient of the parameters, (N, P), for that of the features, (N, inputs)."""
        seeded = [(v, seed) for v, seed in zip(features, columns.lanes(dx.T), strict=True) if dr.grad_enabled(v)]
        result = _gradient([v for v, _ in seeded], leaves, [seed for _, seed in seeded])
        return columns.matrix(columns.pack(result), len(result)).T


def _sums(pairs, weight, value, rows: slice, curved: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """Return J^T r, the diagonal of J^T J and, if `curved`, J^T J itself of some samples.

    J is made of the products of all columns of each pair, which are never written down as a whole.
    """
    cut, weight = [(seen[rows], d[rows]) for seen, d in pairs], weight[rows, None]
    pull = weight * value[rows, None]
    g = np.concatenate([((d * pull).T @ seen).ravel() for seen, d in cut])
    squares = np.concatenate([((d * d * weight).T @ (seen * seen)).ravel() for seen, d in cut])
    if not curved:
        return g, squares, None
    root = np.sqrt(weight)
    a = np.concatenate([((d * root)[:, :, None] * seen[:, None]).reshape(len(root), -1) for seen, d in cut], 1)
    return g, squares, a.T @ a


def _backward(layers, kept, dy: np.ndarray, c: int) -> tuple[list[np.ndarray], np.ndarray]:
    """Return the gradients of the values before the activations of all layers, and of the inputs, for one channel."""
    deltas = [dy]
    dseen = dy @ layers[-1][0][c::3]
    for (w, _), (_, slope) in zip(layers[-2::-1], kept[-2::-1], strict=True):
        dseen, da = np.split(dseen, [dseen.shape[1] - len(w)], axis=1)
        deltas.append(da * slope)
        dseen = dseen + deltas[-1] @ w
    return deltas[::-1], dseen
