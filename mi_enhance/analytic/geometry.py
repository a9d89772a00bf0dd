"""Directions, frames and angles. THE convention block of the whole package:

- All directions are unit vectors that point away from the surface, in the local frame
  n = (0, 0, 1), t = (1, 0, 0), b = n x t = (0, 1, 0).
- `wi` points towards the viewer (Mitsuba's ``si.wi``), `wo` towards the light (the sampled direction).
  The paper's omega_i is the light: readers of measured data translate in one place.
- ``brdf(wi, wo)`` is f_r in 1/sr WITHOUT the cosine; only the plugin's ``eval`` multiplies by cos_theta_o.
- Below the horizon (cos_theta_i <= 0 or cos_theta_o <= 0) every BRDF is exactly 0.
- Angles are radians, colours are linear RGB, roughness is alpha (not perceptual roughness).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import drjit as dr
import mitsuba as mi

# Smallest cosine that enters a division. Keeps 1/E finite at grazing angles; 1e-4 is 89.994 degrees.
MIN_COS = 1e-4


def frame(n_x, n_y, t_theta) -> mi.Frame3f:
    """Return the shading frame of a material: a tilted normal and a rotated tangent (3 of the paper's 12 parameters).

    Parameters
    ----------
    n_x, n_y : mi.Float
        Tangent-plane components of the unit normal n, ``n_x**2 + n_y**2 < 1``.
    t_theta : mi.Float
        Rotation of the tangent about n, radians; 0 is the direction closest to (1, 0, 0).

    Returns
    -------
    mi.Frame3f
        ``to_local`` / ``to_world`` convert between the surface's frame and the material's.

    Examples
    --------
    >>> frame(mi.Float(0), mi.Float(0), mi.Float(0)).n
    [[0, 0, 1]]
    """
    n = mi.Vector3f(n_x, n_y, dr.safe_sqrt(1 - n_x * n_x - n_y * n_y))
    t = dr.normalize(mi.Vector3f(1, 0, 0) - n * n.x)
    b = dr.cross(n, t)
    s, c = dr.sincos(t_theta)
    return mi.Frame3f(c * t + s * b, c * b - s * t, n)


def frame_of(params: Mapping) -> mi.Frame3f:
    """Return the shading frame of a material: that of the surface if the model has none of its own.

    Examples
    --------
    >>> frame_of({}).n
    [[0, 0, 1]]
    """
    if "n_x" not in params:
        return mi.Frame3f(mi.Vector3f(1, 0, 0), mi.Vector3f(0, 1, 0), mi.Vector3f(0, 0, 1))
    return frame(params["n_x"], params["n_y"], params["t_theta"])


# The keys of quantities(), for which terms can ask by name, and the kind of each.
QUANTITIES = {
    **dict.fromkeys(("wi", "wo", "h"), "direction"),
    **dict.fromkeys(("cos_theta_i", "cos_theta_o", "cos_theta_h", "cos_theta_d"), "number"),
}


def local_directions(wi: mi.Vector3f, wo: mi.Vector3f, params: Mapping) -> tuple[Any, Any, Any]:
    """Turn both directions into the material's frame, and find the lanes where they are above both horizons.

    Evaluation and sampling of a material both ask here, so a kernel that does both works it out once.

    Parameters
    ----------
    wi, wo : mi.Vector3f, N lanes
        Directions towards viewer and light, surface frame.
    params : dict
        Parameter values; reads ``n_x``, ``n_y``, ``t_theta``, and takes the surface's frame where they are left out.

    Returns
    -------
    local_i, local_o : mi.Vector3f, N lanes
        Inactive lanes are at normal incidence: no inf or NaN arises whose gradient would survive the mask.
    active : mi.Mask, N lanes
        True above the horizons of the material's frame and of the surface.

    Examples
    --------
    >>> local_directions(mi.Vector3f(0, 0, 1), mi.Vector3f(0, 0, -1), {})[2]
    [False]
    """
    active = (wi.z > 0) & (wo.z > 0)
    if "n_x" in params:
        to_local = frame_of(params).to_local
        wi, wo = to_local(wi), to_local(wo)
        active &= (wi.z > 0) & (wo.z > 0)
    up = mi.Vector3f(0, 0, 1)
    return dr.select(active, wi, up), dr.select(active, wo, up), active


def quantities(wi: mi.Vector3f, wo: mi.Vector3f) -> dict[str, Any]:
    """Compute all directional quantities that terms and modules can ask for by name.

    Parameters
    ----------
    wi, wo : mi.Vector3f, N lanes
        Directions towards viewer and light, local frame.

    Returns
    -------
    dict
        ``wi``, ``wo``, ``h`` (half vector) and the cosines ``cos_theta_i``, ``cos_theta_o``, ``cos_theta_h``
        (of h and n) and ``cos_theta_d`` (of h and either direction).

    Examples
    --------
    >>> quantities(mi.Vector3f(0, 0, 1), mi.Vector3f(0, 0, 1))["cos_theta_h"]
    [1]
    """
    h, cos_theta_d = _half_vector(wi, wo)
    return {
        "wi": wi,
        "wo": wo,
        "h": h,
        "cos_theta_i": wi.z,
        "cos_theta_o": wo.z,
        "cos_theta_h": h.z,
        "cos_theta_d": cos_theta_d,
    }


def local_quantities(wi: mi.Vector3f, wo: mi.Vector3f, params: Mapping) -> tuple[dict[str, Any], Any]:
    """Compute :func:`quantities` in the material's frame, and the lanes of :func:`local_directions` above the horizons.

    A narrow lobe is made of the first two components of the half vector. Near a mirror they are small differences of
    large numbers: if both directions were turned first, 6e-8 would be left of them, a thousandth of a roughness of
    1e-4. The sum of the directions is (all but) exact in the surface's frame, and so is h - n: t.h = t.(h - n).

    Parameters
    ----------
    wi, wo : mi.Vector3f, N lanes
        Directions towards viewer and light, surface frame.
    params : dict
        Parameter values; reads ``n_x``, ``n_y``, ``t_theta``, and takes the surface's frame where they are left out.

    Returns
    -------
    quantities : dict
    active : mi.Mask, N lanes

    Examples
    --------
    >>> q, active = local_quantities(mi.Vector3f(0, 0, 1), mi.Vector3f(0, 0, 1), {})
    >>> q["h"], active
    ([[0, 0, 1]], [True])
    """
    local_i, local_o, active = local_directions(wi, wo, params)
    q = quantities(local_i, local_o)
    if "n_x" in params:
        frame: Any = frame_of(params)
        h, cos_theta_d = _half_vector(wi, wo)
        h = mi.Vector3f(dr.dot(frame.s, h - frame.n), dr.dot(frame.t, h - frame.n), dr.dot(frame.n, h))
        h = dr.select(active, h, mi.Vector3f(0, 0, 1))
        q |= {"h": h, "cos_theta_h": h.z, "cos_theta_d": dr.select(active, cos_theta_d, 1)}
    return q, active


def back_vector(wi: mi.Vector3f, wo: mi.Vector3f) -> tuple[Any, Any]:
    """Return the half vector of the viewer's mirror image about the normal and the light, and the cosine to it.

    Parameters
    ----------
    wi, wo : mi.Vector3f, N lanes
        Directions towards viewer and light, local frame.

    Returns
    -------
    back : mi.Vector3f, N lanes
        The normal where viewer and light are the same. Exchanging them mirrors it.
    cosine : mi.Float, N lanes
        Of the angle between it and the light, at most 1.

    References
    ----------
    Belcour et al. 2014, *BRDF Measurements and Analysis of Retroreflective Materials*, the back vector.

    Examples
    --------
    >>> back_vector(mi.Vector3f(0.6, 0, 0.8), mi.Vector3f(0.6, 0, 0.8))
    ([[0, 0, 1]], [0.8])
    """
    return _half_vector(mi.Vector3f(-wi.x, -wi.y, wi.z), wo)


def _half_vector(wi: mi.Vector3f, wo: mi.Vector3f) -> tuple[Any, Any]:
    """Return the half vector, and the cosine of either direction to it.

    Examples
    --------
    >>> _half_vector(mi.Vector3f(0, 0, 1), mi.Vector3f(0, 0, 1))
    ([[0, 0, 1]], [1])
    """
    s = wi + wo
    squared = dr.squared_norm(s)
    # wi = -wo has no half vector: the floor makes it 0 instead of NaN (such pairs are below the horizon anyway). Two
    # cosines of 1e-7 add up to 4e-14; the derivative of the root, 1e30, is within float32.
    h = s * dr.rsqrt(dr.maximum(squared, 1e-20))
    # |wi + wo| = 2 cos_theta_d: exact where dot(wi, h) loses digits; at most 1 against rounding.
    return h, dr.minimum(0.5 * dr.sqrt(squared), 1)
