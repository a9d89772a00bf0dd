"""A camera whose film is a list of pixels of many photographs, and the light of each photograph, as Mitsuba plugins.

Both read tables, which :mod:`mi_enhance.images.plugin_tables` fills. What changes from one iteration, photograph or
light to the next is data, so that one compiled function serves all. A ray carries the number of its photograph as its
time, which Mitsuba hands on along a path and uses for nothing else here.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi


class PixelCamera(mi.Sensor):
    """A sensor whose film is a list of pixels: for each, row by row, its ray and the number of its photograph."""

    def __init__(self, props):
        super().__init__(props)
        self.table: list[mi.Float] = []

    def sample_ray(self, time, sample1, sample2, sample3, active=True):
        ray, weight = self.sample_ray_differential(time, sample1, sample2, sample3, active)
        return mi.Ray3f(ray), weight

    def sample_ray_differential(self, time, sample1, sample2, sample3, active=True):
        size = self.film().crop_size()
        x, y = sample2.x * size[0], sample2.y * size[1]
        # the last position of a row may round to its end
        column, row = (dr.minimum(dr.floor(v), n - 1) for v, n in zip((x, y), size, strict=True))
        index = mi.UInt32(column) + size[0] * mi.UInt32(row)
        o, corner, right, down, number = _rows(self.table, index, active, sizes=(3, 3, 3, 3, 1))
        direction = dr.normalize(corner + (x - column) * right + (y - row) * down)
        ray: Any = mi.RayDifferential3f(mi.Point3f(o), direction, number, mi.Color0f())  # type: ignore[call-overload]
        ray.has_differentials = False
        return ray, mi.Color3f(1)

    def to_string(self):
        return "PixelCamera[]"


class PhotographLights(mi.Emitter):
    """An emitter that is another distant light, point or spot for every photograph."""

    def __init__(self, props):
        super().__init__(props)
        self.table: list[mi.Float] = []
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


def _rows(table: list, index: mi.UInt32, active: Any, sizes: tuple[int, ...]) -> list:
    """Return a column of a table in parts: vectors of 3 rows, numbers of 1."""
    own = iter([dr.gather(mi.Float, row, index, active) for row in table])
    return [mi.Vector3f(*(next(own) for _ in range(3))) if n == 3 else next(own) for n in sizes]
