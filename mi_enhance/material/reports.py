"""Keys of ``Material.report``, the record of how a material was made; JSON types only."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
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


def of_edited(report: Mapping[str, Any], names: Iterable[str]) -> dict[str, Any]:
    """Return the report of a fit, and in ``edited`` what was edited since: its errors are those before.

    Examples
    --------
    >>> of_edited({"log_l1": 0.01, "edited": ["F0"]}, ["rho_d"])
    {'log_l1': 0.01, 'edited': ['F0', 'rho_d']}
    """
    edited = sorted({*report.get("edited", ()), *names})
    return {**report, "edited": edited} if edited and "log_l1" in report else {**report}


def of_shared(report: Mapping[str, Any]) -> dict[str, Any]:
    """Return what remains of a report when the material loses its own network.

    Examples
    --------
    >>> of_shared({"log_l1": 0.01, "log_l1_shared": 0.02, "chosen": "own network 8-8", "seed": 0})
    {'log_l1': 0.02, 'seed': 0}

    With bounded energy the error of the shared network is known without the bound only:

    >>> of_shared({"log_l1": 0.011, "log_l1_unbounded": 0.01, "log_l1_shared": 0.02})
    {'log_l1_unbounded': 0.02}
    """
    result = {key: value for key, value in report.items() if key not in SpecializeReport.__annotations__}
    if "log_l1_shared" in result:  # :func:`mi_enhance.specialization.fit_best.fit_best` chose the network
        shared = result.pop("log_l1_shared")
        if "log_l1_unbounded" in result:
            result["log_l1_unbounded"] = shared
            result.pop("log_l1")
        else:
            result["log_l1"] = shared
        result.pop("chosen", None)
    return result
