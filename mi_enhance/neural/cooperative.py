"""Modules evaluated by cooperative vectors: tensor cores on CUDA."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import drjit as dr
import drjit.nn as dnn
import mitsuba as mi
import numpy as np

from .baked import Baked, _head
from .mlp import MLP, SLOPE

_HALF_MAX = 65504.0  # of the numbers in half precision


class Cooperative:
    """Cooperative vectors: tensor cores on CUDA, where matrices must be half precision; float32 elsewhere.

    Parameters
    ----------
    mlp : MLP
    half : bool, optional
        Half precision for all but the folded inputs and the factors of the output; by default where it must be. The
        outputs of a layer are kept small enough for the next one to stay within the range, whatever the parameters.
    """

    def __init__(self, mlp: MLP, half: bool | None = None):
        half = dr.backend_v(mi.Float) == dr.JitBackend.CUDA if half is None else half
        dtype: Any = dr.float16_array_t(mi.TensorXf) if half else mi.TensorXf
        (w, b), *rest = mlp.layers
        self._baked, self._first = Baked(mlp), len(b)
        rest = rest[:-1] if mlp.modulated else rest
        # A module without directions (M, S) has no first matrix here: its first layer is the bias alone.
        flat = [dtype(np.ascontiguousarray(w[:, mlp.n_folded :]))] if mlp.n_folded < w.shape[1] else []
        for layer in rest:
            flat += [dtype(v) for v in layer]
        self._packed = dnn.pack(*flat, layout="inference")
        self._scalar: Any = dr.float16_array_t(mi.Float) if half else mi.Float
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
        z: Any = dnn.CoopVec(*map(self._scalar, bias))
        if x:
            z, packed = dnn.matvec(packed[0], dnn.CoopVec(*map(self._scalar, x))) + z, packed[1:]
        for w, b in zip(packed[::2], packed[1::2], strict=True):
            z = dr.fma(dr.minimum(z, 0), SLOPE, dr.maximum(z, 0))
            z = dnn.matvec(w, dr.minimum(dr.maximum(z, -self._limit), self._limit) if self._limit else z, b)
        out = [mi.Float(v) for v in z]
        return _head(out, head) if head else out
