"""A small network of a material's own, learned from its measurements together with colours and roughnesses.

Factors in RGB turn hue with the angle, and all samples teach some hundred numbers. Levenberg-Marquardt on few samples
first, then on more, until the error on samples that were not learned stops falling.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Sequence

import numpy as np

from ..analytic import parameters
from ..analytic.graph import Node
from ..data.measurements import Measurements
from ..fitting.losses import log_l1
from ..material.colour_normalization import normalize
from ..material.material import Material
from ..neural.distilled_network import DistilledNetwork
from ..neural.enhanced_brdf import EnhancedBRDF
from ..neural.inputs import InputKind, names_of_directions
from ..numerics import levenberg_marquardt
from ..sampling import albedo
from ..sampling.mixture_fit import fit_mixture
from ..system.progress import Callback, Progress, silent
from . import distillation
from .own_problem import OwnProblem

_SEEDS = 4  # first weights that are tried
# Samples, most steps of a network of up to 8 units a layer. Larger ones settle later: with twice the steps, in all
# stages or the first two, 12-12 came to 0.92 to 0.98 of the error on six MERL materials kept aside.
_STAGES = ((2048, 8), (4096, 15), (12288, 25), (32768, 20), (1 << 17, 10))
# Curvature of a part of the samples may ask for far too long steps: a shorter one costs less than a new linearization.
_TRIES = 6
_UNSEEN = 8192  # samples that are not learned; they decide when to stop
# A feature that varies by less, as the azimuth where both roughnesses are equal, is not blown up.
_MIN_SPREAD = 0.05
_ENOUGH, _LAST = 2e-3, 1 << 15  # a share of the error on them: a stage of so many samples that gains less is the last
# Roughnesses this close, and a normal tilted this little (radians), are measurement noise: the material is isotropic,
# and saves the inputs that depend on the azimuth.
_SAME_ROUGHNESS, _NO_TILT = 0.05, 0.01


def own_network(
    material: Material,
    seen: Measurements,
    unseen: Measurements,
    hidden: Sequence[int] = (8, 8),
    *,
    reciprocal: bool = False,
    hold: bool = False,
    seed: int = 0,
    progress: Callback = silent,
) -> tuple[Material, float]:
    """Return the material with a network of its own in place of the shared one, and its error on unseen samples.

    Parameters
    ----------
    material : Material
        Fitted to the measurements: its analytic parameters are where these start.
    seen, unseen : Measurements
        What is learned, in random order, and what decides when to stop; see :func:`divided`.
    hidden : sequence of int
        Units of the layers.
    reciprocal : bool
        Give the network nothing by which it could tell viewer from light.
    hold : bool
        Leave the analytic parameters as they are.
    seed : int
        Of first weights.
    progress : callable
        Hears of every stage.
    """
    start = _isotropic(material) if _is_isotropic(material) and not hold else material
    make = _problems(start, hidden, reciprocal, hold)
    few = make(seen, _STAGES[0][0])
    low, high = few.box()
    trials = [few.first(np.random.default_rng((seed, k))) for k in range(_SEEDS)]
    best, judge = None, make(unseen, len(unseen.f))
    for n, most in _STAGES:
        problem, steps = make(seen, n), round(most * max(1, max(hidden) / 8))
        fitted = functools.partial(levenberg_marquardt.minimize, problem.loss, problem.normal_equations)
        trials = [fitted(u[None], low, high, steps=steps, tolerance=3e-4, tries=_TRIES)[0] for u in trials]
        errors = [float(judge.loss(u)[0]) for u in trials]
        order = np.argsort(errors)
        trials = [trials[k][0] for k in order[: -(-len(order) // 2)]]  # the better half goes on
        error = errors[order[0]]
        progress(Progress(f"network {'-'.join(map(str, hidden))}, {n} samples", 1, 1, {"error": error}))
        if best is not None and n >= _LAST and error > best[1] * (1 - _ENOUGH):
            break
        best = (trials[0], error) if best is None or error < best[1] else best
        if n >= len(seen.f):
            break
    assert best is not None
    return _material(material, judge, best[0], _kind(reciprocal)), best[1]


def divided(measurements: Measurements, seed: int) -> tuple[Measurements, Measurements]:
    """Return measurements in random order in two parts: to learn, and a tenth, at most 8,192, to judge by."""
    if len(measurements.f) < 10:
        raise ValueError(
            f"a network of its own needs at least 10 samples, of which a tenth judges it; got {len(measurements.f)}. "
            "Take the shared network."
        )
    order = np.random.default_rng(seed).permutation(len(measurements.f))
    n = min(_UNSEEN, len(order) // 10)
    m = measurements
    unseen, seen = (dataclasses.replace(m, wi=m.wi[k], wo=m.wo[k], f=m.f[k]) for k in (order[:n], order[n:]))
    return seen, unseen


def finished(material: Material) -> Material:
    """Return a material whose parameters have moved with colours that mean what they say, and sampled as it is now."""
    material = normalize(material)
    params = material.as_drjit()
    return dataclasses.replace(
        material, lobe_albedo=albedo.lobe_albedo(material.brdf, params), mixture=fit_mixture(material.brdf, params)
    )


def error_of(material: Material, m: Measurements) -> float:
    """Return eq. 1 of a material on measurements."""
    return log_l1(material.evaluate(m.wi, m.wo), m.f, m.wo[:, 2])


def reported(material: Material, measurements: Measurements) -> Material:
    """Return a material with a network of its own, and its own error in the report in place of the shared one's."""
    report = {key: value for key, value in material.report.items() if key != "chosen"}
    if "log_l1" in report:
        report["log_l1_shared"] = report["log_l1"]
    return dataclasses.replace(material, report=report | {"log_l1": error_of(material, measurements)})


def can_have_one(brdf: EnhancedBRDF) -> bool:
    """Tell whether a material can have a network of its own: shared ones that stay in its file must see as it does."""
    return not brdf.networks or brdf.inputs in ("shape", "reciprocal")


def slots_of(graph: Node) -> tuple[str, ...]:
    """Return one term of each summand, whose factor the network gives: B where there is one, else the last but 1/E.

    Examples
    --------
    >>> from mi_enhance.analytic import models
    >>> slots_of(models.get("ggx2").graph), slots_of(models.get("ggx").graph)
    (('B', 'G', 'G2'), ('M', 'G'))
    """
    return tuple(
        [n.name for n in summand.walk() if not n.args and not n.name.startswith("1/E")][-1]
        for summand in _summands(graph)
    )


def _summands(node: Node):
    if node.symbol == "+":
        for a in node.args:
            yield from _summands(a)
    else:
        yield node


def _is_isotropic(material: Material) -> bool:
    p = material.params
    pairs = [(p[x], p[x.replace("_x", "_y")]) for x in ("alpha_x", "alpha_x2") if x in p]
    tilt = max((abs(float(p[name][0])) for name in ("n_x", "n_y") if name in p), default=0.0)
    return tilt < _NO_TILT and all(abs(np.log(a[0] / b[0])) < _SAME_ROUGHNESS for a, b in pairs)


def _isotropic(material: Material) -> Material:
    p, values = material.params, {}
    for x in ("alpha_x", "alpha_x2"):
        if x in p:
            y = x.replace("_x", "_y")
            values[x] = values[y] = np.sqrt(p[x] * p[y])
    values |= {name: np.zeros(1) for name in parameters.FRAME if name in p}
    return dataclasses.replace(material, params={**p, **values})


def _problems(
    material: Material, hidden: Sequence[int], reciprocal: bool, hold: bool
) -> Callable[[Measurements, int], OwnProblem]:
    """Return a function that makes the problem of the first `n` samples."""
    brdf, isotropic = material.brdf, _is_isotropic(material)
    params = (*brdf.model.parameters, parameters.ASYMMETRY)
    values = {p.name: material.params.get(p.name, np.zeros(p.size)) for p in params}
    values["asymmetry"] = np.ones(1)
    names = names_of_directions(brdf.model, _kind(reciprocal), brdf.model.graph)
    # The logarithm of the ratio of the cosines adds little to their difference.
    inputs = [name for name in names if "log_ratio" not in name and not (isotropic and "azimuth" in name)]
    moving = np.zeros((parameters.count(params), 0)) if hold else _moving(params, isotropic)
    slots, scale = slots_of(brdf.model.graph), (np.zeros(len(inputs)), np.ones(len(inputs)))

    def make(m: Measurements, n: int) -> OwnProblem:
        nonlocal scale
        known = (brdf.model, slots, inputs, hidden, m.wi[:n], m.wo[:n], m.f[:n], values, moving)
        if not scale[0].any():  # the first samples say what is standard
            x = OwnProblem(*known, *scale).inputs_at_start()
            scale = x.mean(0), np.maximum(x.std(0), _MIN_SPREAD)
        return OwnProblem(*known, *scale)

    return make


def _moving(params: Sequence[parameters.Parameter], isotropic: bool) -> np.ndarray:
    """Return how the unknowns move the parameters: both roughnesses of an isotropic material as one."""
    names = [p.name for p in params for _ in range(p.size)]
    columns = []
    for k, name in enumerate(names):
        if name == "asymmetry" or (isotropic and (name in parameters.FRAME or name.startswith("alpha_y"))):
            continue
        column = np.zeros(len(names))
        column[k] = 1
        if isotropic and name.startswith("alpha_x"):
            column[names.index(name.replace("_x", "_y"))] = 1
        columns.append(column)
    return np.array(columns).T


def _kind(reciprocal: bool) -> InputKind:
    return "reciprocal" if reciprocal else "shape"


def _material(material: Material, problem: OwnProblem, u: np.ndarray, kind: InputKind) -> Material:
    """Return the material with the network that the unknowns say."""
    free, layers = problem.split(u)
    values = parameters.unflatten(problem.parameters, problem.space.to_physical(free))
    raw = tuple(distillation.on_raw_inputs(layers, problem.mean, problem.std))
    network = DistilledNetwork(problem.slots, problem.inputs, raw, 3)
    brdf = dataclasses.replace(material.brdf, distilled=(network,), inputs=kind, reference=None)
    norms = {p.name: np.zeros(p.size) for p in brdf.parameters if p.name.startswith("norm_")}
    params = {**material.params, **norms, **values}  # norms belong to the networks that are not evaluated any more
    exact = material.params if material.brdf.networks else None
    reference = material.brdf.reference if exact else None
    return dataclasses.replace(material, brdf=brdf, params=params, exact_params=exact, exact_reference=reference)
