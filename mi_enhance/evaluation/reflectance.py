"""The reflectance of any Mitsuba BSDF as arrays."""

from __future__ import annotations

import mitsuba as mi
import numpy as np

from ..numerics.arrays import vector3f


def reflectance(bsdf: mi.BSDF, wi: np.ndarray, wo: np.ndarray) -> np.ndarray:
    """Return f_r in 1/sr of any BSDF, linear RGB, (N, 3), for unit vectors (N, 3) above the horizon.

    Examples
    --------
    >>> half = mi.load_dict({"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.5}})
    >>> reflectance(half, np.array([[0, 0, 1.0]]), np.array([[0, 0.6, 0.8]])).round(4)
    array([[0.1592, 0.1592, 0.1592]])
    """
    si = mi.SurfaceInteraction3f()
    si.wi = vector3f(wi)
    return np.array(bsdf.eval(mi.BSDFContext(), si, vector3f(wo))).T / wo[:, 2:]
