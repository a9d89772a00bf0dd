"""What materials say of how they were made: the keys of ``Material.report`` by who writes them. JSON types only."""

from __future__ import annotations

from typing import TypedDict


class FitReport(TypedDict, total=False):
    """Report of :func:`mi_enhance.fitting.fit.fit`.

    Attributes
    ----------
    model : str
        The equation, with neural modules in brackets.
    log_l1 : float
        Eq. 1, mean over all samples and channels; with `bound_energy` that of the bounded material.
    log_l1_analytic : float
        Of the analytic model, fitted by the same method.
    seconds, seconds_analytic : float
        Of all, and of the analytic fit.
    n_samples, n_parameters : int
    clamped_fraction : float
        Share of measured values that were negative.
    method : {"lm", "rmsprop"}
    reciprocal : bool
        The material is reciprocal: f(wi, wo) = f(wo, wi).
    seed : int
    name, source : str
        Of the measurements.
    std : dict of str to list of float
        Standard deviation of each parameter.
    undetermined : list of str
        Parameters that the samples say nothing about.
    log_l1_unbounded : float
        Only with `bound_energy`: before the bound.
    """

    model: str
    log_l1: float
    log_l1_analytic: float
    log_l1_unbounded: float
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


class TexelReport(TypedDict):
    """Report of :func:`mi_enhance.fitting.fit_texels.fit_texels`.

    Attributes
    ----------
    model : str
        The equation, with neural modules in brackets.
    log_l1, log_l1_analytic : float
        Means over the surface.
    seconds, seconds_per_1000 : float
        Of all texels, and of 1,000.
    n_texels, n_samples : int
        Samples are those of each texel.
    smoothness : float
    seed : int
    """

    model: str
    log_l1: float
    log_l1_analytic: float
    seconds: float
    seconds_per_1000: float
    n_texels: int
    n_samples: int
    smoothness: float
    seed: int


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
