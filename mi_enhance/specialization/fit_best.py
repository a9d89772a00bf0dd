"""The shared network, or one of the material's own: which is better on samples that the own one did not learn."""

from __future__ import annotations

import dataclasses
import time
from typing import Literal

from ..data.measurements import Measurements
from ..fitting import library_prior
from ..fitting.fit import check_arguments, fit, with_bounded_energy
from ..material.material import Material
from ..system.progress import Callback, silent
from .own_network import divided, error_of, finished, own_network, reported

# Fewer samples, or from fewer places (a part of the half and difference angles), do not carry hundreds of weights.
_MIN_SAMPLES, _MIN_COVERAGE = 5000, 0.25


def fit_best(
    material: Material,
    measurements: Measurements,
    *,
    own: Literal["auto", "always", "never"] = "auto",
    size: int = 8,
    reciprocal: bool = False,
    bound_energy: bool = False,
    seed: int = 0,
    progress: Callback = silent,
) -> Material:
    """Fit a material to measurements, and give it a network of its own where the samples carry one.

    Parameters
    ----------
    material : Material
        A network with a trunk (``Material.pretrained()``); any other, and an analytic model, is only fitted.
    measurements : Measurements
    own : {"auto", "always", "never"}
        A small network of its own, which renders almost as fast as GGX: if it is better on samples that were not
        learned, always, or never.
    size : int
        Hidden units of both layers of that network.
    reciprocal, bound_energy, seed, progress
        As of :func:`mi_enhance.fitting.fit.fit`.

    Returns
    -------
    Material
        ``report["chosen"]`` says which network it has, and why. ``unspecialized`` has the shared one.

    Raises
    ------
    ValueError
        For another `own`, or `size` not in 1 to 64.

    Examples
    --------
    >>> gold = fit_best(Material.pretrained(), measurements)  # doctest: +SKIP
    """
    check_arguments(material, measurements, "fit_best()")
    if own not in ("auto", "always", "never"):
        raise ValueError(f'fit_best(): own "{own}" is unknown. Choose one of: auto, always, never.')
    if size not in range(1, 65):
        raise ValueError(f"fit_best(): size must be in 1 to 64 hidden units; got {size}.")
    parts = None
    if own == "always" and material.brdf.trunk:
        parts = divided(measurements, seed)  # an error comes before the shared fit
    start = time.perf_counter()
    shared = fit(material, measurements, reciprocal=reciprocal, seed=seed, progress=progress)
    n, coverage = len(measurements.f), library_prior.coverage(measurements.wi, measurements.wo)
    if not shared.brdf.trunk:
        return with_bounded_energy(shared, measurements) if bound_energy else shared
    if own == "never":
        chosen = "shared network: asked for"
    elif own == "auto" and (n < _MIN_SAMPLES or coverage < _MIN_COVERAGE):
        chosen = (
            f"shared network: {n} samples from {coverage:.0%} of the half and difference angles; "
            f"one of its own is tried from {_MIN_SAMPLES} and {_MIN_COVERAGE:.0%}"
        )
    else:
        seen, unseen = parts or divided(measurements, seed)
        error = error_of(shared, unseen)
        found, own_error = own_network(
            shared, seen, unseen, (size, size), reciprocal=reciprocal, seed=seed, progress=progress
        )
        if own == "always" or own_error < error:
            found = finished(found)  # which moves a factor into its colour: it is judged as it will be used
            own_error = error_of(found, unseen)
        errors = f"error on samples it did not learn {own_error:.5f}, of the shared network, which did, {error:.5f}"
        if own == "always" or own_error < error:
            chosen = f"own network {size}-{size}: {errors}"
            shared = reported(found, measurements)
        else:
            chosen = f"shared network: an own one of {size}-{size} is worse: {errors}"
    report = {**shared.report, "chosen": chosen, "seconds": time.perf_counter() - start}
    result = dataclasses.replace(shared, report=report)
    return with_bounded_energy(result, measurements) if bound_energy else result
