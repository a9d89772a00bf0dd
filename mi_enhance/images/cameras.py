"""Cameras around an object, and renders for them."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import mitsuba as mi
import numpy as np

from .lit_scene import with_lights
from .targets import targets
from .views import View


def around(
    n: int,
    *,
    target,
    distance: float,
    elevations=(15.0, 40.0, 65.0),
    fov: float = 30.0,
    resolution: int = 64,
    start=0.0,
) -> list[View]:
    """Cameras around an object that look at it, +y up, as black views to be rendered.

    Parameters
    ----------
    n : int
        Their number; azimuths are spread evenly.
    target : (float, float, float)
        What they look at.
    distance : float
    elevations : sequence of float
        Degrees above the horizon, taken in turn.
    fov : float
        Degrees.
    resolution : int
        Pixels on a side.
    start : float
        Azimuth of the first, degrees from +z towards +x.

    Examples
    --------
    >>> [v.name for v in around(2, target=(0, 1, 0), distance=5)]
    ['view_00', 'view_01']
    """
    result = []
    for k in range(n):
        azimuth, elevation = math.radians(start + 360 * k / n), math.radians(elevations[k % len(elevations)])
        back = np.array(
            [math.sin(azimuth) * math.cos(elevation), math.sin(elevation), math.cos(azimuth) * math.cos(elevation)]
        )
        right = np.cross([0, 1, 0], back)
        right /= np.linalg.norm(right)
        to_world = np.eye(4)
        to_world[:3, :4] = np.stack((right, np.cross(back, right), back, np.asarray(target) + distance * back), 1)
        black = np.zeros((resolution, resolution, 3), np.float32)
        result.append(View(f"view_{k:02d}", black, to_world, fov))
    return result


def render_views(scene: mi.Scene, views: Sequence[View], *, spp: int = 64, seed: int = 0, max_depth: int = 6) -> list:
    """The same views with images rendered from a scene.

    Parameters
    ----------
    scene : mi.Scene
    views : sequence of View
        Whose cameras are used, and their lights, beside those of the scene.
    spp, seed, max_depth : int
        Samples per pixel, seed of the first view, longest path.

    Returns
    -------
    list of View
        Unsaturated, everything else as it was.
    """
    path = mi.load_dict({"type": "path", "max_depth": max_depth})
    lights = [view.light.in_world(view.to_world) if view.light else None for view in views]
    scene = with_lights(scene, lights)
    result = []
    for k, view in enumerate(views):
        # only the camera that knows the number of its photograph finds its light
        whole = dataclasses.replace(view, mask=np.ones_like(view.mask))
        sensor = targets([whole], 1, {view.name: k})[0].sensor if lights[k] else mi.load_dict(view.sensor())
        image = np.array(
            mi.render(scene, sensor=sensor, integrator=path, spp=spp, seed=mi.UInt32(seed + k)), np.float32
        )
        result.append(dataclasses.replace(view, image=image, ceiling=math.inf))
    return result
