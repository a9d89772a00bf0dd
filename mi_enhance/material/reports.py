"""Keys of ``Material.report``, the record of how a material was made; JSON types only."""

from __future__ import annotations

from typing import TypedDict


class SpecializeReport(TypedDict, total=False):
    """Entries that :func:`mi_enhance.specialization.specialize.specialize` adds; see there."""

    specialize_network: str
    specialize_error: float
    specialize_max_error: float
    specialize_multiply_adds: int
    specialize_multiply_adds_exact: int
    specialize_seconds: float
    specialize_log_l1: float
    specialize_log_l1_exact: float
