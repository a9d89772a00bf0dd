"""Fitting one material to measurements: the weights stay, the parameters move (paper, section 5.1)."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Sequence

import numpy as np

from ..analytic import parameters
from ..analytic.parameter_space import Space
from ..data.measurements import Measurements
from ..material.colour_normalization import normalize, plain
from ..material.material import Material
from ..neural.enhance import trunk_start
from ..neural.enhanced_brdf import EnhancedBRDF
from ..sampling import albedo
from ..sampling.mixture_fit import fit_mixture
from ..system.checks import instance_of
from ..system.progress import Callback, Progress, silent
from ..system.variants import require_rgb
from . import library_prior, multistart
from .analytic_fit import analytic_starts
from .losses import log_l1
from .multistart import Stage
from .report import FitReport
from .rmsprop import fit_rmsprop
from .texel_batches import TexelSamples
from .uncertainty import determined

METHODS = ("lm", "rmsprop")

_NEAREST, _SCREEN = 28, 1024  # training materials to start from, besides the analytic fit; samples that choose them
# Many starts on few samples first. Chosen on the materials that training keeps aside; more of everything lowers the
# loss by 1 to 2 % at twice the time.
_STAGES = (Stage(1024, None, 12), Stage(2048, 12, 15), Stage(8192, 3, 36), Stage(None, 1, 15))
# A read-out starts at the analytic model, and a step of its hundreds of numbers takes longer: fewer starts.
_NEAREST_READ_OUTS = 3
_READ_OUT_STAGES = (Stage(1024, None, 8), Stage(4096, 2, 12), Stage(1 << 15, 1, 20))
_TOLERANCE = 3e-4  # a share of the loss; the last stage has all samples, so no other one needs more


def fit(
    material: Material,
    measurements: Measurements,
    *,
    method: str = "lm",
    reciprocal: bool = False,
    bound_energy: bool = False,
    seed: int = 0,
    progress: Callback = silent,
) -> Material:
    """Fit the parameters of a material, and of its analytic ancestor, to measurements.

    Parameters
    ----------
    material : Material
        A network (``Material.pretrained()``), an analytic model (``Material.analytic("ggx")``), or a fitted material,
        whose parameters then are one more start.
    measurements : Measurements
        From :func:`mi_enhance.data.loading.load`.
    method : {"lm", "rmsprop"}
        Levenberg-Marquardt from several starts, or the paper's recipe: RMSProp with alpha 0.9, learning rate 1e-3,
        1,000 epochs of all samples from the default start.
    reciprocal : bool
        Let networks see nothing by which they could tell viewer from light: f(wi, wo) = f(wo, wi) for all directions,
        even where the file says otherwise. Those with ``inputs="directions"`` cannot be.
    bound_energy : bool
        Bound the directional albedo of the result by 1, even where the file reflects more than it receives: the factors
        of :mod:`mi_enhance.sampling.energy_bound` are put on what was fitted without them.
    seed : int
        Of the subset that the search for the right minimum uses.
    progress : callable, optional
        ``progress(Progress)`` after every step, or every 50 of RMSProp, with the best ``loss`` so far.

    Returns
    -------
    Material
        Its `report` is a :class:`mi_enhance.fitting.report.FitReport`: ``log_l1`` (eq. 1), ``log_l1_analytic`` (the
        analytic model fitted by the same method), ``seconds``, ``std`` and ``undetermined`` (what the samples say of
        the parameters, see :func:`mi_enhance.fitting.uncertainty.determined`), and more.

    Raises
    ------
    ValueError
        For an unknown method, or if `reciprocal` is asked of a network that reads raw directions.
    RuntimeError
        If no JIT variant with RGB colours and gradients is active.

    Examples
    --------
    >>> from mi_enhance.data import synthetic
    >>> m, truth = synthetic.ggx_anisotropic(3, n_samples=500, noise=0)
    >>> fit(Material.analytic("ggx"), m).report["log_l1"] < 1e-3
    True
    """
    check_arguments(material, measurements, "fit()")
    if method not in METHODS:
        raise ValueError(f'fit(): method "{method}" is unknown. Choose one of: {", ".join(METHODS)}.')
    if reciprocal and material.brdf.networks and material.brdf.inputs == "directions":
        raise ValueError(
            'fit(): reciprocal=True, but this network reads raw directions (inputs="directions") and tells viewer from '
            "light. Choose a network with symmetric or shape inputs, such as ggx2."
        )
    require_rgb("fit()")
    material = material.unspecialized  # a specialized one holds for its own parameters only
    material = dataclasses.replace(material, brdf=dataclasses.replace(material.brdf, reference=None))
    start = time.perf_counter()
    if reciprocal and material.brdf.inputs == "shape":
        material = dataclasses.replace(material, brdf=dataclasses.replace(material.brdf, inputs="reciprocal"))
    hold = ("asymmetry",) if reciprocal and material.brdf.inputs == "own" else ()
    rng = np.random.default_rng(seed)

    def run(brdf, starts, known=None):
        if method == "rmsprop":
            return fit_rmsprop(brdf, measurements, hold=hold, progress=progress)
        return _search(brdf, measurements, np.array(starts), rng, hold, material.library, known, progress)

    analytic = EnhancedBRDF(material.brdf.model, {})
    vector, loss_analytic = run(analytic, [_given(analytic, material), *analytic_starts(analytic)])
    seconds_analytic = time.perf_counter() - start
    loss = loss_analytic
    if material.brdf.networks:
        first = parameters.flatten(material.brdf.parameters, parameters.initial(material.brdf.parameters))
        first[: len(vector)] = vector
        if material.brdf.trunk:
            first = trunk_start(material.brdf, first)
        starts = [_given(material.brdf, material), first]
        known = None
        if material.library is not None:
            of = library_prior.weight_of_read_outs if material.brdf.has_free_read_out else library_prior.weight
            known = library_prior.from_library(material, of(measurements.wi, measurements.wo, loss_analytic))
        vector, loss = run(material.brdf, starts, known)
        if material.brdf.trunk and loss > loss_analytic:  # samples that an early stage did not see
            vector, loss = first, loss_analytic
    values = parameters.unflatten(material.brdf.parameters, vector)
    report: FitReport = {
        "model": str(material.brdf),
        "log_l1": float(loss),
        "log_l1_analytic": float(loss_analytic),
        "seconds": time.perf_counter() - start,
        "seconds_analytic": seconds_analytic,
        "n_samples": len(measurements.f),
        "n_parameters": material.brdf.n_parameters,
        "clamped_fraction": measurements.clamped_fraction,
        "method": method,
        "reciprocal": dataclasses.replace(material, params=values).reciprocal,
        "seed": seed,
        "name": measurements.name,
        "source": measurements.source,
    }
    fitted = normalize(
        dataclasses.replace(material, params=values, report={**report}, library=None, low_rank=None, bound_energy=False)
    )
    report["std"], report["undetermined"] = determined(fitted, measurements, loss, hold)
    fitted = dataclasses.replace(
        fitted,
        report={**report},
        lobe_albedo=albedo.lobe_albedo(fitted.brdf, fitted.as_drjit()),
        mixture=fit_mixture(fitted.brdf, fitted.as_drjit()),
    )
    return with_bounded_energy(fitted, measurements) if bound_energy else fitted


def check_material(material: Material, where: str) -> None:
    """Raise a TypeError that begins with `where` unless it is a material."""
    instance_of(material, Material, "material", where, 'Material.pretrained() or Material.analytic("ggx")')


def check_arguments(material: Material, measurements: Measurements, where: str) -> None:
    """Raise a TypeError that begins with `where` unless these are a material and measurements."""
    check_material(material, where)
    instance_of(measurements, Measurements, "measurements", where, "data.load(path)")


def _search(
    brdf: EnhancedBRDF,
    measurements: Measurements,
    starts: np.ndarray,
    rng: np.random.Generator,
    hold: Sequence[str],
    library: np.ndarray | None,
    known: library_prior.Prior | None,
    progress: Callback,
) -> tuple[np.ndarray, float]:
    """Search from many starts with Levenberg-Marquardt; return the best parameters (P,) and their loss."""
    samples = TexelSamples(measurements.wi, measurements.wo, measurements.f, rng)  # of one texel
    space, only = Space(brdf.parameters, hold), np.zeros(1, int)
    u = space.to_free(starts)[None]
    if brdf.networks and library is not None:
        candidates = space.to_free(np.asarray(library, np.float64))
        n = _NEAREST_READ_OUTS if brdf.has_free_read_out else _NEAREST
        chosen = multistart.nearest(samples, brdf, only, candidates, n, _SCREEN)
        u = np.concatenate([u, chosen], axis=1)
    stages = _READ_OUT_STAGES if brdf.has_free_read_out else _STAGES
    # stages up to the first that sees all samples: a later one would see the same
    last = next((k for k, stage in enumerate(stages) if (stage.n_samples or samples.n) >= samples.n), len(stages) - 1)
    name = "enhanced" if brdf.networks else "analytic"

    def report(stage: Stage, step: int, losses: np.ndarray) -> None:
        n = min(stage.n_samples or samples.n, samples.n)
        progress(Progress(f"{name}, {n} samples", step + 1, stage.n_steps, {"loss": float(losses.min())}))

    best, losses = multistart.minimize(
        samples, brdf, only, u, stages[: last + 1], space=space, known=known, tolerance=_TOLERANCE, report=report
    )
    if (stages[last].n_samples or samples.n) < samples.n:  # else the last stage has seen them all
        losses = samples.problem(brdf, only).loss(best)
    return space.to_physical(best[0]), float(losses[0])


def with_bounded_energy(material: Material, measurements: Measurements) -> Material:
    """The material with bounded energy, and what that costs in its report."""
    material = material.bounded()
    f, cos = material.evaluate(measurements.wi, measurements.wo), measurements.wo[:, 2]
    report = {**material.report, "log_l1_unbounded": material.report["log_l1"]}
    report["log_l1"] = log_l1(f.astype(np.float64), measurements.f.astype(np.float64), cos.astype(np.float64))
    return dataclasses.replace(material, report=report)


def _given(brdf: EnhancedBRDF, material: Material) -> np.ndarray:
    """The parameters the material came with, as far as `brdf` has them."""
    return parameters.flatten(brdf.parameters, plain(material).params)
