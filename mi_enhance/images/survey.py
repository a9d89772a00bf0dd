"""One pass over the photographs of a fit: what is needed of them is drawn, each is read once and forgotten."""

from __future__ import annotations

import dataclasses
import math
import warnings
from collections.abc import Sequence

import numpy as np

from ..data.lights import Light
from ..system.files import digest
from .image_loss import brightness
from .targets import RandomPixels, Target
from .views import View

_SEEN_PIXELS = 256  # of each photograph, that tell whether it shows what is sought
_SHOWN, _SHOWN_SIZE = 6, 192  # photographs in a preview, and their longest side
_JUDGED = 1 << 18  # pixels of all photographs that are rendered at the end: with 64 samples, 17 million paths


@dataclasses.dataclass(frozen=True, eq=False)
class Survey:
    """What a fit keeps of its photographs.

    Parameters
    ----------
    numbers : dict of str to int
        Number of each photograph by its name, in the order in which they came.
    contents : list of str
        A digest of each photograph, by number: its pixels, camera, light and part.
    fitted : array of bool
        By number.
    lights : list of Light or None
        By number, flashes as point lights.
    stages : list of RandomPixels
        Pixels of the iterations of every stage, of the photographs that are fitted.
    looks : list of Target
        Some pixels of all photographs that are fitted, for starts and to tell what is seen.
    scale : float
        Median brightness.
    shown : list of View
        Small ones, for previews.
    factor : int
        So many times smaller are photographs when they are judged.
    """

    numbers: dict[str, int]
    contents: list[str]
    fitted: np.ndarray
    lights: list[Light | None]
    stages: list[RandomPixels]
    looks: list[Target]
    scale: float
    shown: list[View]
    factor: int


def survey(views: Sequence[View], stages: Sequence[tuple[int, int, int]], n: int, extra: int, seed: int) -> Survey:
    """Read every photograph once.

    Parameters
    ----------
    views : sequence of View
        May read a photograph only when it is asked for.
    stages : sequence of (int, int, int)
        1 / size, samples per pixel, iterations.
    n : int
        Pixels of an iteration.
    extra : int
        Iterations besides those of the first stage, at its size.
    seed : int

    Raises
    ------
    ValueError
        If there is no photograph to fit, two have one name, one holds NaN where it counts, or no pixel counts.
    """
    splits = getattr(views, "splits", None) or [v.split for v in views]
    n_train = splits.count("train")
    if not n_train:
        raise ValueError(f'fit_images(): none of the {len(views)} views has split "train". At least one is needed.')
    rng = np.random.default_rng(seed)
    pools = [RandomPixels(n, steps + (extra if k == 0 else 0), n_train, rng) for k, (_, _, steps) in enumerate(stages)]
    looks = RandomPixels(n, math.ceil(_SEEN_PIXELS * n_train / n), n_train, rng)
    numbers: dict[str, int] = {}
    contents: list[str] = []
    lights: list[Light | None] = []
    shown: list[tuple[View, tuple[int, int]]] = []
    empty: list[str] = []
    n_pixels = 0
    for k, view in enumerate(views):
        _check(view, numbers)
        numbers[view.name] = k
        contents.append(_content(view))
        lights.append(view.light.in_world(view.to_world) if view.light else None)
        n_pixels += view.mask.size
        if splits[k] != "train":
            continue
        if not view.mask.any():
            empty.append(view.name)
        for (factor, _, _), pool in zip(stages, pools, strict=True):
            pool.add(view.smaller(factor), k)
        looks.add(view, k)
        if len(shown) < _SHOWN and (not shown or view.size == shown[0][1]):
            shown.append((view.smaller(max(1, math.ceil(max(view.size) / _SHOWN_SIZE))), view.size))
    if len(empty) == n_train or not looks.counts:
        raise ValueError(f"fit_images(): no pixel of the {n_train} views counts. Look at their masks.")
    if empty:
        warnings.warn(f"fit_images(): no pixel counts of {', '.join(empty[:5])}. Look at the mask.", stacklevel=3)
    for (factor, _, _), pool in zip(stages, pools, strict=True):
        if not pool.counts:
            raise ValueError(f"fit_images(): no pixel of the {n_train} views counts at 1/{factor} of their size.")
    _check_lights(lights, list(numbers))
    return Survey(
        numbers,
        contents,
        np.array([split == "train" for split in splits]),
        lights,
        pools,
        list(looks.batches(0, looks.n_steps, keep=True)),
        brightness(looks.values()),
        [view for view, _ in shown],
        math.ceil(math.sqrt(n_pixels / _JUDGED)),
    )


def _content(view: View) -> str:
    values = [getattr(view, field.name) for field in dataclasses.fields(view)]
    parts = [np.ascontiguousarray(v) if isinstance(v, np.ndarray) else repr(v).encode() for v in values]
    return digest(*parts)


def _check(view: View, numbers: dict[str, int]) -> None:
    if view.name in numbers:
        raise ValueError("fit_images(): two views have the same name. Rename one.")
    if not np.isfinite(view.image).all():  # under the mask anything has become 0
        raise ValueError(f'fit_images(): view "{view.name}" holds NaN or infinity where it counts. Mask it there.')


def _check_lights(lights: Sequence[Light | None], names: Sequence[str]) -> None:
    dark = [name for name, light in zip(names, lights, strict=True) if light is None]
    if dark and len(dark) < len(names):
        raise ValueError(
            f'fit_images(): {len(dark)} of {len(names)} views have no light entry ("{dark[0]}"), the others have one. '
            "Give each its light; where the scene's own light is all there is, none needs one."
        )
