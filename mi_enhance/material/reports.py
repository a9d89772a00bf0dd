"""Keys of ``Material.report``, the record of how a material was made; JSON types only."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypedDict


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


def of_shared(report: Mapping[str, Any]) -> dict[str, Any]:
    """Return what remains of a report when the material loses its own network.

    Examples
    --------
    >>> of_shared({"log_l1": 0.01, "log_l1_shared": 0.02, "chosen": "own network 8-8", "seed": 0})
    {'log_l1': 0.02, 'seed': 0}
    """
    result = {key: value for key, value in report.items() if key not in SpecializeReport.__annotations__}
    if "log_l1_shared" in result:  # :func:`mi_enhance.specialization.fit_best.fit_best` chose the network
        result["log_l1"] = result.pop("log_l1_shared")
        result.pop("chosen", None)
    return result
