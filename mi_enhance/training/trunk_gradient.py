"""Gradients of a shared trunk and of the read-outs of many materials: three kernels with matrix products between.

A read-out is hundreds of numbers of one material. As per-lane data of one kernel they would be gathered for every
sample; as one small matrix product for each material they cost next to nothing.
"""

from __future__ import annotations

from typing import Any, cast

import drjit as dr
import mitsuba as mi
import numpy as np

from ..analytic import geometry, parameters
from ..analytic.parameter_space import Space
from ..fitting.losses import compressed
from ..fitting.objective import _arrays, _like, backward
from ..neural import trunk as trunk_module
from ..neural.enhanced_brdf import EnhancedBRDF
from ..neural.replacements import scaled
from ..neural.trainable import Trainable
from ..neural.trunk import NAME, Trunk
from ..numerics import columns
from ..system.garbage_collection import no_collection


class TrunkGradient:
    """Loss (eq. 1) of M materials with n samples each, and its gradients.

    Parameters
    ----------
    brdf : EnhancedBRDF
        With a trunk.
    n_materials, n : int
        Materials, and samples of each.
    evaluators : Trainable
        Of the trunk's weights, whose gradient :meth:`Trainable.gradient` gives after a call.
    fixed : bool
        The weights of the trunk stay as they are, and have no gradient.
    """

    def __init__(self, brdf: EnhancedBRDF, n_materials: int, n: int, evaluators: Trainable, fixed: bool = False):
        self.fixed = fixed
        self.brdf, self.n_materials, self.n, self.evaluators = brdf, n_materials, n, evaluators
        self.trunk = cast(Trunk, brdf.trunk)
        self._parameters = brdf.parameters[:-1]  # all but the read-out
        self._space = Space(self._parameters)
        # Tracing takes as long as the kernels; they are the same in every step.
        self._forward = dr.freeze(lambda *inputs: self._trace_forward(*inputs))
        self._middle = dr.freeze(lambda *inputs: self._trace_middle(*inputs))
        self._backward = dr.freeze(lambda *inputs: self._trace_backward(*inputs))

    def __call__(
        self,
        weights: mi.Float,
        flat: mi.Float,
        read_out: np.ndarray,
        data: list[mi.Float],
        index: mi.UInt32,
        counts: mi.Float,
    ) -> tuple[np.ndarray, mi.Float, np.ndarray]:
        """Return the loss of every material, and the gradients of parameters and read-outs, of the mean loss.

        Parameters
        ----------
        weights : mi.Float
            Of the trunk.
        flat : mi.Float, P * M entries
            Optimized parameters but for the read-out, parameter after parameter.
        read_out : array (M, size)
        data : list of 9 mi.Float
            Rows wi, wo, f of all samples.
        index : mi.UInt32, M * n lanes
            The samples of this step, material after material.
        counts : mi.Float, M entries
            How much every material counts in the mean loss whose gradient this is.
        """
        m, n = self.n_materials, self.n
        r = self.trunk.matrix(read_out)
        with no_collection():
            loss, direct, phi, dy = self.to_logs(weights, flat, read_out, data, index, counts)
            dr_ = np.concatenate([np.matmul(dy, phi.transpose(0, 2, 1)), dy.sum(2, keepdims=True)], axis=2)
            dphi = np.matmul(r[:, :, :-1].transpose(0, 2, 1), dy)
            dphi = mi.Float(np.ascontiguousarray(dphi.transpose(1, 0, 2)).ravel())
            through, self.evaluators.pending = self._backward(weights, flat, dphi, data, index)
        return np.array(loss, np.float64) / n, direct + through, dr_.reshape(m, -1)

    def to_logs(
        self, weights, flat, read_out, data, index, counts
    ) -> tuple[mi.Float, mi.Float, np.ndarray, np.ndarray]:
        """Return what a step needs from the loss to the logarithms of the factors; arguments as of a call.

        Returns
        -------
        loss : mi.Float
            Of every material, summed over its samples.
        direct : mi.Float
            Gradient of the parameters outside of the trunk.
        phi : array (M, K, n)
            Units that are read out, a view.
        dy : array (M, outputs, n)
            Gradient of the logarithms, a view.
        """
        self.evaluators.take()  # a frozen function would take what is pending for one of its inputs
        m, n, k, n_y = self.n_materials, self.n, self.trunk.n_units, self.trunk.n_outputs
        r = self.trunk.matrix(read_out)
        packed = self._forward(weights, flat, data, index)
        # the samples of a material are consecutive
        phi = columns.matrix(packed, k).reshape(k, m, n).transpose(1, 0, 2)
        y = np.matmul(r[:, :, :-1], phi) + r[:, :, -1:]
        y = mi.Float(np.ascontiguousarray(y.transpose(1, 0, 2)).ravel())
        loss, direct, packed_dy = self._middle(flat, y, data, index, counts)
        return loss, direct, phi, columns.matrix(packed_dy, n_y).reshape(n_y, m, n).transpose(1, 0, 2)

    def _wide(self, flat: mi.Float, fold: bool = True) -> tuple[dict, dict, list, list]:
        """Return the parameters of all lanes, what is folded of them, and all of it per material and per lane."""
        material = dr.arange(mi.UInt32, self.n_materials)
        n_p = parameters.count(self._parameters)
        u = [dr.gather(mi.Float, flat, material + k * self.n_materials) for k in range(n_p)]
        params = parameters.unflatten(self._parameters, self._space.to_physical(u))
        folded = self.evaluators[NAME].fold(params["latent"]) if fold else []
        analytic = {name: v for name, v in params.items() if name != "latent"}
        narrow = [*_arrays(analytic), *folded]
        wide = [dr.repeat(dr.detach(v), self.n) for v in narrow]
        if dr.grad_enabled(flat):
            dr.enable_grad(wide)
        rest = iter(wide)
        wide_params = _like(analytic, rest)
        return wide_params, {NAME: list(rest)}, narrow, wide

    def _units(self, wi, wo, params, folded) -> list[Any]:
        q, _ = geometry.local_quantities(wi, wo, params)
        return trunk_module.active(self.brdf.units({**q, **params}, wi, wo, self.evaluators, folded))

    def _trace_forward(self, weights, flat, data, index):
        """Return the units that are read out."""
        wi, wo = _directions(data, index)
        self.evaluators.weights = weights
        params, folded, *_ = self._wide(flat)
        return columns.pack(self._units(wi, wo, params, folded))

    def _trace_middle(self, flat, y, data, index, counts):
        """Return the loss per material, and the gradients of the parameters outside of the trunk and of the logs."""
        wi, wo = _directions(data, index)
        f = [dr.gather(mi.Float, row, index) for row in data[6:]]
        flat = mi.Float(dr.detach(flat))  # its own gradients: the caller's array is the input of another kernel, too
        dr.enable_grad(flat)
        params, _, narrow, wide = self._wide(flat, fold=False)
        logs = columns.unpack(y, self.trunk.n_outputs)
        dr.enable_grad(logs)
        q, above = geometry.local_quantities(wi, wo, params)
        graph = self.brdf.model.graph
        value = graph.replace(scaled(graph, self.trunk.slots, logs))({**q, **params}) & above
        loss: Any = 0
        for truth, v in zip(f, value, strict=True):
            loss += dr.abs(compressed(truth, wo.z) - compressed(v, wo.z)) / 3
        backward(loss, dr.repeat(counts, self.n) / (self.n_materials * self.n))
        gradient = self._narrow_gradient(flat, narrow, wide)
        return dr.block_sum(dr.detach(loss), self.n), gradient, columns.pack(dr.grad(logs))

    def _trace_backward(self, weights, flat, dphi, data, index):
        """Return the gradient of the parameters that the trunk sees, and the parts of the weights'."""
        wi, wo = _directions(data, index)
        self.evaluators.weights = weights
        flat = mi.Float(dr.detach(flat))
        dr.enable_grad(flat)
        if not self.fixed:
            dr.enable_grad(weights)
        params, folded, narrow, wide = self._wide(flat)
        units = self._units(wi, wo, params, folded)
        backward(units, columns.unpack(dphi, self.trunk.n_units))
        return self._narrow_gradient(flat, narrow, wide), self.evaluators.take()

    def _narrow_gradient(self, flat, narrow, wide):
        gradient = dr.grad(wide)
        dr.eval(gradient)  # together: each sum would run the whole kernel for itself
        backward(narrow, [dr.block_sum(g, self.n) for g in gradient])
        return dr.grad(flat)


def _directions(data, index) -> tuple[mi.Vector3f, mi.Vector3f]:
    rows = [dr.gather(mi.Float, row, index) for row in data[:6]]
    return mi.Vector3f(*rows[:3]), mi.Vector3f(*rows[3:])
