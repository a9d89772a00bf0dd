"""The interface behind which a module is evaluated."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import mitsuba as mi


class Evaluator(Protocol):
    """A module that can be evaluated.

    There are four: :class:`mi_enhance.neural.baked.Baked` for renders and fits, ``Stored`` beside it for constants,
    :class:`mi_enhance.neural.cooperative.Cooperative` for GPUs, and the slots of
    :class:`mi_enhance.neural.trainable.Trainable` for gradients of the weights.
    """

    def fold(self, features: Sequence[Any], begun: Sequence[mi.Float] | None = None) -> list[mi.Float]:
        """Turn the inputs that are constant over a material into a first bias, and into a modulated last layer.

        Folding is linear, so it can be done in two parts: first without the features that are None, then, with the
        result as `begun`, for those alone.
        """
        ...

    def __call__(self, x: Sequence[mi.Float], folded: Sequence[mi.Float]) -> list[mi.Float]:
        """Compute the outputs for the varying inputs `x` and the result of :meth:`fold`."""
        ...


class Evaluators(Protocol):
    """Evaluators by slot: a dictionary, or a ``Trainable``."""

    def __getitem__(self, slot: str, /) -> Evaluator: ...
