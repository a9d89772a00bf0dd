"""Fitting one material to measurements: the weights stay, the parameters move (paper, section 5.1)."""

from __future__ import annotations

import dataclasses
import functools
import time
from collections.abc import Callable

import drjit as dr
import mitsuba as mi
import numpy as np

from . import prior
from .analytic import parameter_space, parameters
from .data.measurements import Measurements
from .determined import determined
from .losses import log_l1
from .material.colour_normalization import normalise, plain
from .material.material import Material
from .neural.enhanced_brdf import EnhancedBRDF
from .numerics import levenberg_marquardt
from .objective import Objective, stacked
from .sampling import albedo
from .sampling.mixture_fit import mixture
from .system.variants import require_rgb

METHODS = ("lm", "rmsprop")


_NEAREST = 28  # training materials to start from, besides the analytic fit
# Samples, parameter sets that go on from the stage before, and most steps: many starts on few samples first. Chosen
# on the materials that training keeps aside; more of everything lowers the loss by 1 to 2 % at twice the time.
_STAGES = ((1024, None, 12), (2048, 12, 15), (8192, 3, 36), (None, 1, 15))


def fit(
    material: Material,
    measurements: Measurements,
    *,
    method: str = "lm",
    reciprocal: bool = False,
    energy: bool = False,
    seed: int = 0,
    callback: Callable | None = None,
) -> Material:
    """Fit the parameters of a material, and of its analytic ancestor, to measurements.

    Parameters
    ----------
    material : Material
        A network (``Material.network()``), an analytic model (``Material.analytic("ggx")``), or a fitted material,
        whose parameters then are one more start.
    measurements : Measurements
        From :func:`mi_enhance.data.loading.load`.
    method : {"lm", "rmsprop"}
        Levenberg-Marquardt from several starts, or the paper's recipe: RMSProp with alpha 0.9, learning rate 1e-3,
        1,000 epochs of all samples from the default start.
    reciprocal : bool
        Hold the parameter ``asymmetry`` at 0: f(wi, wo) = f(wo, wi) for all directions, even where the file says
        otherwise. Networks that have no such parameter are reciprocal, or (``inputs="directions"``) cannot be.
    energy : bool
        Bound the directional albedo of the result by 1, even where the file reflects more than it receives: the factors
        of :mod:`mi_enhance.sampling.energy_bound` are put on what was fitted without them.
    seed : int
        Of the subset that the search for the right minimum uses.
    callback : callable, optional
        ``callback(stage, step, loss)`` after every step.

    Returns
    -------
    Material
        With `report`: ``model``, ``log_l1`` (eq. 1, mean over all samples and channels), ``log_l1_analytic`` (the
        analytic model fitted by the same method), ``seconds`` (of all), ``seconds_analytic``, ``n_samples``,
        ``n_parameters``, ``clamped_fraction``, ``method``, ``seed``, ``name``, ``source``, and what the samples say of
        the parameters: ``std`` and ``undetermined`` of :func:`mi_enhance.determined.determined`. With
        `energy`, ``log_l1`` is that of the bounded material and ``log_l1_unbounded`` that of the other.

    Raises
    ------
    ValueError
        For an unknown method, or if `reciprocal` is asked of a network that reads raw directions.
    RuntimeError
        If no JIT variant with RGB colours and gradients is active.

    Examples
    --------
    >>> from mi_enhance import data
    >>> m, truth = data.synthetic.ggx_anisotropic(3, n_samples=500, noise=0)
    >>> fit(Material.analytic("ggx"), m).report["log_l1"] < 1e-3
    True
    """
    if method not in METHODS:
        raise ValueError(f'fit(): method "{method}" is unknown. Choose one of: {", ".join(METHODS)}.')
    if reciprocal and material.brdf.networks and material.brdf.inputs == "directions":
        raise ValueError(
            'fit(): reciprocal=True, but this network reads raw directions (inputs="directions") and tells viewer from '
            "light. Choose a network with symmetric or shape inputs, such as ggx2."
        )
    require_rgb("fit()")
    callback = callback or (lambda *_: None)
    material = material.exact  # a specialised one holds for its own parameters only
    start = time.perf_counter()
    run = functools.partial(_lm if method == "lm" else _rmsprop, reciprocal=reciprocal)
    rng = np.random.default_rng(seed)
    analytic = EnhancedBRDF(material.brdf.model, {})
    vector, loss_analytic = run(analytic, measurements, [_given(analytic, material)], rng, callback)
    seconds_analytic = time.perf_counter() - start
    loss = loss_analytic
    if material.brdf.networks:
        first = parameters.flatten(material.brdf.parameters, parameters.initial(material.brdf.parameters))
        first[: len(vector)] = vector
        starts = [_given(material.brdf, material), first]
        known = None
        if material.library is not None:
            known = prior.from_library(material, prior.weight(measurements.wi, measurements.wo, loss_analytic))
        vector, loss = run(material.brdf, measurements, starts, rng, callback, material.library, known)
    values = parameters.unflatten(material.brdf.parameters, vector)
    report = {
        "model": str(material.brdf),
        "log_l1": float(loss),
        "log_l1_analytic": float(loss_analytic),
        "seconds": time.perf_counter() - start,
        "seconds_analytic": seconds_analytic,
        "n_samples": len(measurements.f),
        "n_parameters": material.brdf.n_parameters,
        "clamped_fraction": measurements.clamped_fraction,
        "method": method,
        "reciprocal": material.brdf.inputs != "directions"
        and (reciprocal or not values.get("asymmetry", np.zeros(1))[0]),
        "seed": seed,
        "name": measurements.name,
        "source": measurements.source,
    }
    fitted = normalise(dataclasses.replace(material, params=values, report=report, library=None, energy=False))
    std, undetermined = determined(fitted, measurements, loss, _held(reciprocal))
    report = {**report, "std": std, "undetermined": undetermined}
    fitted = dataclasses.replace(fitted, report=report, lobe_albedo=albedo.lobe_albedo(fitted), mixture=mixture(fitted))
    return _bounded(fitted, measurements) if energy else fitted


def _bounded(material: Material, measurements: Measurements) -> Material:
    """The material with bounded energy, and what that costs in its report."""
    material = material.bounded()
    f, cos = material.evaluate(measurements.wi, measurements.wo), measurements.wo[:, 2]
    report = {**material.report, "log_l1_unbounded": material.report["log_l1"]}
    report["log_l1"] = log_l1(f.astype(np.float64), measurements.f.astype(np.float64), cos.astype(np.float64))
    return dataclasses.replace(material, report=report)


def _held(reciprocal: bool) -> tuple[str, ...]:
    """Parameters that a fit does not move."""
    return ("asymmetry",) if reciprocal else ()


def objective(brdf: EnhancedBRDF, measurements: Measurements, copies: int = 1, index=slice(None)) -> Objective:
    """The loss of `copies` independent parameter sets on the samples `index` of one material."""
    wi, wo, f = (a[index] for a in (measurements.wi, measurements.wo, measurements.f))
    return stacked(brdf, wi, wo, np.broadcast_to(f, (copies, *f.shape)))


def analytic_starts(brdf: EnhancedBRDF) -> np.ndarray:
    """Parameter vectors, (S, P), that between them lead to the minima of an analytic model: the model's starts."""
    values = parameters.initial(brdf.parameters)
    return np.array([parameters.flatten(brdf.parameters, {**values, **start}) for start in brdf.model.starts])


def _given(brdf: EnhancedBRDF, material: Material) -> np.ndarray:
    """The parameters the material came with, as far as `brdf` has them."""
    return parameters.flatten(brdf.parameters, plain(material).params)


def _lm(
    brdf, measurements, starts, rng, callback, library=None, known=None, *, reciprocal=False
) -> tuple[np.ndarray, float]:
    """Search on a subset from many starts at once, then polish the best on everything."""
    n = len(measurements.f)
    order = rng.permutation(n)
    stage = "analytic" if not brdf.networks else "enhanced"
    if not brdf.networks:
        starts = [*starts, *analytic_starts(brdf)]
    elif library is not None:
        starts = [*starts, *_nearest(brdf, measurements, library, order[:1024])]
    space = parameter_space.Space(brdf.parameters, _held(reciprocal))
    u, losses, used = space.to(np.array(starts)), None, 0
    for samples, survivors, steps in _STAGES:
        if used == n:
            break  # a later stage would see the same samples
        used = min(samples or n, n)
        if losses is not None:
            u = u[np.argsort(losses)[:survivors]]
        problem = objective(brdf, measurements, len(u), order[:used])
        loss, normal_equations = known.added(problem) if known else (problem.loss, problem.normal_equations)
        u, losses = levenberg_marquardt.minimize(
            loss,
            normal_equations,
            u,
            space.low,
            space.high,
            steps=steps,
            tolerance=3e-4,
            callback=_reporter(callback, f"{stage}, {used} samples"),
        )
    best = int(np.argmin(losses))
    return space.back(u[best]), losses[best] - (known.loss(u[best : best + 1])[0] if known else 0)


def _reporter(callback: Callable, stage: str) -> Callable:
    return lambda step, losses: callback(stage, step, float(losses.min()))


def _nearest(brdf, measurements, library: np.ndarray, index: np.ndarray) -> np.ndarray:
    """The training materials that explain the measurements best as they are."""
    candidates = objective(brdf, measurements, len(library), index)
    losses = candidates.loss(candidates.space.to(np.asarray(library, np.float64)))
    return library[np.argsort(losses)[:_NEAREST]]


def _rmsprop(
    brdf, measurements, starts, rng, callback, library=None, known=None, *, reciprocal=False, epochs=1000
) -> tuple[np.ndarray, float]:
    """The paper's recipe (sections 4.3 and 5.1), in the space in which roughness is a logarithm."""
    from drjit.opt import RMSProp

    del starts, rng, library, known  # the paper starts every material from the same values
    problem = objective(brdf, measurements)
    first = parameters.flatten(brdf.parameters, parameters.initial(brdf.parameters))
    optimizer = RMSProp(lr=1e-3, alpha=0.9, params={"u": mi.Float(problem.space.to(first).astype(np.float32))})

    def report(step, loss):
        if step % 50 == 0:
            callback("rmsprop", step, float(dr.mean(loss)[0]))

    u = descend(problem, optimizer, parameter_space.Space(brdf.parameters, _held(reciprocal)), epochs, report)
    return problem.space.back(u), float(problem.loss(u[None])[0])


def descend(problem: Objective, optimizer, space: parameter_space.Space, steps: int, callback: Callable) -> np.ndarray:
    """Take steps with gradients of all samples inside the box of `space`, and return the parameters, (P,).

    Parameters
    ----------
    problem : Objective
        Of one material.
    optimizer : drjit.opt.Optimizer
        Whose variable ``"u"`` holds the start.
    space : parameters.Space
    steps : int
    callback : callable
        ``callback(step, loss)`` after every step, with the loss of each sample before it.
    """
    low, high = (mi.Float(v.astype(np.float32)) for v in (space.low, space.high))
    for step in range(steps):
        flat = mi.Float(dr.detach(optimizer["u"]))
        dr.enable_grad(flat)
        loss, gradient = problem.gradient(flat)
        dr.set_grad(optimizer["u"], gradient)
        optimizer.step()
        optimizer["u"] = dr.clip(dr.detach(optimizer["u"]), low, high)
        callback(step, loss)
    return np.array(dr.detach(optimizer["u"]), np.float64)


def fit_analytic(brdf: EnhancedBRDF, wi, wo, f, n: int) -> np.ndarray:
    """Best analytic parameters of B materials at once, (B, P): every start in turn, the best of each material kept.

    Parameters
    ----------
    brdf : EnhancedBRDF
        Without networks.
    wi, wo, f : Dr.Jit arrays, B * n lanes
        As :class:`mi_enhance.objective.Objective` takes them.
    n : int
        Samples per material.
    """
    problem = Objective(brdf, wi, wo, f, n)
    space, best = problem.space, None
    for row in analytic_starts(brdf):
        u = np.tile(space.to(row), (problem.n_problems, 1))
        u, loss = levenberg_marquardt.minimize(
            problem.loss, problem.normal_equations, u, space.low, space.high, steps=30
        )
        if best is None:
            best = u, loss
        better = loss < best[1]
        best = np.where(better[:, None], u, best[0]), np.where(better, loss, best[1])
    return space.back(best[0])
