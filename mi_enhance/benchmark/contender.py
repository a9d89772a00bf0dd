"""A model of a benchmark, fitted to one material and ready to render."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import mitsuba as mi


class Contender(NamedTuple):
    """A model that was fitted to one material."""

    make: Callable  # (spec) -> mi.BSDF, a function of a module: it is sent to other processes
    spec: dict  # JSON
    n_bytes: int  # that belong to this material alone
    shared_bytes: int  # of the networks that all materials have in common
    multiply_adds: int  # of all networks in one evaluation
    seconds: float | None  # of the fit and all that followed it
    can_be_textured: bool = False

    def bsdf(self) -> mi.BSDF:
        """The BSDF, of the active variant."""
        return self.make(self.spec)
