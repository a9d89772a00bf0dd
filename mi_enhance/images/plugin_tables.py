"""The tables of the plugins of photographs: a camera whose film is a list of pixels, and the light of each photograph.

See :mod:`mi_enhance.bsdfs.photographs`.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

CAMERA_ROWS = 13  # origin, corner, step to the right, step downwards, number of the photograph
LIGHT_ROWS = 13  # place or direction, 1 or 0, intensity, axis, angle of the cutoff, 1 / width of its edge, far away


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
    film = {"type": "hdrfilm", "width": width, "height": height, "pixel_format": "rgb", "rfilter": {"type": "box"}}
    camera = mi.load_dict({"type": "mi_enhance_pixels", "film": film, "sampler": {"type": "independent"}})
    fill(camera, table)
    return camera


def photograph_lights(table: np.ndarray) -> Any:
    """Return an emitter that is another light for every photograph, from a table (LIGHT_ROWS, photographs)."""
    lights = mi.load_dict({"type": "mi_enhance_lights"})
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
