"""What materials say of how they were made: the keys of ``Material.report`` by who writes them. JSON types only."""

from __future__ import annotations

from typing import TypedDict


class FitReport(TypedDict, total=False):
    """What :func:`mi_enhance.fit` writes; see there."""

    model: str  # the equation
    log_l1: float
    log_l1_analytic: float
    log_l1_unbounded: float  # with `bound_energy` only
    seconds: float
    seconds_analytic: float
    n_samples: int
    n_parameters: int
    clamped_fraction: float
    method: str
    reciprocal: bool
    seed: int
    name: str
    source: str
    std: dict[str, list[float]]
    undetermined: list[str]


class SpecializeReport(TypedDict, total=False):
    """What :func:`mi_enhance.specialization.specialize.specialize` adds; see there."""

    specialize_network: str
    specialize_error: float
    specialize_max_error: float
    specialize_multiply_adds: int
    specialize_multiply_adds_exact: int
    specialize_seconds: float
    specialize_log_l1: float
    specialize_log_l1_exact: float
