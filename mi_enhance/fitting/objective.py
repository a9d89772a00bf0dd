"""The paper's loss (eq. 1) of many materials at once: values, gradients, Gauss-Newton normal equations.

A *problem* is one material with its own parameters and n samples. B problems are B * n lanes of one kernel, problem
after problem; they share the networks. Fitting one material from several starts, many texels, or training are all this.
The formula of the loss itself is in :mod:`mi_enhance.fitting.losses`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from ..analytic import parameter_space, parameters
from ..neural import trainable
from ..neural.enhanced_brdf import EnhancedBRDF
from .losses import compressed

# Lanes per block of the float32 products that make up the normal equations; blocks are added in float64.
_BLOCK = 4096


class Objective:
    """Log-L1 loss of B materials with n samples each.

    Parameters
    ----------
    brdf : EnhancedBRDF
    wi, wo : mi.Vector3f, B * n lanes
        Directions towards viewer and light.
    f : mi.Color3f, B * n lanes
        Measured reflectance, 1/sr, at least 0.
    n : int
        Samples per problem.
    evaluators : dict, optional
        Network evaluators; :func:`mi_enhance.neural.trainable.fused` by default.
    """

    def __init__(self, brdf: EnhancedBRDF, wi, wo, f, n: int, evaluators: Mapping | trainable.Trainable | None = None):
        self.brdf, self.n, self.wi, self.wo = brdf, n, wi, wo
        self.n_problems = dr.width(wi) // n
        self.space = parameter_space.Space(brdf.parameters)
        # a mapping, or what can be indexed like one
        self.evaluators: Any = trainable.fused(brdf.networks) if evaluators is None else evaluators
        self._truth = [compressed(c, wo.z) for c in f]

    def _residual(self, f) -> list[mi.Float]:
        return [t - compressed(c, self.wo.z) for t, c in zip(self._truth, f, strict=True)]

    def _lanes(self, u: np.ndarray) -> list[mi.Float]:
        """Return the parameters of each problem, (B, P), as P arrays with B * n lanes."""
        return [dr.repeat(mi.Float(column), self.n) for column in u.astype(np.float32).T]

    def residuals(self, u: np.ndarray) -> list[mi.Float]:
        """Return the differences of the logarithms, an array of B * n lanes per channel, for parameters (B, P)."""
        with dr.suspend_grad():
            params = parameters.unflatten(self.brdf.parameters, self.space.to_physical(self._lanes(u)))
            return self._residual(self.brdf(self.wi, self.wo, params, self.evaluators))

    def loss(self, u: np.ndarray) -> np.ndarray:
        """Return the mean absolute difference of the logarithms per problem, (B,), for parameters (B, P)."""
        total = dr.block_sum(sum(dr.abs(r) for r in self.residuals(u)), self.n)
        return np.array(total, np.float64) / (3 * self.n)

    def normal_equations(self, u: np.ndarray, epsilon: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Reweighted least squares at `u`: the smooth loss sqrt(r^2 + epsilon^2) to second order.

        Parameters
        ----------
        u : array (B, P)
        epsilon : array (B,)
            Residuals much smaller than this count quadratically, which keeps the weights 1/|r| of L1 finite.

        Returns
        -------
        h : array (B, P, P)
            Approximate second derivatives of the mean smooth loss.
        g : array (B, P)
            Its gradient.
        loss : array (B,)
            Its value.
        """
        p_leaves = self._lanes(u)
        dr.enable_grad(p_leaves)
        params = parameters.unflatten(self.brdf.parameters, self.space.to_physical(p_leaves))
        graph, record, active = self.brdf.prepare(self.wi, self.wo, params, self.evaluators)
        colours = parameters.colours(self.brdf.parameters)
        # Everything below the colours is a scalar: one backward pass through the modules serves all three channels.
        values = {node.name: node(record) for node in _scalar_parts(graph, colours)}
        cuts = {name: v for name, v in values.items() if dr.grad_enabled(v)}  # an analytic B is the number 1
        heads = {name: dr.detach(v) for name, v in cuts.items()}
        dr.enable_grad(list(heads.values()))
        frozen = {name: (lambda *_, v=v: v) for name, v in heads.items()}
        r = self._residual(graph.replace(frozen)(record) & active)
        inputs = [*p_leaves, *heads.values()]
        rows = [_gradient(c, inputs, mi.Float(1)) for c in r]
        scalar = [_gradient(v, p_leaves, mi.Float(1)) for v in cuts.values()]
        eps = dr.repeat(mi.Float(epsilon.astype(np.float32)), self.n)
        n_p = u.shape[1]
        # Blocks do not straddle problems; the last one of a problem may not be full.
        blocks = -(-self.n // _BLOCK)
        block = -(-self.n // blocks)
        shape = (self.n_problems * blocks, n_p + 1, 3 * block)
        buffer = (dr.empty if blocks * block == self.n else dr.zeros)(mi.Float, int(np.prod(shape)))
        # (block of lanes, row, lane in the block): the products below then need no further rearrangement
        index = dr.arange(mi.UInt32, self.n_problems * self.n)
        sample = index % self.n
        base = (index // self.n * blocks + sample // block) * (block * (n_p + 1) * 3) + sample % block
        total: Any = 0
        for k, (residual, row) in enumerate(zip(r, rows, strict=True)):
            value = dr.detach(residual)
            smooth = dr.sqrt(dr.square(value) + dr.square(eps))
            total += smooth
            scale = dr.rsqrt(smooth)
            columns = [sum((row[n_p + j] * s[p] for j, s in enumerate(scalar)), row[p]) for p in range(n_p)]
            for p, column in enumerate([*columns, value]):
                dr.scatter(buffer, scale * column, base + (p * 3 + k) * block, mode=dr.ReduceMode.NoConflicts)
        dr.eval(buffer, total)  # together: alone, the loss would take the networks a second time
        a = mi.TensorXf(buffer, shape)
        products = np.array(dr.matmul(a, a, Bt=True), np.float64).reshape(self.n_problems, -1, n_p + 1, n_p + 1).sum(1)
        products /= 3 * self.n
        loss = np.array(dr.block_sum(total, self.n), np.float64) / (3 * self.n)
        return products[:, :n_p, :n_p], products[:, :n_p, n_p], loss

    def gradient(self, flat: mi.Float) -> tuple[mi.Float, mi.Float]:
        """Return the mean loss of all problems and its gradient.

        Parameters
        ----------
        flat : mi.Float, P * B entries
            Optimized parameters, parameter after parameter, with gradients enabled.

        Returns
        -------
        loss : mi.Float, B * n lanes
            Per sample, mean over the channels.
        gradient : mi.Float, P * B entries
        """
        problem = dr.arange(mi.UInt32, self.n_problems)
        u = [dr.gather(mi.Float, flat, problem + k * self.n_problems) for k in range(self.brdf.n_parameters)]
        params = parameters.unflatten(self.brdf.parameters, self.space.to_physical(u))
        folded = self.brdf.fold(params, self.evaluators)
        # The values of a problem become B * n lanes wide by hand, so that its gradient is summed in one go below.
        narrow = [*_arrays(params), *(v for bias in folded.values() for v in bias)]
        wide = [dr.repeat(dr.detach(v), self.n) for v in narrow]
        dr.enable_grad(wide)
        rest = iter(wide)
        wide_params = _like(params, rest)
        wide_folded = {slot: [next(rest) for _ in bias] for slot, bias in folded.items()}
        r = self._residual(self.brdf(self.wi, self.wo, wide_params, self.evaluators, wide_folded))
        loss = sum((dr.abs(c) for c in r[1:]), dr.abs(r[0])) / 3
        backward(loss, 1 / dr.width(loss))
        wide_gradient = dr.grad(wide)
        dr.eval(dr.detach(loss), wide_gradient)
        backward(narrow, [dr.block_sum(g, self.n) for g in wide_gradient])
        return dr.detach(loss), dr.grad(flat)


def backward(variables, gradients) -> None:
    """Propagate given gradients of `variables` to whatever they were computed from."""
    dr.set_grad(variables, gradients)
    dr.enqueue(dr.ADMode.Backward, variables)
    dr.traverse(dr.ADMode.Backward)


def _gradient(value, inputs: list, seed) -> list[mi.Float]:
    """Return the derivatives of one or more values with respect to `inputs`, lane by lane; the graph stays for others.

    Parameters
    ----------
    value : mi.Float or list of mi.Float
    inputs : list of mi.Float
    seed : mi.Float or list of mi.Float
        What the derivatives of each value are multiplied by.
    """
    dr.set_grad(value, seed)
    dr.enqueue(dr.ADMode.Backward, value)
    dr.traverse(dr.ADMode.Backward, flags=dr.ADFlag.ClearInterior)
    result = dr.grad(inputs)
    dr.clear_grad(inputs)
    dr.clear_grad(value)
    return result


def _scalar_parts(node, colours: set[str]) -> list:
    """Return the largest subgraphs that read none of the `colours`: operands of operators, one of which does."""
    if not node.args or not node.reads(colours):
        return []
    parts = []
    for a in node.args:
        parts += _scalar_parts(a, colours) if a.reads(colours) else [a]
    return parts


def _arrays(params: dict) -> Iterator[mi.Float]:
    """Yield all arrays of a parameter dictionary, colours and lists taken apart."""
    for v in params.values():
        yield from [v] if isinstance(v, mi.Float) else v


def _like(params: dict, arrays: Iterator[mi.Float]) -> dict:
    """Return a parameter dictionary of the same form with other arrays."""
    result: dict[str, Any] = {}
    for name, v in params.items():
        if isinstance(v, mi.Float):
            result[name] = next(arrays)
        else:
            parts = [next(arrays) for _ in v]
            result[name] = mi.Color3f(*parts) if isinstance(v, mi.Color3f) else parts
    return result
