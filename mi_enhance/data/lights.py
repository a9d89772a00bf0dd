"""The light of one photograph: the entry ``light`` of a frame, as a record and back.

``transforms.json`` (:mod:`mi_enhance.images.view_files`) and ``photometric.json`` (:mod:`mi_enhance.data.photometric`)
share it; docs/photographs.md has the table.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from ..system.messages import did_you_mean, shortened

Vector = tuple[float, float, float]

# Entries of each kind: needed, and possible.
_ENTRIES: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "directional": (("direction", "intensity"), ()),
    "point": (("position", "intensity"), ()),
    "spot": (("position", "direction", "intensity", "cutoff_angle"), ("beam_width",)),
    "flash": (("intensity",), ("position",)),
    "envmap": (("file_path",), ("intensity",)),
}
KINDS = tuple(_ENTRIES)
_MOST = 1e15  # of any number: its square must stay within float32


class Arriving(NamedTuple):
    """Light that arrives at points.

    Parameters
    ----------
    direction : array (..., 3)
        Unit vectors towards the light.
    irradiance : array (..., 3)
        On a surface that faces the light, per channel.
    """

    direction: np.ndarray
    irradiance: np.ndarray


@dataclasses.dataclass(frozen=True)
class Light:
    """The one light of a photograph, in world coordinates.

    Parameters
    ----------
    kind : {"directional", "point", "spot", "flash", "envmap"}
    intensity : (float, float, float)
        Linear RGB. Directional: irradiance on a surface that faces the light. Point, spot, flash: radiant intensity, so
        that the irradiance at distance d is intensity / d**2. Environment map: factor on its radiance.
    position : (float, float, float), optional
        Of a point or spot light. Of a flash: in the camera's axes (x right, y up, z backwards), the camera itself if it
        is all 0.
    direction : (float, float, float), optional
        Unit vector. Directional: **towards** the light. Spot: along its axis, away from it.
    cutoff_angle, beam_width : float
        Of a spot: degrees from its axis at which it ends, and up to which it has its full intensity. Between them it
        falls linearly with the angle, as Mitsuba's does.
    file_path : str
        Of an environment map, latitude and longitude, as Mitsuba's ``envmap`` reads it.

    Examples
    --------
    >>> lamp = Light("point", (8.0, 8.0, 8.0), position=(0.0, 0.0, 2.0))
    >>> lamp.at(np.zeros(3)).irradiance
    array([2., 2., 2.])
    """

    kind: str
    intensity: Vector = (1.0, 1.0, 1.0)
    position: Vector = (0.0, 0.0, 0.0)
    direction: Vector = (0.0, 0.0, 1.0)
    cutoff_angle: float = 20.0
    beam_width: float = 15.0
    file_path: str = ""

    def in_world(self, to_world: np.ndarray) -> Light:
        """The same light, a flash as the point light that it is for a camera (camera to world, 4 x 4)."""
        if self.kind != "flash":
            return self
        x, y, z = np.asarray(to_world, np.float64)[:3, :3] @ self.position + np.asarray(to_world)[:3, 3]
        return dataclasses.replace(self, kind="point", position=(float(x), float(y), float(z)))

    def at(self, points: np.ndarray) -> Arriving:
        """Return what arrives at points (..., 3) of the world, if nothing is between; not of a flash or an envmap."""
        points, intensity = np.asarray(points, np.float64), np.asarray(self.intensity, np.float64)
        if self.kind == "directional":
            toward = np.broadcast_to(np.asarray(self.direction, np.float64), points.shape)
            return Arriving(toward, np.broadcast_to(intensity, points.shape))
        if self.kind not in ("point", "spot"):
            raise ValueError(
                f"a light of kind {self.kind} has no one direction at a point. Call in_world() of a flash."
            )
        toward = np.asarray(self.position) - points
        distance = np.sqrt((toward**2).sum(-1, keepdims=True))
        toward = toward / np.maximum(distance, 1e-30)  # 1e-30: a point at the light itself
        irradiance = intensity / np.maximum(distance, 1e-15) ** 2
        if self.kind == "spot":
            cos = -(toward @ np.asarray(self.direction))
            irradiance = irradiance * self.falloff(cos)[..., None]
        return Arriving(toward, irradiance)

    def falloff(self, cos: np.ndarray) -> np.ndarray:
        """Return the share of its intensity that a spot sends at an angle to its axis, given as a cosine."""
        angle = np.degrees(np.arccos(np.clip(cos, -1, 1)))
        width = max(self.cutoff_angle - self.beam_width, 1e-6)  # 1e-6: a sharp edge
        return np.clip((self.cutoff_angle - angle) / width, 0, 1)

    def entry(self) -> dict[str, Any]:
        """Return the object that :func:`read_light` reads as this light."""
        needed, possible = _ENTRIES[self.kind]
        values = {name: getattr(self, name) for name in (*needed, *possible)}
        return {"type": self.kind, **{k: list(v) if isinstance(v, tuple) else v for k, v in values.items()}}


def read_light(entry: object, where: str) -> Light:
    """Return the light that an entry of a frame describes.

    Parameters
    ----------
    entry : object
        As JSON has it: ``{"type": "directional", "direction": [0, 0, 1], "intensity": [1, 1, 1]}``.
    where : str
        What an error begins with.

    Raises
    ------
    ValueError
        For an unknown type or entry, a missing one, or a value out of its range.

    Examples
    --------
    >>> read_light({"type": "flash", "intensity": 3}, "frame 0").intensity
    (3.0, 3.0, 3.0)
    """
    if not isinstance(entry, Mapping):
        raise ValueError(f'{where}: light must be an object such as {{"type": "flash", ...}}; got {shortened(entry)}.')
    kind = entry.get("type")
    if not isinstance(kind, str) or kind not in _ENTRIES:
        raise ValueError(
            f"{where}: light has type {shortened(kind)}. Choose one of: {', '.join(KINDS)}.{did_you_mean(kind, KINDS)}"
        )
    needed, possible = _ENTRIES[kind]
    where = f"{where}: light of type {kind}"
    for name in entry:
        if name != "type" and name not in needed + possible:
            known = ", ".join((*needed, *possible))
            raise ValueError(
                f'{where}: unknown entry "{name}". It has: {known}.{did_you_mean(name, needed + possible)}'
            )
    missing = [name for name in needed if entry.get(name) is None]
    if missing:
        raise ValueError(f"{where}: {missing[0]} is missing. It needs {', '.join(needed)}.")
    given: dict[str, Any] = {name: _READ[name](value, name, where) for name, value in entry.items() if name in _READ}
    if kind == "spot":
        given.setdefault("beam_width", 0.75 * given["cutoff_angle"])  # Mitsuba's default
        if given["beam_width"] > given["cutoff_angle"]:
            raise ValueError(
                f"{where}: beam_width is {given['beam_width']:g}, cutoff_angle {given['cutoff_angle']:g}; the full "
                "beam ends before the light does. Exchange them?"
            )
    return Light(kind, **given)


def _vector(value: object, name: str, where: str) -> Vector:
    try:
        v = np.array(value, np.float64)
    except (TypeError, ValueError, OverflowError):
        v = np.zeros(0)
    if v.shape != (3,) or not (np.abs(v) < _MOST).all():
        raise ValueError(f"{where}: {name} must be three numbers; got {shortened(value)}.")
    return float(v[0]), float(v[1]), float(v[2])


def _direction(value: object, name: str, where: str) -> Vector:
    v = np.array(_vector(value, name, where))
    length = float(np.sqrt((v**2).sum()))
    if not length > 0:
        raise ValueError(f"{where}: {name} is {v.tolist()}, which points nowhere. Give a vector that is not 0.")
    x, y, z = v / length
    return float(x), float(y), float(z)


def _intensity(value: object, name: str, where: str) -> Vector:
    v = _vector([value] * 3 if isinstance(value, (int, float)) and not isinstance(value, bool) else value, name, where)
    if min(v) < 0 or not max(v) > 0:
        raise ValueError(f"{where}: {name} is {shortened(value)}; it must not be negative, and not 0 in all channels.")
    return v


def _angle(value: object, name: str, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0 < value <= 90 or math.isnan(value):
        raise ValueError(f"{where}: {name} is {shortened(value)}; it is in degrees from the axis, above 0, at most 90.")
    return float(value)


def _text(value: object, name: str, where: str) -> str:
    if not isinstance(value, str) or not value or "\0" in value:
        raise ValueError(f"{where}: {name} must be the name of a file; got {shortened(value)}.")
    return value


_READ: dict[str, Any] = {
    "position": _vector,
    "direction": _direction,
    "intensity": _intensity,
    "cutoff_angle": _angle,
    "beam_width": _angle,
    "file_path": _text,
}
