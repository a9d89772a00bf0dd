"""Retro-reflection by the back vector: a lobe around the direction that light came from.

The back vector is the half vector of one direction and the mirror image of the other about the normal. Terms that read
it in place of the half vector make a lobe of the same shape around the retro direction; G and 1/E, which know the
angles to the normal alone, stay as they are.
"""

from __future__ import annotations

from collections.abc import Mapping

import drjit as dr
import numpy as np

from .. import parameters as p
from ..geometry import back_vector
from .distribution import D_ggx
from .fresnel import F_schlick
from .registry import term


@term("D", around_back=True)
def D_retro_ggx(wi, wo, alpha_x, alpha_y):
    """GGX around the back vector: tapes, paints with beads, cloth.

    Parameters
    ----------
    wi, wo : mi.Vector3f, N lanes
        Directions towards viewer and light, local frame, above the horizon.
    alpha_x, alpha_y : mi.Float, 1 or N lanes
        Roughness along t and b, in (0, 1].

    Returns
    -------
    mi.Float, N lanes
        In 1/sr: :func:`D_ggx` of the back vector; largest where viewer and light are the same.

    References
    ----------
    Belcour, Pacanowski, Delahaie, Laville-Geay and Eupherte 2014, *BRDF Measurements and Analysis of Retroreflective
    Materials*; Raab 2025, *Properties of the Back-Vector Modification for Microfacet BRDF Models*.

    Examples
    --------
    >>> light = mi.Vector3f(0.6, 0, 0.8)
    >>> D_retro_ggx(light, light, mi.Float(0.5), mi.Float(0.5))
    [1.27324]
    """
    return D_ggx(back_vector(wi, wo)[0], alpha_x, alpha_y)


def _of_a_dielectric(values: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    return {"F0": np.full_like(values["alpha_x"], 0.04)}


@term("F", parameters=(p.F0,), start=_of_a_dielectric)
def F_retro_schlick(wi, wo, F0):
    """Schlick's approximation by the angle to the back vector, see :func:`D_retro_ggx`.

    Parameters
    ----------
    wi, wo : mi.Vector3f, N lanes
        Directions towards viewer and light, local frame, above the horizon.
    F0 : mi.Float, 1 or N lanes
        Reflectance at normal incidence, in [0, 1].

    Returns
    -------
    mi.Float, N lanes
        Reflectance in [F0, 1].

    References
    ----------
    Belcour et al. 2014, as above; Schlick 1994, eq. (15).

    Examples
    --------
    >>> up = mi.Vector3f(0, 0, 1)
    >>> F_retro_schlick(up, up, mi.Float(0.04))
    [0.04]
    """
    # 1 - cos cannot be negative: back_vector keeps the cosine at most 1
    return F_schlick(dr.maximum(back_vector(wi, wo)[1], 0), F0)
