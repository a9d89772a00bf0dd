"""Mitsuba plugins: a camera whose film is a list of pixels of many photographs, and the light of each photograph.

Both read tables. What changes from one iteration, photograph or light to the next is data, so that one compiled
function serves all. A ray carries the number of its photograph as its time, which Mitsuba hands on along a path and
uses for nothing else here.
"""

from __future__ import annotations

import functools
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

CAMERA_ROWS = 13  # origin, corner, step to the right, step downwards, number of the photograph
LIGHT_ROWS = 13  # place or direction, 1 or 0, intensity, axis, angle of the cutoff, 1 / width of its edge, far away
_CAMERA, _LIGHTS = "mi_enhance_pixels", "mi_enhance_lights"


def pixel_camera(table: np.ndarray, width: int, height: int) -> Any:
    """Return a sensor with a film of so many pixels, each any pixel of any photograph.

    Parameters
    ----------
    table : array (CAMERA_ROWS, height * width)
        Rows as above: where the rays of a pixel begin, direction of its upper left corner of any length, what a pixel
        to the right and downwards adds to that.
    width, height : int
        Of the film.
    """
    _register(mi.variant())
    film = {"type": "hdrfilm", "width": width, "height": height, "pixel_format": "rgb", "rfilter": {"type": "box"}}
    camera = mi.load_dict({"type": _CAMERA, "film": film, "sampler": {"type": "independent"}})
    fill(camera, table)
    return camera


def photograph_lights(table: np.ndarray) -> Any:
    """Return an emitter that is another light for every photograph, from a table (LIGHT_ROWS, photographs)."""
    _register(mi.variant())
    lights = mi.load_dict({"type": _LIGHTS})
    fill(lights, table)
    return lights


def fill(plugin: Any, table: np.ndarray) -> None:
    """Give a plugin another table of the same size: data of compiled functions, no part of their code."""
    plugin.table = [evaluated(row) for row in table]


def evaluated(values: np.ndarray) -> mi.Float:
    """Return numbers in memory of their own: literals and NumPy's memory make ``dr.freeze`` record anew."""
    result = mi.Float(np.ravel(values).astype(np.float32)) * dr.opaque(mi.Float, 1)
    dr.eval(result)
    return result


@functools.cache
def _register(variant: str) -> None:
    """Define both classes for the active variant: a class is only valid in the one in which it was made."""

    class PixelCamera(mi.Sensor):
        def __init__(self, props):
            super().__init__(props)
            self.table = [dr.opaque(mi.Float, 0)] * CAMERA_ROWS

        def sample_ray(self, time, sample1, sample2, sample3, active=True):
            ray, weight = self.sample_ray_differential(time, sample1, sample2, sample3, active)
            return mi.Ray3f(ray), weight

        def sample_ray_differential(self, time, sample1, sample2, sample3, active=True):
            size = self.film().crop_size()
            x, y = sample2.x * size[0], sample2.y * size[1]
            # the last position of a row may round to its end
            column, row = (dr.minimum(dr.floor(v), n - 1) for v, n in zip((x, y), size, strict=True))
            index = mi.UInt32(column) + size[0] * mi.UInt32(row)
            o, corner, right, down, number = _rows(self.table, index, active)
            direction = dr.normalize(corner + (x - column) * right + (y - row) * down)
            ray: Any = mi.RayDifferential3f(mi.Point3f(o), direction, number, mi.Color0f())  # type: ignore[call-overload]
            ray.has_differentials = False
            return ray, mi.Color3f(1)

        def to_string(self):
            return "PixelCamera[]"

    class PhotographLights(mi.Emitter):
        def __init__(self, props):
            super().__init__(props)
            self.table = [dr.opaque(mi.Float, 0)] * LIGHT_ROWS
            self.m_flags = mi.EmitterFlags.DeltaPosition

        def sample_direction(self, it, sample, active=True):
            place, intensity, axis, near, cutoff, slope, far = self._light(it, active)
            toward = place - near * mi.Vector3f(it.p)
            squared = dr.squared_norm(toward)
            ds: Any = mi.DirectionSample3f()
            ds.d = toward * dr.rsqrt(squared)
            ds.dist = dr.select(near > 0, dr.sqrt(squared), far)
            ds.p = dr.fma(ds.d, ds.dist, it.p)
            ds.n, ds.uv, ds.time, ds.pdf, ds.delta = -ds.d, mi.Point2f(0), it.time, mi.Float(1), mi.Bool(True)
            ds.emitter = mi.EmitterPtr(self)
            return ds, self._arriving(ds.d, squared, intensity, axis, near, cutoff, slope) & active

        def eval_direction(self, it, ds, active=True):
            place, intensity, axis, near, cutoff, slope, _ = self._light(it, active)
            squared = dr.squared_norm(place - near * mi.Vector3f(it.p))
            return self._arriving(ds.d, squared, intensity, axis, near, cutoff, slope) & active

        def _light(self, it, active):
            place, near, intensity, axis, cutoff, slope, far = _rows(
                self.table, mi.UInt32(it.time + 0.5), active, sizes=(3, 1, 3, 3, 1, 1, 1)
            )
            return place, intensity, axis, near, cutoff, slope, far

        def _arriving(self, d, squared, intensity, axis, near, cutoff, slope):
            angle = dr.acos(dr.clip(-dr.dot(d, axis), -1, 1))
            share = dr.clip((cutoff - angle) * slope, 0, 1)
            return mi.Color3f(intensity * share * dr.select(near > 0, dr.rcp(squared), 1))

        def pdf_direction(self, it, ds, active=True):
            return mi.Float(0)  # no other way leads to it

        def eval(self, si, active=True):
            return mi.Color3f(0)

        def bbox(self):
            return mi.ScalarBoundingBox3f()

        def to_string(self):
            return "PhotographLights[]"

    mi.register_sensor(_CAMERA, lambda props: PixelCamera(props))
    mi.register_emitter(_LIGHTS, lambda props: PhotographLights(props))


def _rows(table: list, index: mi.UInt32, active: Any, sizes: tuple[int, ...] = (3, 3, 3, 3, 1)) -> list:
    """Return a column of a table in parts: vectors of 3 rows, numbers of 1."""
    own = iter([dr.gather(mi.Float, row, index, active) for row in table])
    return [mi.Vector3f(*(next(own) for _ in range(3))) if n == 3 else next(own) for n in sizes]
