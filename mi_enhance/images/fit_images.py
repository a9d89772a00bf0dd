"""Fitting materials to photographs: known geometry and light, sought parameters, gradients through the renderer."""

from __future__ import annotations

import time
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path

import mitsuba as mi
import numpy as np

from ..analytic.parameters import Parameter
from ..material.colour_normalization import plain
from ..material.material import Material
from ..numerics.schedules import cosine_decay
from ..system.checks import positive_int
from ..system.progress import Callback, Progress, silent
from ..system.variants import require_rgb
from . import image_loss, pictures, visibility
from . import targets as targets_module
from . import unknowns as unknown_parameters
from .descent import Descent
from .own_files import OwnFiles
from .result import RECENT, ImageFit, result
from .scene_materials import SceneMaterial, find
from .starts import candidates, with_best_colours
from .targets import Target
from .unknowns import Unknown
from .views import View

# Size of the images as 1 / factor, samples per pixel, iterations: coarse to fine.
STAGES = ((2, 8, 80), (1, 16, 120))
_SURVIVORS, _TRIAL = 3, 25  # starts that go down a way, and how far, before the best is taken
_START_SIZE, _START_SPP = 24, 16  # pixels on a side at which starts are compared
_LATE = 0.2  # of the first stage's iterations without the latent numbers
PREVIEW = 20  # iterations from one preview to the next
_PICTURE = "step_{:04d}.png"
_LAST_RATE = 0.05  # learning rate at the end, as a share of that at the start
LIGHT = Parameter("light_scale", 1, 1e-3, 1e3, 1.0, log=True)


def fit_images(
    scene: mi.Scene,
    views: Sequence[View],
    *,
    materials: Mapping[str, Material] | None = None,
    unknowns: Sequence[str | Unknown] | None = None,
    starts: Sequence[Mapping[str, np.ndarray]] = (),
    light_scale: bool = False,
    loss: str = "log",
    stages: Sequence[tuple[int, int, int]] = STAGES,
    lr: float = 0.05,
    max_depth: int = 6,
    seed: int = 0,
    progress: Callback = silent,
    preview: str | Path | None = None,
) -> ImageFit:
    """Find the parameters with which a scene looks like photographs of it. The scene keeps them.

    Adam descends through Mitsuba's ``prb``, coarse images first, from the best of several starts: those of the model,
    and for a network training materials, each with the colours that explain the images best. Latent numbers join when
    the analytic parameters have settled. Residual and gradient come from different random numbers.

    Parameters
    ----------
    scene : mi.Scene
        Geometry and light as they are, with at least one BSDF of type ``enhanced``, or other `unknowns`.
    views : sequence of View
        Those of split "train" are fitted, the others only reported.
    materials : dict of str to Material, optional
        By id of the BSDF (what its keys in ``mi.traverse(scene)`` begin with, where it has none or shares it), what the
        scene was loaded with; needed only for the library of starts of a network that came from memory.
    unknowns : sequence of str or Unknown, optional
        Names of parameters of the enhanced BSDFs, or any scene parameters, see :mod:`mi_enhance.images.unknowns`. All
        but the tilt of the normal if left out.
    starts : sequence of dict, optional
        More starts: values by key of ``mi.traverse(scene)``.
    light_scale : bool
        Whether the brightness of all light is sought, too, as one factor.
    loss : {"log", "relative"}
        See :class:`mi_enhance.images.image_loss.Measure`.
    stages : sequence of (int, int, int)
        For each: 1 / size of the images, samples per pixel, iterations.
    lr : float
        Learning rate in the space in which the parameters move; falls like a cosine.
    max_depth : int
        Longest path. A photograph has them all, and the material makes up for those that are missing: in a white room
        a fit at depth 4 came out 6 % too bright.
    seed : int
    progress : callable, optional
        Called after every iteration, with the ``loss`` among its values.
    preview : str or Path, optional
        Folder for pictures of photographs over renders, one every few iterations. Files of others are not replaced.

    Returns
    -------
    ImageFit

    Raises
    ------
    ValueError
        For a scene without unknowns, unknown names, no view to fit, settings out of range, or photographs that do not
        see what is sought. Single views that do not are told in a warning.
    RuntimeError
        If no RGB variant with gradients is active.

    Examples
    --------
    >>> from mi_enhance.evaluation import scenes
    >>> from mi_enhance.images.cameras import around, render_views
    >>> cameras = around(1, target=(0, 1, 0), distance=5, resolution=16)
    >>> paint = Material.analytic("ggx").edit(rho_d=(0.6, 0.1, 0.1), rho_s=0.0)
    >>> photos = render_views(scenes.load("sphere_envmap", paint.bsdf(), resolution=16), cameras, spp=64)
    >>> ball = scenes.load("sphere_envmap", Material.analytic("ggx").bsdf(), resolution=16)
    >>> found = fit_images(ball, photos, unknowns=["rho_d", "rho_s"], stages=[(1, 16, 10)], max_depth=2)
    >>> found.report["mean_abs_log"]["train"] < 0.03
    True
    """
    start = time.perf_counter()
    require_rgb("fit_images()")
    train, stages = _checked(views, stages, lr, max_depth)
    folder = _pictures_folder(preview)
    scale = image_loss.brightness(train)
    if loss not in image_loss.LOSSES:
        raise ValueError(f'fit_images(): loss "{loss}" is unknown. Choose one of: {", ".join(image_loss.LOSSES)}.')
    measure = image_loss.Measure(loss, scale)
    sought = _unknowns(scene, unknowns)
    placed = find(mi.traverse(scene), materials)
    light = Unknown("light_scale", LIGHT) if light_scale else None
    descent = Descent(scene, sought, light, measure, max_depth, seed)
    small = _small(train)
    for text in visibility.warnings_of(descent, placed, small, seed):
        warnings.warn(text, stacklevel=2)

    def go(stage: str, targets: Sequence[Target], spp: int, rates: Sequence[float], late: int = 0) -> None:
        for k, rate in enumerate(rates):
            target = targets[k % len(targets)]
            image = descent.step(target, spp, rate, hold_late=k < late)
            step, value = descent.curve[-1]["step"], descent.curve[-1]["loss"]
            progress(Progress(stage, k + 1, len(rates), {"loss": value}))
            if folder and (step - 1) % PREVIEW == 0:
                with folder.replacing(_PICTURE.format(step)) as temporary:
                    pictures.preview(target, image, temporary)

    targets = targets_module.targets(train, stages[0][0])
    ways = _starts(descent, placed, small, scale, starts, seed)
    ends = []
    for k, way in enumerate(ways if len(ways) > 1 else ()):
        descent.put(way)
        go(f"start {k + 1} of {len(ways)}", targets, stages[0][1], [lr] * _TRIAL)
        recent = [row["loss"] for row in descent.curve[-RECENT:]]
        ends.append((float(np.mean(recent)), {**way, **descent.values()}))
    descent.put(min(ends, key=lambda end: end[0])[1] if ends else ways[0])
    n = sum(steps for *_, steps in stages)
    rates = [lr * cosine_decay(k, n, low=_LAST_RATE) for k in range(n)]
    for k, (factor, spp, steps) in enumerate(stages):
        targets = targets if k == 0 else targets_module.targets(train, factor)
        own, rates = rates[:steps], rates[steps:]
        go(f"stage {k + 1} of {len(stages)}", targets, spp, own, round(_LATE * steps) if k == 0 else 0)
    descent.settle()
    settings = {"loss": loss, "stages": [list(s) for s in stages], "lr": lr, "max_depth": int(max_depth), "seed": seed}
    return result(descent, placed, views, visibility.undetermined(descent, small, seed), settings, start)


def _checked(views: Sequence[View], stages, lr: float, max_depth: int) -> tuple[list[View], list[tuple[int, int, int]]]:
    """Return the views to fit, and the stages as integers; everything is looked at before anything is rendered."""
    train = [v for v in views if v.split == "train"]
    if not train:
        raise ValueError(f'fit_images(): none of the {len(views)} views has split "train". At least one is needed.')
    names = [v.name for v in views]
    if len(set(names)) < len(names):
        raise ValueError("fit_images(): two views have the same name. Rename one.")
    for view in views:
        if not np.isfinite(view.image).all():  # under the mask anything has become 0
            raise ValueError(f'fit_images(): view "{view.name}" holds NaN or infinity where it counts. Mask it there.')
    where = "fit_images(), stages (1 / size, samples per pixel, iterations)"
    checked = []
    for stage in stages:
        if np.shape(stage) != (3,):
            raise ValueError(f"{where}: {stage!r} must be three positive integers.")
        factor, spp, steps = (positive_int(n, f"one of {tuple(stage)}", where) for n in stage)
        checked.append((factor, spp, steps))
    if not checked:
        raise ValueError("fit_images(): stages is empty. At least one is needed, such as (1, 16, 100).")
    if not 0 < lr < 10:
        raise ValueError(f"fit_images(): lr = {lr} is out of range: above 0, below 10.")
    if positive_int(max_depth, "max_depth", "fit_images()") < 2:
        raise ValueError(f"fit_images(): max_depth is {max_depth!r}; 2 (light, surface, camera) is the least.")
    return train, checked


def _unknowns(scene: mi.Scene, unknowns) -> list[Unknown]:
    given = list(unknowns) if unknowns is not None else []
    names, sought = [u for u in given if isinstance(u, str)], [u for u in given if not isinstance(u, str)]
    if unknowns is None or names:
        sought += unknown_parameters.enhanced(scene, names or None)
    if not sought:
        raise ValueError("fit_images(): unknowns is empty. Name what is sought, or leave it out.")
    unknown_parameters.check(scene, sought)
    return sought


def _small(train: Sequence[View]) -> list[Target]:
    """Small images, for what needs many renders."""
    side = np.sqrt(np.mean([v.mask.sum() for v in train]))  # of what counts: the object may be small in the picture
    return targets_module.targets(train, max(1, round(side / _START_SIZE)))


def _starts(
    descent: Descent, placed: Mapping[str, SceneMaterial], targets: Sequence[Target], scale: float, given, seed: int
) -> list[dict]:
    """Values to start from, the most promising first; several only where there is a single material."""
    render = lambda target: descent.render(target, _START_SPP, seed)  # noqa: E731
    if descent.light:
        # before any colour: a bright one under a dark light is a minimum, too
        descent.put({"light_scale": np.array([image_loss.ratio(targets, [render(t) for t in targets])])})
    free = {u.key for u in descent.unknowns}
    first, ways = dict(descent.values()), []
    for one in placed.values():
        # with some parameters known or textured, the others start as they are
        all_free = all(one.keys.get(name) in free for name in one.moving())
        ranked = []
        for material in candidates(one) if all_free else [one.read(descent.params)]:
            found, error = with_best_colours(
                one, plain(material) if all_free else material, free, descent.params, targets, render, scale
            )
            ranked.append((error, one.assignment(found)))
        ranked.sort(key=lambda pair: pair[0])
        ways = [{**first, **way} for _, way in ranked[:_SURVIVORS]]
        first.update(ranked[0][1])
        descent.put(first)
    if given:
        errors = []
        for way in given:
            descent.put({**first, **way})
            errors.append(sum(descent.measure.loss(render(t), t) for t in targets))
        ways += [{**first, **given[k]} for k in np.argsort(errors)[:_SURVIVORS]]
    return ways if ways and len(placed) < 2 else [first]


def _pictures_folder(path: str | Path | None) -> OwnFiles | None:
    if path is None:
        return None
    own = OwnFiles(Path(path), "fit_images(), preview")
    for existing in own.folder.glob(_PICTURE.format(0).replace("0000", "*")):
        own.check(existing.name)  # before anything is rendered
    return own
