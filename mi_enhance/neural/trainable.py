"""Modules with gradients of their weights."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from typing import Any

import drjit as dr
import drjit.nn as dnn
import mitsuba as mi
import numpy as np

from .baked import _head
from .mlp import MLP, SLOPE, _split, flatten, unflatten


class Trainable:
    """All modules of a BRDF over one flat weight vector, with gradients: ``trainable[slot]`` is an evaluator.

    One fused kernel runs forward and backward through cooperative vectors and writes activations and output gradients;
    :meth:`gradient` then forms the weight gradients as matrix products. ``drjit.nn`` with automatic differentiation
    adds outer products to memory atomically, which is several times slower on LLVM.

    Parameters
    ----------
    modules : dict of str to MLP
        The modules by slot.
    """

    def __init__(self, modules: Mapping[str, MLP]):
        self._modules = modules
        self.pending: list[tuple] = []  # operands of the weight gradients: offsets, activations, output gradients
        self._slots, offset = {}, 0
        for slot, mlp in modules.items():
            self._slots[slot] = _TrainableSlot(self, mlp, offset)
            offset += mlp.n_weights
        # Attached: gradients are wanted. With detached weights the modules only pass gradients on to their inputs.
        self.weights = mi.Float(flatten(modules)) if modules else dr.zeros(mi.Float, 1)
        dr.enable_grad(self.weights)

    def __getitem__(self, slot: str) -> _TrainableSlot:
        return self._slots[slot]

    def modules(self) -> dict[str, MLP]:
        """Return modules with the current weights."""
        return unflatten(self._modules, np.array(dr.detach(self.weights)))

    def gradient(self) -> mi.Float:
        """Return the gradient of the flat weight vector, from all backward passes since the last call.

        Must follow ``dr.backward``; evaluates every kernel that is still open.
        """
        pending, result = self.take(), np.zeros(len(self.weights), np.float32)
        dr.eval([(a, z) for *_, a, z in pending])
        for w_offset, b_offset, a, z in pending:
            # dW = sum over samples of (output gradient) x (input); the input of a bias is 1
            for offset, x in ((w_offset, a), (b_offset, None)):
                if offset is not None:
                    product = np.ravel(_product(z, x))
                    result[offset : offset + product.size] += product
        return mi.Float(result)

    def take(self) -> list[tuple]:
        """Return the content of :attr:`pending`, and empty it."""
        pending, self.pending = self.pending, []
        return pending


def fused(modules: Mapping[str, MLP]) -> Trainable:
    """Return evaluators of fixed weights for kernels outside of a BSDF.

    They compile fast whatever the weights are: the first evaluation of ``ggx2`` takes 0.4 s, of ``paper`` 0.6 s, where
    baked weights take 1.6 and 3.3 s, and as long again for every other network (Mitsuba 3.9.1, LLVM, an empty cache).
    """
    evaluators = Trainable(dict(modules))
    dr.disable_grad(evaluators.weights)
    return evaluators


# Rows per product on the CPU: small enough for one core's cache, and for OpenBLAS to stay on one thread; its threads
# wait for each other at every product, and on a busy machine for long.
_ROWS = 512


def _product(z: mi.TensorXf, a: mi.TensorXf | None):
    """Return Z^T A of two tall matrices of the same height; without `a` the sum of the rows of Z."""
    if dr.backend_v(mi.Float) == dr.JitBackend.CUDA:
        return dr.sum(z, axis=0) if a is None else dr.matmul(z, a, At=True)
    # NumPy on the same memory: Dr.Jit starts a kernel for every 256 rows, which takes about five times as long.
    tall_z = np.asarray(z)
    tall_a = np.ones((len(tall_z), 1), np.float32) if a is None else np.asarray(a)
    whole = len(tall_z) // _ROWS * _ROWS
    zs, xs = (v[:whole].reshape(-1, _ROWS, v.shape[1]) for v in (tall_z, tall_a))
    return np.matmul(zs.transpose(0, 2, 1), xs).sum(0) + tall_z[whole:].T @ tall_a[whole:]


def _rows(columns: Sequence[mi.Float], n: int) -> mi.TensorXf:
    """Write C arrays of N lanes as one (N, C) tensor."""
    c = len(columns)
    buffer = dr.empty(mi.Float, n * c)
    index = dr.arange(mi.UInt32, n)
    if c == 1:
        dr.scatter(buffer, columns[0], index)
    else:
        array = sys.modules[mi.Float.__module__].ArrayXf  # of the active backend; mi has no name for it
        dr.scatter(buffer, array([dr.detach(c) for c in columns]), index)
    return mi.TensorXf(buffer, (n, c))


class _TrainableSlot:
    """Evaluator of one module over a part of the flat weight vector."""

    def __init__(self, owner: Trainable, mlp: MLP, offset: int):
        self._owner, self._modulated = owner, mlp.modulated
        self._first = len(mlp.layers[0][1])
        self._places = []
        for v in _split(mlp):
            self._places.append((offset, v.shape))
            offset += v.size

    def _view(self, k: int) -> dnn.MatrixView:
        offset, shape = self._places[k]
        rows, cols = shape if len(shape) == 2 else (shape[0], 1)
        view = dnn.MatrixView()
        view.dtype, view.layout = dr.type_v(mi.Float), "row_major"
        view.shape, view.stride, view.offset, view.size = (rows, cols), cols, offset, rows * cols
        view.buffer = dr.detach(self._owner.weights)
        return view

    def fold(self, features: Sequence[Any], begun: Sequence[mi.Float] | None = None) -> list[mi.Float]:
        """See :meth:`mi_enhance.neural.evaluator.Evaluator.fold`."""
        if not features:
            return []
        x = [mi.Float(0) if v is None else v for v in features]
        last = len(self._places) - 2
        layers = [(0, 2), (last, last + 1)] if self._modulated else [(0, 2)]
        if begun is None:
            return [v for layer in layers for v in self._run([layer], x, None)]
        parts = begun[: self._first], begun[self._first :]
        return [v for (k, _), b in zip(layers, parts, strict=False) for v in self._run([(k, None)], x, list(b))]

    def __call__(self, x: Sequence[mi.Float], folded: Sequence[mi.Float]) -> list[mi.Float]:
        """See :meth:`mi_enhance.neural.evaluator.Evaluator.__call__`; `folded` is empty if no input is constant."""
        bias, head = list(folded[: self._first]), folded[self._first :]
        later = [(k, k + 1) for k in range(3, len(self._places) - (2 if head else 0), 2)]
        first = (1 if x else None, None if bias else 2)
        z = self._run([first, *later], x, bias or None)
        return _head(z, head) if head else z

    def _run(self, layers, x, bias):
        return list(dr.custom(_TrainableOp, self, layers, [mi.Float(v) for v in x], bias, self._owner.weights))


class _TrainableOp(dr.CustomOp):
    """Forward and backward through cooperative vectors; leaves the operands of the weight gradients with the owner."""

    def eval(self, slot, layers, x, bias, weights):
        # `weights` makes the result depend on them; their gradient is formed by the owner
        self.slot, self.layers, self.inputs, self.positive = slot, layers, [x], []
        self.record = dr.grad_enabled(slot._owner.weights)
        self.has_bias = bias is not None
        z = None
        for k_w, k_b in layers:
            if z is not None:
                self.positive.append([v > 0 for v in z])
                self.inputs.append([dr.select(v > 0, v, SLOPE * v) for v in z])
            if k_w is None:  # a module without directions: its first layer is the bias
                z = list(bias)
                continue
            vector: Any = dnn.CoopVec(*self.inputs[-1])
            if k_b is None:
                z = list(dnn.matvec(slot._view(k_w), vector) + dnn.CoopVec(*bias))
            else:
                z = list(dnn.matvec(slot._view(k_w), vector, slot._view(k_b)))
        return z

    def backward(self):
        grad: Any = self.grad_out()
        dz = list(grad)
        n = dr.width(dz, self.inputs[0])
        places = self.slot._places
        for k in range(len(self.layers) - 1, -1, -1):
            k_w, k_b = self.layers[k]
            if k == 0 and self.has_bias:
                self.set_grad_in("bias", dz)
            if k_w is None:
                break
            if self.record:
                b_offset = None if k_b is None else places[k_b][0]
                self.slot._owner.pending.append((places[k_w][0], b_offset, _rows(self.inputs[k], n), _rows(dz, n)))
            da: list[Any] = list(dnn.matvec(self.slot._view(k_w), dnn.CoopVec(*dz), transpose=True))
            if k == 0:
                self.set_grad_in("x", da)
            else:
                dz = [dr.select(p, a, SLOPE * a) for p, a in zip(self.positive[k - 1], da, strict=True)]

    def name(self):
        return "mi_enhance.neural.trainable.Trainable"
