"""Starts of a fit to images: sets of parameters, with the colours that explain the photographs best."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Collection, Mapping, Sequence

import mitsuba as mi
import numpy as np

from ..analytic import parameter_space, parameters
from ..analytic.parameters import FRAME, Parameter
from ..material.colour_normalization import plain
from ..material.material import Material
from ..neural.inputs import COLOURLESS
from . import image_loss
from .descent import Descent
from .scene_materials import SceneMaterial, put
from .targets import Target

_LIBRARY = 48  # training materials that are tried, as different from one another as can be
SURVIVORS = 3  # starts that go down a way
START_SPP = 8  # samples per pixel when starts are compared
_SWEEPS = 4  # reweighted least squares towards the L1 solution
# Least colour, and the other one of renders that measure what each contributes. Not 0: what is 0 is left out of the
# BSDF, which makes another kernel.
_DARK, _BRIGHT = 1e-4, 1.0


def ways(
    descent: Descent,
    placed: Mapping[str, SceneMaterial],
    targets: Sequence[Target],
    given: Sequence[Mapping[str, np.ndarray]],
    seed: int,
    tell: Callable[[int, int, float], None],
) -> list[dict]:
    """Return values to start from, the most promising first; several only where there is a single material.

    Parameters
    ----------
    descent : Descent
        Its light and exposures become those that explain the photographs best.
    placed : dict of str to SceneMaterial
    targets : sequence of Target
        Pixels that decide.
    given : sequence of dict
        More starts: values by key.
    seed : int
    tell : callable
        ``tell(done, all, seconds)`` after each start but the first, with the least time of a render: others compile.
    """
    least = np.inf

    def render(target: Target) -> np.ndarray:
        nonlocal least
        begun = time.perf_counter()
        image = descent.render(target, START_SPP, seed)
        least = min(least, time.perf_counter() - begun)
        return image

    if descent.light:
        # before any colour: a bright one under a dark light is a minimum, too
        descent.put({"light_scale": np.array([image_loss.ratio(targets, [render(t) for t in targets])])})
    if descent.exposures:
        images = [render(t) for t in targets]
        ratios = [image_loss.ratio(targets, images, k) if f else 1.0 for k, f in enumerate(descent.fitted)]
        factors = np.where(descent.fitted, np.array(ratios) / np.exp(np.log(ratios)[descent.fitted].mean()), 1)
        descent.put({"exposure_factors": factors})
    free = {u.key for u in descent.unknowns}
    first, found = dict(descent.values()), []
    for one in placed.values():
        # with some parameters known or textured, the others start as they are
        all_free = all(one.keys.get(name) in free for name in one.moving())
        ranked = []
        tried = candidates(one) if all_free else [one.read(descent.params)]
        for material in tried:
            material, error = with_best_colours(
                one,
                plain(material) if all_free else material,
                free,
                descent.params,
                targets,
                render,
                descent.measure.scale,
            )
            ranked.append((error, one.assignment(material)))
            if len(ranked) > 1:
                tell(len(ranked), len(tried), least)
        ranked.sort(key=lambda pair: pair[0])
        found = [{**first, **way} for _, way in ranked[:SURVIVORS]]
        first.update(ranked[0][1])
        descent.put(first)
    if given:
        errors = []
        for way in given:
            descent.put({**first, **way})
            errors.append(sum(descent.measure.loss(render(t), t) for t in targets))
        found += [{**first, **given[k]} for k in np.argsort(errors)[:SURVIVORS]]
    return found if found and len(placed) < 2 else [first]


def candidates(one: SceneMaterial) -> list[Material]:
    """Return the material as it is, the starts of its analytic model, and a selection of the training materials."""
    brdf = one.material.brdf
    values = parameters.initial(brdf.parameters)
    result = [one.material]
    result += [Material(brdf, {**values, **start}) for start in brdf.model.starts]
    library = one.material.library
    if library is not None:
        for k in spread(library_shapes(brdf, library), _LIBRARY):
            row = parameters.unflatten(brdf.parameters, np.asarray(library[k], np.float64))
            # the frame of a measurement is no property of the material
            own = {p.name: np.clip(row[p.name], p.low, p.high) for p in brdf.parameters if p.name not in FRAME}
            result.append(Material(brdf, own))
    return result


def library_shapes(brdf, library: np.ndarray) -> np.ndarray:
    """Return the numbers of training materials besides their colours, each over its spread."""
    free = np.concatenate([np.full(p.size, not (p.is_colour or p.fixed)) for p in brdf.parameters])
    u = parameter_space.Space(brdf.parameters).to_free(np.asarray(library, np.float64))[:, free]
    return (u - u.mean(0)) / (u.std(0) + 1e-6)  # 1e-6: what never varies


def spread(x: np.ndarray, n: int) -> list[int]:
    """Rows of `x` that lie far from one another, the one nearest to the mean first.

    Examples
    --------
    >>> spread(np.array([[0.0], [0.1], [1.0], [-1.1]]), 3)
    [0, 3, 2]
    """
    chosen = [int(np.argmin(((x - x.mean(0)) ** 2).sum(1)))]
    nearest = ((x - x[chosen[0]]) ** 2).sum(1)
    while len(chosen) < min(n, len(x)):
        chosen.append(int(np.argmax(nearest)))
        nearest = np.minimum(nearest, ((x - x[chosen[-1]]) ** 2).sum(1))
    return chosen


def with_best_colours(
    one: SceneMaterial,
    material: Material,
    free: Collection[str],
    params: mi.SceneParameters,
    targets: Sequence[Target],
    render: Callable,
    scale: float,
) -> tuple[Material, float]:
    """Return the material with the colours that explain the targets best, and its loss.

    A render is linear in the colours, but for light that meets the material twice: one render with all colours dark and
    one for each tell the rest.

    Parameters
    ----------
    free : collection of str
        Keys of what is unknown: other colours stay.
    render : callable
        ``render(target) -> array``, of the scene as it is.
    """
    own = {key for key in one.assignment(material) if key in free}
    colours = [p for p in _linear_colours(material) if one.keys.get(p.name) in own]

    def pictures(**values):
        for key, value in one.assignment(material.edit(**values)).items():
            put(params, key, value)
        params.update()
        return np.concatenate([render(t).reshape(-1, 3) for t in targets])

    truth = np.concatenate([t.image.reshape(-1, 3) for t in targets])
    weight = np.concatenate([t.weight.reshape(-1, 3) for t in targets]) / len(targets)
    if not colours:
        return material, _error(pictures(), truth, weight, scale)
    dark = {p.name: _DARK for p in colours}
    base = pictures(**dark)
    parts = np.stack([(pictures(**{**dark, p.name: _BRIGHT}) - base) / (_BRIGHT - _DARK) for p in colours])
    found, prediction = np.zeros((len(colours), 3)), np.empty_like(truth)
    for c in range(3):
        w = weight[:, c] / (truth[:, c] + scale) ** 2
        for _ in range(_SWEEPS):
            found[:, c] = _bounded(parts[:, :, c].T, truth[:, c] - base[:, c], w, [p.high for p in colours])
            prediction[:, c] = base[:, c] + found[:, c] @ parts[:, :, c]
            distance = np.abs(np.log1p(np.maximum(prediction[:, c], 0) / scale) - np.log1p(truth[:, c] / scale))
            # 0.01: what is explained to a percent counts no more for being explained better
            w = weight[:, c] / (truth[:, c] + scale) ** 2 / (distance + 0.01)
    fitted = material.edit(**{p.name: np.maximum(found[k], _DARK) for k, p in enumerate(colours)})
    return fitted, _error(prediction, truth, weight, scale)


def _error(image, truth, weight, scale) -> float:
    return float((weight * np.abs(np.log1p(np.maximum(image, 0) / scale) - np.log1p(truth / scale))).sum())


def _bounded(a: np.ndarray, b: np.ndarray, w: np.ndarray, high: Sequence[float]) -> np.ndarray:
    """Least squares with 0 <= x <= high: the best of all choices of which of the few unknowns are free."""
    n = a.shape[1]
    h, g = (a * w[:, None]).T @ a, (a * w[:, None]).T @ b
    best, least = np.zeros(n), np.inf
    for free in itertools.product((False, True), repeat=n):
        x, index = np.zeros(n), np.flatnonzero(free)
        # 1e-9 of the trace: a colour that no pixel shows leaves the equations singular
        system = h[np.ix_(index, index)] + 1e-9 * np.trace(h) * np.eye(len(index)) + 1e-30 * np.eye(len(index))
        x[index] = np.clip(np.linalg.solve(system, g[index]), 0, np.asarray(high)[index])
        error = x @ h @ x - 2 * g @ x
        if error < least:
            best, least = x, error
    return best


def _linear_colours(material: Material) -> list[Parameter]:
    """Colours in which the BRDF is linear: each the only colour of its terms, and read by no network."""
    brdf = material.brdf
    if brdf.networks and brdf.inputs not in COLOURLESS:
        return []
    colours = parameters.colours(brdf.model.parameters)
    terms = [node.inputs or () for node in brdf.model.graph.walk() if not node.args]
    factors = [inputs for inputs in terms if set(inputs) & colours]
    alone = {inputs[0] for inputs in factors if len(inputs) == 1}
    shared = {name for inputs in factors if len(inputs) > 1 for name in inputs}
    return [p for p in brdf.model.parameters if p.name in alone - shared]
