"""The small networks that stand in for terms and operators: sizes, first weights, three evaluators behind one call.

The only file that touches ``drjit.nn``. Every evaluator has ``fold(features)``, which turns the inputs that are
constant for a material into a bias of the first layer (exact), and ``__call__(x, bias)`` for the inputs that vary.
Paper, section 3 and Fig. 3: four fully connected layers, 16, 32, 16 hidden neurons, leaky ReLU, last layer linear.
"""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Sequence

import drjit as dr
import drjit.nn as dnn
import mitsuba as mi
import numpy as np

HIDDEN = (16, 32, 16)
SLOPE = 0.01  # of the leaky ReLU below 0; PyTorch's and Dr.Jit's default, the paper names none
_HALF_MAX = 65504.0  # of the numbers in half precision


@dataclasses.dataclass(frozen=True)
class MLP:
    """Weights of one network.

    Parameters
    ----------
    layers : tuple of (W, b)
        Float32 arrays, W of shape (out, in), b of shape (out,).
    n_folded : int
        The first `n_folded` inputs are constant over a material and can be folded into a bias.
    modulated : bool
        The last layer belongs to the material: its weights and biases are an affine function of the folded inputs,
        whose matrix (out * (hidden + 1), n_folded) and offset stand in its place. Folded, it is a last layer like any.
    """

    layers: tuple[tuple[np.ndarray, np.ndarray], ...]
    n_folded: int = 0
    modulated: bool = False

    @property
    def sizes(self) -> tuple[int, ...]:
        """Input size, hidden sizes, output size."""
        sizes = [self.layers[0][0].shape[1], *(len(b) for _, b in self.layers)]
        if self.modulated:
            sizes[-1] //= sizes[-2] + 1
        return tuple(sizes)

    @property
    def varies(self) -> bool:
        """False if all inputs are constant over a material: a network without directions."""
        return self.sizes[0] > self.n_folded

    @property
    def n_weights(self) -> int:
        """Number of floats, biases included.

        Examples
        --------
        >>> xavier((45, *HIDDEN, 1), 39, np.random.default_rng(0)).n_weights
        1825
        """
        return sum(w.size + b.size for w, b in self.layers)


def xavier(sizes: Sequence[int], n_folded: int, rng: np.random.Generator, modulated: bool = False) -> MLP:
    """Xavier (Glorot) uniform weights, zero biases: the paper's initialisation (section 4.3).

    A modulated last layer is the one Xavier draws plus, for folded inputs of size 1, as much again.

    ``drjit.nn.Linear`` draws from another range, so the weights are drawn here.

    References
    ----------
    Glorot and Bengio 2010, *Understanding the Difficulty of Training Deep Feedforward Neural Networks*, eq. (16).
    """
    layers = []
    for n_in, n_out in zip(sizes, sizes[1:], strict=False):
        limit = np.sqrt(6 / (n_in + n_out))
        layers.append((rng.uniform(-limit, limit, (n_out, n_in)).astype(np.float32), np.zeros(n_out, np.float32)))
    if modulated:
        w, b = layers.pop()
        spread = np.abs(w).max() / np.sqrt(n_folded)
        offset = np.append(w, b[:, None], axis=1).ravel()
        layers.append((rng.uniform(-spread, spread, (offset.size, n_folded)).astype(np.float32), offset))
    return MLP(tuple(layers), n_folded, modulated)


def _split(mlp: MLP) -> list[np.ndarray]:
    """Weights in storage order; the folded and the varying part of the first matrix are apart: each is contiguous."""
    (w, b), *rest = mlp.layers
    return [w[:, : mlp.n_folded], w[:, mlp.n_folded :], b, *(v for layer in rest for v in layer)]


def flatten(networks: dict[str, MLP]) -> np.ndarray:
    """All weights as one float32 vector."""
    return np.concatenate([np.zeros(0, np.float32), *(v.ravel() for mlp in networks.values() for v in _split(mlp))])


def unflatten(networks: dict[str, MLP], flat: np.ndarray) -> dict[str, MLP]:
    """Networks of the same shapes as `networks` with the weights of :func:`flatten`."""
    offset, result = 0, {}
    for slot, mlp in networks.items():
        parts = []
        for v in _split(mlp):
            parts.append(flat[offset : offset + v.size].reshape(v.shape).astype(np.float32))
            offset += v.size
        folded, varying, bias, *rest = parts
        first = np.concatenate([folded, varying], axis=1), bias
        layers = (first, *zip(rest[::2], rest[1::2], strict=True))
        result[slot] = dataclasses.replace(mlp, layers=layers)
    return result


def affine(w: np.ndarray, x: Sequence, b: Sequence) -> list:
    """W x + b with the entries of `w` written as literals into the trace; what is None in `x` is left out."""
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
    """A last layer whose weights are data, on what comes before its activation."""
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
    seen = list(x)
    for k, (w, b) in enumerate(layers):
        z = []
        for row, y in zip(w.tolist(), b.tolist(), strict=True):
            for weight, v in zip(row, seen, strict=True):
                y = dr.fma(v, weight, y) if weight else y
            z.append(mi.Float(y))
        if k == len(layers) - 1:
            return z
        seen += [_leaky(v) for v in z]


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
        dz = list(self.grad_out())
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
        dz = affine(self.layers[0][0], self.grad_in("x"), self.grad_in("bias"))
        for (w, _), slopes in zip(self.layers[1:], self._slopes(), strict=True):
            dz = affine(w, [g * s for g, s in zip(dz, slopes, strict=True)], [0.0] * len(w))
        self.set_grad_out(dz)

    def name(self):
        return "mi_enhance.nn.Baked"


class Baked:
    """Weights as constants of the trace: what rendering and fitting use on LLVM.

    Inside a BSDF (a virtual call) cooperative vectors gather every weight per lane on LLVM, 4 to 15 times slower.
    Materials that share the weights trace to the same function, so it is compiled once; the bias stays data.
    """

    def __init__(self, mlp: MLP):
        (w, b), *rest = mlp.layers
        self._first = len(b)
        self._fold = [(w[:, : mlp.n_folded], b), *([rest.pop()] if mlp.modulated else [])]
        self._layers = [(w[:, mlp.n_folded :], b), *rest]

    def fold(self, features: Sequence, begun: Sequence[mi.Float] | None = None) -> list[mi.Float]:
        """What the inputs that are constant over a material become: first bias, weights of a modulated last layer.

        Linear, so it can be done in two parts: without the features that are None, and later, with `begun`, those.
        """
        begun = [v for _, b in self._fold for v in b.tolist()] if begun is None else begun
        first, head = begun[: self._first], begun[self._first :]
        return [v for (w, _), b in zip(self._fold, (first, head), strict=False) for v in affine(w, features, b)]

    def __call__(self, x: Sequence[mi.Float], folded: Sequence[mi.Float]) -> list[mi.Float]:
        """Output of the network for varying inputs `x` and what :meth:`fold` returned."""
        x, bias, head = list(x), list(folded[: self._first]), folded[self._first :]
        if dr.grad_enabled(x, bias):
            z = list(dr.custom(_BakedOp, self._layers, x, bias))
        else:
            z = _BakedOp().eval(self._layers, x, bias)
        return _head(z, head) if head else z


class Stored:
    """Weights as data: folds what is the same everywhere, once, in a kernel that serves all networks of these sizes.

    With literal weights that kernel would take half a second to compile, for one lane.
    """

    def __init__(self, mlp: MLP):
        self._baked = Baked(mlp)
        w, b = (np.concatenate(parts) for parts in zip(*self._baked._fold, strict=True))
        self._weights, self._bias = mi.TensorXf(np.ascontiguousarray(w)), mi.Float(b)

    def fold(self, features: Sequence) -> list[mi.Float]:
        """As :meth:`Baked.fold`, in one go, of features of one lane; they must be detached."""
        flat = self._bias
        if features:
            x = dr.zeros(mi.Float, len(features))  # what is None adds nothing
            for k, v in enumerate(features):
                if v is not None:
                    dr.scatter(x, v, mi.UInt32(k), mode=dr.ReduceMode.NoConflicts)
            flat = flat + dr.matmul(self._weights, mi.TensorXf(x, (len(features), 1))).array
        dr.eval(flat)
        return [dr.gather(mi.Float, flat, k) for k in range(len(flat))]

    def __call__(self, x: Sequence[mi.Float], folded: Sequence[mi.Float]) -> list[mi.Float]:
        """As :meth:`Baked.__call__`."""
        return self._baked(x, folded)


class Cooperative:
    """Cooperative vectors: tensor cores on CUDA, where matrices must be half precision; float32 elsewhere.

    Parameters
    ----------
    mlp : MLP
    half : bool, optional
        Half precision for all but what is folded and the factors of the output; by default where it must be. What
        leaves a layer is kept small enough for the next one to stay within the range, whatever the parameters.
    """

    def __init__(self, mlp: MLP, half: bool | None = None):
        half = dr.backend_v(mi.Float) == dr.JitBackend.CUDA if half is None else half
        dtype = dr.float16_array_t(mi.TensorXf) if half else mi.TensorXf
        (w, b), *rest = mlp.layers
        self._baked, self._first = Baked(mlp), len(b)
        rest = rest[:-1] if mlp.modulated else rest
        # A network without directions (M, S) has no first matrix here: its first layer is the bias alone.
        flat = [dtype(np.ascontiguousarray(w[:, mlp.n_folded :]))] if mlp.n_folded < w.shape[1] else []
        for layer in rest:
            flat += [dtype(v) for v in layer]
        self._packed = dnn.pack(*flat, layout="inference")
        self._scalar = dr.float16_array_t(mi.Float) if half else mi.Float
        # Largest sum of a row times this is the largest half number: no partial sum overflows, and none is inf - inf.
        gains = [np.abs(w).sum(1).max() + np.abs(b).max() for w, b in rest]
        self._limit = float(_HALF_MAX / max(1.0, *gains)) if half and rest else None

    def fold(self, features: Sequence, begun: Sequence[mi.Float] | None = None) -> list[mi.Float]:
        """As :meth:`Baked.fold`."""
        return self._baked.fold(features, begun)

    def __call__(self, x: Sequence[mi.Float], folded: Sequence[mi.Float]) -> list[mi.Float]:
        """As :meth:`Baked.__call__`."""
        bias, head = folded[: self._first], folded[self._first :]
        packed = self._packed if isinstance(self._packed, tuple) else (self._packed,)
        if self._limit:
            bias = [dr.clip(v, -self._limit, self._limit) for v in bias]
        z = dnn.CoopVec(*map(self._scalar, bias))
        if x:
            z, packed = dnn.matvec(packed[0], dnn.CoopVec(*map(self._scalar, x))) + z, packed[1:]
        for w, b in zip(packed[::2], packed[1::2], strict=True):
            z = dr.fma(dr.minimum(z, 0), SLOPE, dr.maximum(z, 0))
            z = dnn.matvec(w, dr.minimum(dr.maximum(z, -self._limit), self._limit) if self._limit else z, b)
        z = [mi.Float(v) for v in z]
        return _head(z, head) if head else z


class Trainable:
    """All networks of a BRDF over one flat weight vector, with gradients: ``trainable[slot]`` is an evaluator.

    One fused kernel runs forward and backward through cooperative vectors and writes activations and output gradients;
    :meth:`gradient` then forms the weight gradients as matrix products. ``drjit.nn`` with automatic differentiation
    adds outer products to memory atomically, which is several times slower on LLVM.

    Parameters
    ----------
    networks : dict of str to MLP
        The networks by slot.
    """

    def __init__(self, networks: dict[str, MLP]):
        self._networks = networks
        self.pending = []  # operands of the weight gradients: offsets, activations, output gradients
        self._slots, offset = {}, 0
        for slot, mlp in networks.items():
            self._slots[slot] = _TrainableSlot(self, mlp, offset)
            offset += mlp.n_weights
        # Attached: gradients are wanted. With detached weights the networks only pass gradients on to their inputs.
        self.weights = mi.Float(flatten(networks)) if networks else dr.zeros(mi.Float, 1)
        dr.enable_grad(self.weights)

    def __getitem__(self, slot: str) -> _TrainableSlot:
        return self._slots[slot]

    def networks(self) -> dict[str, MLP]:
        """The current weights as plain arrays."""
        return unflatten(self._networks, np.array(dr.detach(self.weights)))

    def gradient(self) -> mi.Float:
        """Gradient of the flat weight vector, from all backward passes since the last call.

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

    def take(self) -> list:
        """Hand out what :attr:`pending` holds, and forget it."""
        pending, self.pending = self.pending, []
        return pending


# Rows per product on the CPU: small enough for one core's cache, and for OpenBLAS to stay on one thread; its threads
# wait for each other at every product, and on a busy machine for long.
_ROWS = 512


def _product(z: mi.TensorXf, a: mi.TensorXf | None):
    """Z^T A of two tall matrices of the same height; without `a` the sum of the rows of Z."""
    if dr.backend_v(mi.Float) == dr.JitBackend.CUDA:
        return dr.sum(z, axis=0) if a is None else dr.matmul(z, a, At=True)
    # NumPy on the same memory: Dr.Jit starts a kernel for every 256 rows, which takes about five times as long.
    z, a = np.asarray(z), np.ones((len(z), 1), np.float32) if a is None else np.asarray(a)
    whole = len(z) // _ROWS * _ROWS
    zs, xs = (v[:whole].reshape(-1, _ROWS, v.shape[1]) for v in (z, a))
    return np.matmul(zs.transpose(0, 2, 1), xs).sum(0) + z[whole:].T @ a[whole:]


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
    """Evaluator of one network over a part of the flat weight vector."""

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

    def fold(self, features: Sequence[mi.Float]) -> list[mi.Float]:
        """As :meth:`Baked.fold`."""
        if not features:
            return []
        folded = self._run([(0, 2)], features, None)
        last = len(self._places) - 2
        return folded + (self._run([(last, last + 1)], features, None) if self._modulated else [])

    def __call__(self, x: Sequence[mi.Float], folded: Sequence[mi.Float]) -> list[mi.Float]:
        """Output of the network for varying inputs `x` and what :meth:`fold` returned (empty if nothing is folded)."""
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
            if k_w is None:  # a network without directions: its first layer is the bias
                z = list(bias)
                continue
            vector = dnn.CoopVec(*self.inputs[-1])
            if k_b is None:
                z = list(dnn.matvec(slot._view(k_w), vector) + dnn.CoopVec(*bias))
            else:
                z = list(dnn.matvec(slot._view(k_w), vector, slot._view(k_b)))
        return z

    def backward(self):
        dz = list(self.grad_out())
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
            da = list(dnn.matvec(self.slot._view(k_w), dnn.CoopVec(*dz), transpose=True))
            if k == 0:
                self.set_grad_in("x", da)
            else:
                dz = [dr.select(p, a, SLOPE * a) for p, a in zip(self.positive[k - 1], da, strict=True)]

    def name(self):
        return "mi_enhance.nn.Trainable"
