"""Modules whose weights are constants of the compiled function."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from .mlp import MLP, SLOPE


def affine(w: np.ndarray, x: Sequence, b: Sequence) -> list:
    """Return W x + b with the entries of `w` as literals in the trace; entries of `x` that are None are left out."""
    out = []
    for row, z in zip(w.tolist(), b, strict=True):
        z = mi.Float(z)
        for weight, v in zip(row, x, strict=True):
            z = z if v is None else dr.fma(v, weight, z)
        out.append(z)
    return out


def _leaky(v):
    """Leaky ReLU as the larger of two numbers: one instruction, where comparing, choosing and scaling are three."""
    low = SLOPE * v
    return dr.select(v > low, v, low)


def _head(z: Sequence, weights: Sequence) -> list:
    """Apply a last layer whose weights are data to `z`, the values before the activation."""
    a = [_leaky(v) for v in z]
    step = len(a) + 1
    out = []
    for k in range(0, len(weights), step):
        y = weights[k + len(a)]
        for v, w in zip(a, weights[k : k + len(a)], strict=True):
            y = dr.fma(v, w, y)
        out.append(y)
    return out


def dense(layers: Sequence[tuple[np.ndarray, np.ndarray]], x: Sequence) -> list:
    """Evaluate a network each of whose layers sees the inputs and all hidden units so far; entries of 0 are skipped."""
    seen: list[Any] = list(x)
    z: list[Any] = []
    for k, (w, b) in enumerate(layers):
        z = []
        for row, y in zip(w.tolist(), b.tolist(), strict=True):
            for weight, v in zip(row, seen, strict=True):
                y = dr.fma(v, weight, y) if weight else y
            z.append(mi.Float(y))
        if k < len(layers) - 1:
            seen += [_leaky(v) for v in z]
    return z


class _BakedOp(dr.CustomOp):
    """Baked layers with a hand-written backward pass with respect to the inputs.

    Plain AD through thousands of literal multiply-adds can take a minute to trace and compile in a fitting kernel.
    """

    def eval(self, layers, x, bias):
        self.layers, self.hidden = layers, []
        z = affine(layers[0][0], x, bias)
        for w, b in layers[1:]:
            self.hidden.append(z)
            z = affine(w, [_leaky(v) for v in z], b.tolist())
        return z

    def _slopes(self):
        return [[dr.select(v > 0, mi.Float(1), mi.Float(SLOPE)) for v in z] for z in self.hidden]

    def backward(self):
        grad: Any = self.grad_out()
        dz = list(grad)
        for (w, _), slopes in zip(self.layers[:0:-1], self._slopes()[::-1], strict=True):
            dz = [g * s for g, s in zip(affine(w.T, dz, [0.0] * w.shape[1]), slopes, strict=True)]
        w = self.layers[0][0]
        dx = affine(w.T, dz, [0.0] * w.shape[1])
        if not dr.flag(dr.JitFlag.SymbolicScope):
            # A bias shared by many lanes is summed next, entry by entry: evaluate once instead of once per entry.
            dr.eval(dz, dx)
        self.set_grad_in("bias", dz)
        self.set_grad_in("x", dx)

    def forward(self):
        x: Any = self.grad_in("x")
        bias: Any = self.grad_in("bias")
        dz = affine(self.layers[0][0], x, bias)
        for (w, _), slopes in zip(self.layers[1:], self._slopes(), strict=True):
            dz = affine(w, [g * s for g, s in zip(dz, slopes, strict=True)], [0.0] * len(w))
        self.set_grad_out(dz)

    def name(self):
        return "mi_enhance.neural.baked.Baked"


class Baked:
    """Weights as constants of the trace, for rendering and fitting on LLVM.

    Inside a BSDF (a virtual call) cooperative vectors gather every weight per lane on LLVM, 4 to 15 times slower.
    Materials that share the weights trace to the same function, so it is compiled once; the bias stays data.
    """

    def __init__(self, mlp: MLP):
        (w, b), *rest = mlp.layers
        self._first = len(b)
        self._fold = [(w[:, : mlp.n_folded], b), *([rest.pop()] if mlp.modulated else [])]
        self._layers = [(w[:, mlp.n_folded :], b), *rest]

    def fold(self, features: Sequence, begun: Sequence[mi.Float] | None = None) -> list[mi.Float]:
        """See :meth:`mi_enhance.neural.evaluator.Evaluator.fold`."""
        begun = [v for _, b in self._fold for v in b.tolist()] if begun is None else begun
        first, head = begun[: self._first], begun[self._first :]
        return [v for (w, _), b in zip(self._fold, (first, head), strict=False) for v in affine(w, features, b)]

    def __call__(self, x: Sequence[mi.Float], folded: Sequence[mi.Float]) -> list[mi.Float]:
        """See :meth:`mi_enhance.neural.evaluator.Evaluator.__call__`."""
        x, bias, head = list(x), list(folded[: self._first]), folded[self._first :]
        if dr.grad_enabled(x, bias):
            z = list(dr.custom(_BakedOp, self._layers, x, bias))
        else:
            z = _BakedOp().eval(self._layers, x, bias)
        return _head(z, head) if head else z


class Stored:
    """Weights as data: folds the constants of a scene, once, in a kernel that serves all modules of these sizes.

    With literal weights that kernel would take half a second to compile, for one lane.
    """

    def __init__(self, mlp: MLP):
        self._baked = Baked(mlp)
        w, b = (np.concatenate(parts) for parts in zip(*self._baked._fold, strict=True))
        self._weights, self._bias = mi.TensorXf(np.ascontiguousarray(w)), mi.Float(b)

    def fold(self, features: Sequence, begun: Sequence[mi.Float] | None = None) -> list[mi.Float]:
        """As :meth:`Baked.fold`, of features of one lane."""
        flat: Any = self._bias if begun is None else dr.concat(list(begun))
        if features:
            x = dr.zeros(mi.Float, len(features))  # what is None adds nothing
            for k, v in enumerate(features):
                if v is not None:
                    dr.scatter(x, v, mi.UInt32(k), mode=dr.ReduceMode.NoConflicts)
            product: Any = dr.matmul(self._weights, mi.TensorXf(x, (len(features), 1)))
            flat = flat + product.array
        dr.eval(flat)
        return [dr.gather(mi.Float, flat, k) for k in range(len(flat))]

    def __call__(self, x: Sequence[mi.Float], folded: Sequence[mi.Float]) -> list[mi.Float]:
        """As :meth:`Baked.__call__`."""
        return self._baked(x, folded)
