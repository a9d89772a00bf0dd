"""Photographs as the target of a fit: many views in one wide picture, and how far a render is from it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import mitsuba as mi
import numpy as np

from .views import View

# Most pixels that are rendered at once: prb keeps about 1 kB per path with 69 unknowns, 8 samples make that 2 GB.
_PIXELS = 1 << 18


class Target(NamedTuple):
    """Views of one size side by side, as Mitsuba's ``batch`` sensor renders them."""

    views: list[View]
    sensor: mi.Sensor
    image: mi.TensorXf  # (H, views * W, 3)
    weight: mi.TensorXf  # 1 where a pixel counts, over how many do
    saturated: mi.TensorXf  # of bool: where the photograph is known from below only


def targets(views: Sequence[View], factor: int = 1) -> list[Target]:
    """Views, each `factor` times smaller, in groups of one size that are rendered together.

    Raises
    ------
    ValueError
        If no pixel is left that counts.
    """
    groups: dict[tuple, list[View]] = {}
    for view in (v.smaller(factor) for v in views):
        most = max(1, _PIXELS // (view.size[0] * view.size[1]))
        number = sum(len(g) for key, g in groups.items() if key[0] == view.size) // most
        groups.setdefault((view.size, number), []).append(view)
    result = [_target(group) for group in groups.values() if any(v.mask.any() for v in group)]
    if not result:
        raise ValueError(f"fit_images(): no pixel of the {len(views)} views counts at 1/{factor} of their size.")
    return result


def _target(views: list[View]) -> Target:
    width, height = views[0].size
    sensor = {f"view_{k}": view.sensor() for k, view in enumerate(views)}
    film = {**views[0].sensor()["film"], "width": width * len(views)}
    sensor = mi.load_dict({"type": "batch", **sensor, "film": film, "sampler": {"type": "independent"}})
    mask = np.concatenate([v.mask for v in views], 1)[..., None].repeat(3, 2)
    return Target(
        views,
        sensor,
        mi.TensorXf(np.maximum(np.concatenate([v.image for v in views], 1), 0)),
        mi.TensorXf((mask / mask.sum()).astype(np.float32)),
        mi.TensorXb(  # type: ignore[operator]  # a class, which Mitsuba's stubs do not know
            np.concatenate([v.saturated for v in views], 1)
        ),
    )


def split(image: np.ndarray, target: Target) -> list[np.ndarray]:
    """A wide picture cut into that of each view."""
    return np.split(image, len(target.views), axis=1)
