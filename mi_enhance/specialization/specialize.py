"""Specializing: one material's networks become a single small one, with a stated error.

For one material all parameters are constants, and what its networks say is a smooth function of the directions alone.
A network of a tenth of the size learns that function in seconds: least squares on the logarithms of the factors, each
weighted by what it means for the logarithm of f. Colours, D, F and the frame stay outside and stay editable.
"""

from __future__ import annotations

import dataclasses
import time

import numpy as np

from ..data.directions import sample_pairs
from ..data.measurements import Measurements
from ..fitting.fit import fit
from ..fitting.losses import log_l1
from ..material.material import Material
from ..material.reports import SpecializeReport
from ..neural.distilled_network import DistilledNetwork
from ..neural.enhanced_brdf import EnhancedBRDF
from ..neural.parameter_inputs import of_parameters
from ..system.progress import Callback, Progress, silent
from ..system.variants import require_rgb
from . import distillation, pruning
from .factor_problem import FactorProblem, factors_of
from .own_network import can_have_one, divided, error_of, finished, own_network, reported

SHARED = "ggx2_small"  # the network that textured materials get
# Hidden units of two layers each; the cheapest that is good enough is taken. Chosen on MERL materials (NPs' decoder).
SIZES = (6, 8, 12, 16)
_OWN_PAIRS = 32_768  # pairs of directions that tell a network in RGB what the material is

_TRAINING, _VALIDATION = 8192, 20_000  # pairs of directions
_AT_BEST = 2.5  # the next size is never better by more: what is hopeless is not tried
_STARTS, _FEW = 4, 1024  # first weights that are tried, on how many pairs
_MIN_COS = 1e-3  # closer to the horizon than any measurement: a render asks there, too
# Inputs that vary by less say nothing: the azimuth where the roughnesses are equal, asymmetry where there is none.
_MIN_SPREAD = 5e-3


def specialize(
    material: Material,
    measurements: Measurements | None = None,
    *,
    max_error: float = 1e-3,
    size: int | None = None,
    textured: bool = False,
    seed: int = 0,
    progress: Callback = silent,
) -> Material:
    """Return the same material with a small network of its own, several times cheaper to render.

    Parameters
    ----------
    material : Material
        With networks. They and its parameters are kept: ``specialize(m).unspecialized`` evaluates as `m`.
    measurements : Measurements, optional
        The measurements it was fitted to. The small network then follows them, and may become more accurate than the
        modules it comes from.
    max_error : float
        Largest mean absolute difference of log(1 + f cos) to the exact material, over random pairs of directions
        (:func:`mi_enhance.data.directions.sample_pairs`); with measurements the largest growth of the error against
        those of them that were not learned.
    size : int, optional
        Hidden units of both layers, in place of the cheapest of `SIZES` that is good enough: for curves of error over
        run time. `max_error` then decides nothing.
    textured : bool
        Instead fit the small shared network (`SHARED`) to the measurements, else to the material itself: for materials
        whose parameters vary over a surface, where a network of one set of parameters is of no use. `max_error` and
        `size` then decide nothing, and the exact material is not kept.
    seed : int
        Of directions and first weights.
    progress : callable
        Hears of every size that was tried, with its ``error``, or of the steps of the fit of the small shared network;
        see :mod:`mi_enhance.system.progress`.

    Returns
    -------
    Material
        With the cheapest network whose error is small enough; if there is none, with the exact networks without the
        units that are linear for this material. Its `report` also holds the entries of a
        :class:`mi_enhance.material.reports.SpecializeReport`.

    Raises
    ------
    ValueError
        If there is no network to be made cheaper, one sees colours, `max_error` is not above 0, or `size` is not in 1
        to 64.
    RuntimeError
        If no RGB variant with gradients is active.

    Examples
    --------
    >>> m = specialize(Material.pretrained().edit(rho_s=0.5), max_error=0.01)
    >>> m.report["specialize_error"] < 0.01, m.brdf.multiply_adds < m.unspecialized.brdf.multiply_adds / 8
    (True, True)
    """
    if not max_error > 0:
        raise ValueError(f"specialize(): max_error must be above 0; got {max_error}.")
    if size is not None and not 1 <= size <= 64:  # 64: seven times the multiply-adds of the largest of SIZES
        raise ValueError(f"specialize(): size must be in 1 to 64 hidden units; got {size}.")
    require_rgb("specialize()")
    start = time.perf_counter()
    material = material.unspecialized
    if textured:
        return _shared(material, measurements, seed, start, progress)
    if measurements or material.brdf.trunk:
        if not can_have_one(material.brdf):
            raise ValueError(
                f'specialize(): the networks of {material.brdf} have inputs "{material.brdf.inputs}"; one that follows '
                'measurements can only stand beside networks with "shape" or "reciprocal". Leave the measurements out, '
                "or fit ggx2_rgb, ggx2, ggx, cook_torrance or ward."
            )
        return _own(material, measurements, max_error, size, seed, start, progress)
    slots = factors_of(material.brdf)
    training = FactorProblem(material, slots, *sample_pairs(_TRAINING, seed=seed + 1, min_cos=_MIN_COS))
    validation = FactorProblem(material, slots, *sample_pairs(_VALIDATION, seed=seed + 2))
    chosen = False
    compact: tuple[DistilledNetwork, ...] = ()
    sizes = (size,) if size else SIZES
    for k, units in enumerate(sizes):
        compact = (_learn(training, units, np.random.default_rng(seed)),)
        error = validation.error(compact)
        progress(Progress(f"network {units}-{units}", k + 1, len(sizes), {"error": error}))
        chosen = size is not None or error <= max_error
        if chosen or error > max_error * _AT_BEST ** (len(sizes) - 1 - k):
            break
    network = "-".join(map(str, compact[0].sizes))
    if not chosen:
        compact = _pruned(material, training)
        network = "exact, without linear units" if compact else "exact"
        error = validation.error(compact) if compact else 0.0
    brdf = dataclasses.replace(material.brdf, distilled=compact)
    more: SpecializeReport = {"specialize_max_error": max_error}
    return _specialized(material, brdf, network, error, start, more)


def _specialized(
    material: Material,
    brdf: EnhancedBRDF,
    network: str,
    error: float,
    start: float,
    more: SpecializeReport,
    multiply_adds: int | None = None,
) -> Material:
    """Return the material with another BRDF, and a report of its cost."""
    report: SpecializeReport = {
        "specialize_network": network,
        "specialize_error": error,
        "specialize_multiply_adds": brdf.multiply_adds,
        "specialize_multiply_adds_exact": multiply_adds or material.brdf.multiply_adds,
        "specialize_seconds": time.perf_counter() - start,
    }
    return dataclasses.replace(material, brdf=brdf, report={**material.report, **report, **more})


def _learn(training: FactorProblem, units: int, rng: np.random.Generator) -> DistilledNetwork:
    """Return a network with two layers of `units` hidden units."""
    spread = {name: v.std() for name, v in training.features.items()}
    # The logarithm of the ratio of the cosines adds little to their difference.
    inputs = tuple(name for name in training.features if spread[name] > _MIN_SPREAD and "log_ratio" not in name)
    x = training.columns(inputs)
    mean, std = x.mean(0), x.std(0)
    x, sizes = (x - mean) / std, (len(inputs), units, units, len(training.slots))
    trials = []
    for _ in range(_STARTS):
        first = distillation.first(sizes, np.median(training.logs, 0), rng)
        trials.append(distillation.train(first, x[:_FEW], training.of_factors, steps=15))
    layers, _ = distillation.train(min(trials, key=lambda t: t[1])[0], x, training.of_factors, steps=40)
    return DistilledNetwork(training.slots, inputs, tuple(distillation.on_raw_inputs(layers, mean, std)))


def _shared(
    material: Material, measurements: Measurements | None, seed: int, start: float, progress: Callback
) -> Material:
    """Return the small shared network, fitted to the measurements, else to the material."""
    wi, wo = sample_pairs(_VALIDATION, seed=seed)
    f = material.evaluate(wi, wo)
    truth = measurements or Measurements(wi, wo, f, material.report.get("name", "material"), "material")
    small = fit(Material.pretrained(SHARED), truth, seed=seed, progress=progress)
    error = log_l1(small.evaluate(wi, wo), f, wo[:, 2])
    more: SpecializeReport = {"specialize_log_l1": small.report["log_l1"]} if measurements else {}
    small = dataclasses.replace(small, report={**material.report, **small.report})
    more["specialize_multiply_adds_exact"] = material.brdf.multiply_adds
    return _specialized(small, small.brdf, SHARED, error, start, more)


def _own(
    material: Material,
    measurements: Measurements | None,
    max_error: float,
    size: int | None,
    seed: int,
    start: float,
    progress: Callback,
) -> Material:
    """Return the material with the cheapest network of its own, in RGB, that follows the measurements, or itself."""
    wi, wo = sample_pairs(_OWN_PAIRS, seed=seed + 1, min_cos=_MIN_COS)
    truth = measurements or Measurements(wi, wo, material.evaluate(wi, wo), "material", "itself")
    seen, unseen = divided(truth, seed)
    exact = error_of(material, unseen)
    sizes = (size,) if size else SIZES
    best: tuple[Material, float] | None = None
    for k, units in enumerate(sizes):
        found = own_network(
            material,
            seen,
            unseen,
            (units, units),
            reciprocal=material.reciprocal,
            hold=measurements is None,
            seed=seed,
            progress=progress,
        )
        progress(Progress(f"network {units}-{units}", k + 1, len(sizes), {"error": found[1] - exact}))
        best = found if best is None or found[1] < best[1] else best
        if best[1] - exact <= max_error:
            break
    assert best is not None
    if size is None and best[1] - exact > max_error:
        return _specialized(material, material.brdf, "exact", 0.0, start, {"specialize_max_error": max_error})
    result = finished(best[0])
    network = "-".join(map(str, result.brdf.distilled[0].sizes))
    more: SpecializeReport = {"specialize_max_error": max_error}
    if measurements:
        more |= {"specialize_log_l1": best[1], "specialize_log_l1_exact": exact}
        result = reported(result, measurements)
    wi, wo = sample_pairs(_VALIDATION, seed=seed + 2)
    error = log_l1(result.evaluate(wi, wo), material.evaluate(wi, wo), wo[:, 2])
    return _specialized(result, result.brdf, network, error, start, more, material.brdf.multiply_adds)


def _pruned(material: Material, training: FactorProblem) -> tuple[DistilledNetwork, ...]:
    """Return the exact modules without linear units; none where there are operators, or inputs of another kind."""
    brdf = material.brdf
    if brdf.inputs not in ("shape", "reciprocal") or not set(training.slots) <= set(brdf.modules):
        return ()
    values = material.as_drjit()
    constant = np.array([v[0] for v in of_parameters(values, brdf.inputs, brdf.model)], np.float64)
    result = []
    for slot in training.slots:
        *hidden, (w, b) = pruning.fold(brdf.modules[slot], constant)
        result.append(pruning.prune(slot, [*hidden, (w, b + material.params[f"norm_{slot}"])], training.features))
    return tuple(result)
