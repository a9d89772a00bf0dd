"""A scene with the light of every photograph in it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import mitsuba as mi
import numpy as np

from ..data.lights import Light
from .plugin_tables import LIGHT_ROWS, photograph_lights

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
    if any(light and light.kind == "envmap" for light in lights):
        plugin = _environment(lights)
    else:
        box = scene.bbox()
        radius = float(np.linalg.norm(np.array(box.extents()))) / 2 if box.valid() else 1.0
        plugin = photograph_lights(np.stack([_row(light, _FAR * max(radius, 1e-6)) for light in lights], 1))
    objects = [*scene.shapes(), *(e for e in scene.emitters() if e.get_shape() is None)]
    ids = [one.id() for one in objects]
    # optimize: merged shapes would have other keys than those of the scene that the user knows
    children = {f"object_{k}": one for k, one in enumerate(objects)}
    result = mi.load_dict({"type": "scene", **children, "photographs": plugin}, optimize=False)
    for one, name in zip(objects, ids, strict=True):
        one.set_id(name)  # they have taken the names above
    return result


def _environment(lights: Sequence[Light | None]) -> mi.Emitter:
    """Return the environment map of all photographs."""
    first = lights[0]
    if first is None or any(light != first for light in lights):
        raise ValueError(
            "fit_images(): an envmap that is the light of some photographs and not of others is not modelled: all must "
            "have the same, with the same intensity. Bring the photographs to one brightness, or fit those of one map."
        )
    bitmap = mi.Bitmap(first.file_path).convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32, srgb_gamma=False)
    colours = np.array(bitmap) * np.array(first.intensity, np.float32)
    return mi.load_dict({"type": "envmap", "bitmap": mi.Bitmap(colours)})


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
