"""Fitting materials to photographs: known geometry and light, sought parameters, gradients through the renderer."""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import mitsuba as mi
import numpy as np

from ..analytic.parameters import Parameter
from ..material.low_rank import refuse_free
from ..material.material import Material
from ..system.checks import positive_int
from ..system.files import digest
from ..system.progress import Callback, Progress, silent
from ..system.variants import require_rgb
from . import image_loss, pictures, targets, uncertainty, visibility
from . import unknowns as unknown_parameters
from .descent import Descent
from .lit_scene import with_lights
from .material_prior import MaterialPrior
from .own_files import OwnFiles
from .result import ImageFit, materials_of, result
from .scene_materials import find
from .schedule import TRIAL, Schedule, contents, stable_names
from .starts import START_SPP, SURVIVORS, ways
from .survey import survey
from .unknowns import Unknown
from .views import View

# Size of the images as 1 / factor, samples per pixel, iterations. Maps are sought coarse to fine. One material for all
# of an object is sought in small images: a pixel holds a whole highlight there. In large ones few pixels do, and the
# loss, a median in disguise, would follow the others; near-mirrors came out twice as wrong.
_OF_MAPS, _OF_ONE, _SIDE = ((2, 16, 150), (1, 16, 250)), (8, 400), 64
PIXELS = 4096  # of an iteration
# An iteration takes as long as so many renders with half of its samples, two of which it is; before it is known better.
_RENDERS = 2.7
PREVIEW = 20  # iterations from one preview to the next
_PREVIEW_SHARE = 20.0  # at most a twentieth of the time
_SHOWN_SPP = 8
_PICTURE = "step_{:04d}.png"
LIGHT = Parameter("light_scale", 1, 1e-3, 1e3, 1.0, log=True)
EXPOSURE = Parameter("exposure_factors", 1, 1 / 16, 16.0, 1.0, log=True)


def fit_images(
    scene: mi.Scene,
    views: Sequence[View],
    *,
    materials: Mapping[str, Material] | None = None,
    unknowns: Sequence[str | Unknown] | None = None,
    starts: Sequence[Mapping[str, np.ndarray]] = (),
    light_scale: bool = False,
    loss: str = "log",
    stages: Sequence[tuple[int, int, int]] | None = None,
    lr: float = 0.05,
    max_depth: int = 6,
    pixels: int = PIXELS,
    exposures: bool = False,
    seed: int = 0,
    checkpoint: str | Path | None = None,
    keep: Callable[[Mapping[str, Material]], None] | None = None,
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
        Those of split "train" are fitted, the others only reported. Each is asked for twice, one at a time, so that a
        sequence that reads files (:class:`mi_enhance.images.view_files.ViewFiles`) never holds two in memory. A view
        with a `light` is lit by it, beside the scene's own lights.
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
    stages : sequence of (int, int, int), optional
        For each: 1 / size of the images, samples per pixel, iterations. Gradients have a quarter of the samples. If
        left out (8 samples, 400 iterations) at a size of about 64 x 64 pixels that count; maps are sought in 150
        iterations at half the size and 250 at the full one.
    lr : float
        Learning rate in the space in which the parameters move; falls like a cosine.
    max_depth : int
        Longest path. A photograph has them all, and the material makes up for those that are missing: in a white room
        a fit at depth 4 came out 6 % too bright.
    pixels : int
        Random pixels of all photographs that an iteration renders: its time and memory depend on them, not on the
        size or number of the photographs.
    exposures : bool
        Whether a factor of each photograph is sought, too, with a geometric mean of 1: for photographs whose exposures
        are not known well.
    seed : int
    checkpoint : str or Path, optional
        ``.npz`` file that keeps the state of the run, about every 20 seconds. A call with the same settings goes on
        from it. It is the caller's to remove.
    keep : callable, optional
        ``keep(materials)``, called when the state is kept and the material is the best so far.
    progress : callable, optional
        Called after every iteration, with the ``loss`` and the seconds ``left`` among its values; before them, while
        photographs are read and starts compared, without.
    preview : str or Path, optional
        Folder for pictures of photographs over renders, one every few iterations. Files of others are not replaced.

    Returns
    -------
    ImageFit

    Raises
    ------
    ValueError
        For a scene without unknowns or light, unknown names, no view to fit, views with and without a light of their
        own, settings out of range, or photographs that do not see what is sought. Single views that do not are told in
        a warning.
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
    checked = _checked(_OF_MAPS if stages is None else stages, lr, max_depth)
    pixels = positive_int(pixels, "pixels", "fit_images()")
    folder = _pictures_folder(preview)
    if loss not in image_loss.LOSSES:
        raise ValueError(f'fit_images(): loss "{loss}" is unknown. Choose one of: {", ".join(image_loss.LOSSES)}.')
    sought = _unknowns(scene, unknowns)
    stages = checked if stages is not None else _stages(scene, sought, views)
    placed = find(mi.traverse(scene), materials)
    for name, known in placed.items():
        refuse_free(known.material, f"fit_images(): {name}")
    progress(Progress("read photographs", 0, len(views)))
    book = survey(views, stages, pixels, 2 * SURVIVORS * TRIAL, seed)
    lit = with_lights(scene, book.lights)
    _check_lit(lit)
    n_seen = sum(int((look.weight[..., 0] > 0).sum()) for look in book.looks)
    prior = MaterialPrior(placed, mi.traverse(scene), [u.key for u in sought], n_seen)
    descent = Descent(
        lit,
        sought,
        Unknown("light_scale", LIGHT) if light_scale else None,
        image_loss.Measure(loss, book.scale),
        max_depth,
        seed,
        Unknown("exposure_factors", EXPOSURE) if exposures else None,
        book.fitted,
        prior,
    )
    names = list(book.numbers)
    photographs = dict(zip(names, book.contents, strict=True))
    settings = {"loss": loss, "stages": [list(s) for s in stages], "lr": lr, "max_depth": int(max_depth), "seed": seed}
    settings |= {"pixels": pixels, "exposures": exposures}
    begins = digest(*(descent.values()[u.key].tobytes() for u in sought))
    places = [stable_names(descent)[u.key] for u in sought]
    same = {**settings, "views": photographs, "light_scale": light_scale, "unknowns": places, "start": begins}
    same["scene"] = contents(mi.traverse(scene), [u.key for u in sought])
    schedule = Schedule(descent, book, stages, lr, same, Path(checkpoint) if checkpoint else None)
    if not schedule.resume():
        for text in visibility.warnings_of(descent, placed, book.looks, names, seed):
            warnings.warn(text, stacklevel=2)
        samples = sum(spp * steps for _, spp, steps in (*stages, (1, stages[0][1], SURVIVORS * TRIAL)))
        progress(Progress("compare starts", 0))

        def tell(k: int, n: int, seconds: float) -> None:
            left = seconds * (_RENDERS * samples / (2 * START_SPP) + 4 * (n - k))
            progress(Progress("compare starts", k, n, {"left": left}))

        schedule.ways = ways(descent, placed, book.looks[:1], starts, seed, tell)
    shown = targets.targets(book.shown, 1, book.numbers) if folder else []
    next_preview = 0.0

    def draw(step: int) -> None:
        nonlocal next_preview
        begun = time.perf_counter()
        if folder and ((step - 1) % PREVIEW == 0 and begun > next_preview):
            with folder.replacing(_PICTURE.format(step)) as temporary:
                pictures.preview(shown[0], descent.render(shown[0], _SHOWN_SPP, seed), temporary)
            next_preview = time.perf_counter() + _PREVIEW_SHARE * (time.perf_counter() - begun)

    def kept() -> None:
        if keep:
            keep(materials_of(descent, placed, {}))

    schedule.run(progress, draw, kept)
    found, blind = visibility.undetermined(descent, book.looks[:1], seed)
    told = uncertainty.of_fit(descent, placed, prior, book.looks[0], seed, progress)
    return result(descent, placed, views, book, found, blind, told, settings, start)


def _stages(scene: mi.Scene, sought: Sequence[Unknown], views: Sequence[View]) -> Sequence[tuple[int, int, int]]:
    """Return the stages that suit what is sought and the pixels that count of the first photograph."""
    params = mi.traverse(scene)
    if not len(views) or any(isinstance(params[u.key], mi.TensorXf) for u in sought):
        return _OF_MAPS
    return ((max(1, round(math.sqrt(views[0].mask.sum()) / _SIDE)), *_OF_ONE),)


def _checked(stages, lr: float, max_depth: int) -> list[tuple[int, int, int]]:
    """Return the stages as integers; everything is looked at before anything is rendered."""
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
    return checked


def _check_lit(scene: mi.Scene) -> None:
    if not scene.emitters():
        raise ValueError(
            "fit_images(): nothing lights the scene. Put a light into it, or give each frame of the photographs a "
            '"light" (docs/photographs.md).'
        )


def _unknowns(scene: mi.Scene, unknowns) -> list[Unknown]:
    given = list(unknowns) if unknowns is not None else []
    names, sought = [u for u in given if isinstance(u, str)], [u for u in given if not isinstance(u, str)]
    if unknowns is None or names:
        sought += unknown_parameters.enhanced(scene, names or None)
    if not sought:
        raise ValueError("fit_images(): unknowns is empty. Name what is sought, or leave it out.")
    unknown_parameters.check(scene, sought)
    return sought


def _pictures_folder(path: str | Path | None) -> OwnFiles | None:
    if path is None:
        return None
    own = OwnFiles(Path(path), "fit_images(), preview")
    for existing in own.folder.glob(_PICTURE.format(0).replace("0000", "*")):
        own.check(existing.name)  # before anything is rendered
    return own
