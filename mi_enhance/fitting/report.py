"""The report of a fit: entries of ``Material.report``."""

from __future__ import annotations

from typing import TypedDict


class _Fitted(TypedDict):
    model: str
    log_l1: float
    log_l1_analytic: float
    seconds: float
    n_samples: int
    seed: int


class FitReport(_Fitted, total=False):
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

    seconds_analytic: float
    n_parameters: int
    clamped_fraction: float
    method: str
    reciprocal: bool
    name: str
    source: str
    std: dict[str, list[float]]
    undetermined: list[str]
    log_l1_unbounded: float


class TexelReport(_Fitted):
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

    seconds_per_1000: float
    n_texels: int
    smoothness: float
