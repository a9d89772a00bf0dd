"""Fresnel terms F."""

from __future__ import annotations

from collections.abc import Mapping

import drjit as dr
import numpy as np

from .. import parameters as p
from ..geometry import MIN_COS
from .registry import term


# 0.04: a dielectric, where the model has no F0 of its own
@term("F", parameters=(p.F0,), start=lambda values: {"F0": np.full_like(values["alpha_x"], 0.04)})
def F_schlick(cos_theta_d, F0):
    r"""Schlick's approximation of the Fresnel reflectance, :math:`F = F_0 + (1 - F_0)(1 - \cos\theta_d)^5`.

    Parameters
    ----------
    cos_theta_d : mi.Float, N lanes
        Cosine between the half vector and either direction, in [0, 1].
    F0 : mi.Float, 1 or N lanes
        Reflectance at normal incidence, in [0, 1].

    Returns
    -------
    mi.Float, N lanes
        Reflectance in [F0, 1].

    References
    ----------
    Schlick 1994, *An Inexpensive BRDF Model for Physically-based Rendering*, eq. (15).

    Examples
    --------
    >>> F_schlick(mi.Float(0), mi.Float(0.04))
    [1]
    """
    q = 1 - cos_theta_d
    return F0 + (1 - F0) * (dr.square(dr.square(q)) * q)


@term("F", parameters=(p.F0,))
def F_cook_torrance(cos_theta_d, F0):
    r"""Exact Fresnel reflectance of a dielectric with reflectance F0 at normal incidence, unpolarized light.

    .. math::
        F = \frac{1}{2} \frac{(g - c)^2}{(g + c)^2}
            \left( 1 + \frac{(c (g + c) - 1)^2}{(c (g - c) + 1)^2} \right), \quad
        g^2 = n^2 + c^2 - 1, \quad c = \cos\theta_d, \quad n = \frac{1 + \sqrt{F_0}}{1 - \sqrt{F_0}}

    Parameters
    ----------
    cos_theta_d : mi.Float, N lanes
        Cosine between the half vector and either direction, in [0, 1]. Below 1e-4 it counts as 1e-4: no 0 / 0 at F0 = 0
        and F0 = 1.
    F0 : mi.Float, 1 or N lanes
        Reflectance at normal incidence, in [0, 1]. Its root is taken of at least 1e-8: finite slope at F0 = 0.

    Returns
    -------
    mi.Float, N lanes
        Reflectance in [0, 1]; 0 for F0 = 0, 1 for F0 = 1.

    References
    ----------
    Cook and Torrance 1982, *A Reflectance Model for Computer Graphics*: the Fresnel equation, and the index from the
    reflectance at normal incidence. Written as in :func:`F_dielectric`.

    Examples
    --------
    >>> F_cook_torrance(mi.Float(1), mi.Float(0.04))
    [0.04]
    """
    return F0 * _fresnel_over_F0(cos_theta_d, dr.sqrt(dr.maximum(F0, 1e-8)))


def _ior_of_f0(values: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    root = np.sqrt(np.clip(values["F0"], 0, 0.96))  # 0.96: an index of 100, where the range of `ior` ends
    return {"ior": (1 + root) / (1 - root)}


@term("F", parameters=(p.IOR,), start=_ior_of_f0)
def F_dielectric(cos_theta_d, ior):
    r"""Exact Fresnel reflectance of a dielectric by its index of refraction, unpolarized light.

    .. math::
        F = \frac{1}{2} \frac{(g - c)^2}{(g + c)^2}
            \left( 1 + \frac{(c (g + c) - 1)^2}{(c (g - c) + 1)^2} \right), \quad
        g^2 = n^2 + c^2 - 1, \quad c = \cos\theta_d

    Parameters
    ----------
    cos_theta_d : mi.Float, N lanes
        Cosine between the half vector and either direction, in [0, 1]. Below 1e-4 it counts as 1e-4: no 0 / 0 at n = 1.
    ior : mi.Float, 1 or N lanes
        Index of refraction n, at least 1.

    Returns
    -------
    mi.Float, N lanes
        Reflectance in [0, 1]; 0 for n = 1.

    References
    ----------
    Walter et al. 2007, *Microfacet Models for Refraction through Rough Surfaces*, eq. (22). Written with
    s = (n - 1) / (n + 1), the root of F0, so that nothing cancels near n = 1 and nothing overflows for large n.

    Examples
    --------
    >>> F_dielectric(mi.Float(1), mi.Float(1.5))
    [0.04]
    """
    s = (ior - 1) / (ior + 1)
    return dr.square(s) * _fresnel_over_F0(cos_theta_d, s)


def _fresnel_over_F0(cos_theta_d, s):
    """Fresnel reflectance over s^2 = F0: both amplitudes are s times a fraction in which nothing cancels.

    Examples
    --------
    >>> _fresnel_over_F0(mi.Float(1), mi.Float(0.2))
    [1]
    """
    c = dr.maximum(cos_theta_d, MIN_COS)
    near, far = (1 - s) * c, dr.square(1 + s) * c  # n = (1 + s) / (1 - s); everything is multiplied by 1 - s
    g = dr.sqrt(4 * s + dr.square(near))
    perpendicular = 4 / dr.square(near + g)
    parallel = 4 * (2 * dr.square(c) * (1 + dr.square(s)) - dr.square(1 - s)) / dr.square(far + (1 - s) * g)
    return 0.5 * (dr.square(perpendicular) + dr.square(parallel))
