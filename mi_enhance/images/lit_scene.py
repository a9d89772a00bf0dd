"""A scene with the light of every photograph in it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import mitsuba as mi
import numpy as np

from ..data.lights import Light
from .mitsuba_plugins import LIGHT_ROWS, photograph_lights

_FAR = 4  # radii of the scene: beyond everything in it


def with_lights(scene: mi.Scene, lights: Sequence[Light | None]) -> mi.Scene:
    """Return a scene of the same objects, with lights that depend on the photograph, beside its own.

    Parameters
    ----------
    scene : mi.Scene
        Its shapes, materials and own lights are shared: what changes in one changes in the other.
    lights : sequence of Light or None
        By number of the photograph; flashes as point lights (:meth:`Light.in_world`). None: the scene's own light only.

    Returns
    -------
    mi.Scene
        `scene` itself if no photograph has a light of its own.
    """
    if not any(lights):
        return scene
    box = scene.bbox()
    radius = float(np.linalg.norm(np.array(box.extents()))) / 2 if box.valid() else 1.0
    objects = [*scene.shapes(), *(e for e in scene.emitters() if e.get_shape() is None)]
    ids = [one.id() for one in objects]
    plugin = photograph_lights(np.stack([_row(light, _FAR * max(radius, 1e-6)) for light in lights], 1))
    # optimize: merged shapes would have other keys than those of the scene that the user knows
    children = {f"object_{k}": one for k, one in enumerate(objects)}
    result = mi.load_dict({"type": "scene", **children, "photographs": plugin}, optimize=False)
    for one, name in zip(objects, ids, strict=True):
        one.set_id(name)  # they have taken the names above
    return result


def _row(light: Light | None, far: float) -> np.ndarray:
    """Return a column of the emitter's table."""
    row = np.zeros(LIGHT_ROWS)
    row[:4], row[10:] = (0, 0, 1, 0), (1e3, 1, far)  # 1e3: no angle is that large, so there is no edge
    if light is None:
        return row
    is_near = light.kind in ("point", "spot")
    row[:3] = light.position if is_near else light.direction
    row[3], row[4:7] = is_near, light.intensity
    if light.kind == "spot":
        row[7:10], row[10] = light.direction, math.radians(light.cutoff_angle)
        row[11] = 1 / max(math.radians(light.cutoff_angle - light.beam_width), 1e-6)  # 1e-6: a sharp edge
    return row
