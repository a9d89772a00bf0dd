"""The distribution of the ABC model, with a tail of its own."""

from __future__ import annotations

from collections.abc import Mapping

import drjit as dr
import numpy as np

from .. import parameters as p
from .registry import term


def D_abc(h, B, C):
    r"""The ABC distribution with a peak of 1, :math:`D = 1 / (1 + B (1 - \cos\theta_h))^C`.

    Parameters
    ----------
    h : mi.Vector3f, N lanes
        Half vector, unit length, local frame, above the horizon. 1 - cos(theta_h) is computed as
        (h_x^2 + h_y^2) / (1 + h_z): the difference itself has an error of 6e-8, half the width of a lobe with B = 1e7.
    B : mi.Float, 1 or N lanes
        Inverse width, at least 0; published fits reach from 11 to 8.1e6.
    C : mi.Float, 1 or N lanes
        Fall-off of the tail, above 0; published fits reach from 0.024 to 2.7.

    Returns
    -------
    mi.Float, N lanes
        In (0, 1]; not normalized.

    References
    ----------
    Low, Kronander, Ynnerman and Unger 2012, *BRDF Models for Accurate and Efficient Rendering of Glossy Surfaces*, the
    microfacet model.

    Examples
    --------
    >>> D_abc(mi.Vector3f(0.6, 0, 0.8), mi.Float(5), mi.Float(2))
    [0.25]
    """
    x = (dr.square(h.x) + dr.square(h.y)) / (1 + h.z)
    return dr.exp(-C * dr.log(1 + B * x))


def alpha_of_abc(B, C):
    """Return the roughness of the GGX lobe that covers the ABC distribution.

    It is the geometric mean of two: the alpha with the same half width at half maximum, and the alpha with half of the
    weight inside the same angle. The peak is narrow and the tail wide; where tails are wide the mean halves the noise
    of the former.
    """
    # x = 1 - cos(theta_h). Half the maximum: (1 + B x)^-C = 1/2; of GGX: sin^2 (1 - alpha^2) = alpha^2 (sqrt(2) - 1).
    x = dr.minimum((dr.exp2(dr.rcp(C)) - 1) / B, 1)
    sin2 = x * (2 - x)
    peak2 = sin2 / (sin2 + (2**0.5 - 1))
    # Half the weight: (1 + B x)^(1 - C) halfway between its values at x = 0 and 1; 0 / 0 at C = 1, but not beside it.
    length = dr.log(1 + B)
    k = (1 - C) * length
    k = dr.select(dr.abs(k) < 1e-2, 1e-2, k)
    x = dr.minimum((dr.exp(dr.log(0.5 * (1 + dr.exp(k))) / k * length) - 1) / B, 1)
    half2 = x * (2 - x)
    return dr.maximum(dr.sqrt(dr.sqrt(peak2 * half2)), p.ROUGHNESS[0])


def _like_ggx(values: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """1 + B x = 1 + (1/alpha^2 - 1) sin^2(theta_h) for small angles."""
    return {"B": 2 * (1 / (values["alpha_x"] * values["alpha_y"]) - 1), "C": np.full_like(values["alpha_x"], 2)}


@term("D", parameters=(p.ABC_B, p.ABC_C), start=_like_ggx, roughness=lambda q: alpha_of_abc(q["B"], q["C"]))
def D_abc_normalised(h, B, C):
    r"""The ABC distribution as a density of microfacet normals: an alternative to :func:`D_ggx` with a tail of its own.

    .. math::
        D = \frac{(1 + B x)^{-C}}{N}, \quad x = 1 - \cos\theta_h, \quad
        N = \frac{2 \pi}{B^2} \left( (1 + B) g(1 - C) - g(2 - C) \right), \quad g(k) = \frac{(1 + B)^k - 1}{k}

    Parameters
    ----------
    h : mi.Vector3f, N lanes
        Half vector, unit length, local frame, above the horizon.
    B, C : mi.Float, 1 or N lanes
        As :func:`D_abc`; B at least 1. C = 2 and B = 2 (1 / alpha^2 - 1) is GGX at small angles.

    Returns
    -------
    mi.Float, N lanes
        Density in 1/sr; integrates to 1 against cos_theta_h over the hemisphere.

    References
    ----------
    Low et al. 2012, *BRDF Models for Accurate and Efficient Rendering of Glossy Surfaces*; N is the integral of
    D cos(theta_h) over the hemisphere, by substitution of u = 1 + B x.

    Examples
    --------
    >>> D_abc_normalised(mi.Vector3f(0, 0, 1), mi.Float(6), mi.Float(2))
    [1.41328]
    """
    length = dr.log(1 + B)

    def g(k):
        t = k * length
        # near k = 0 the difference cancels: two terms of the series are exact to 1e-7 there
        near = dr.abs(t) < 1e-2
        t_far = dr.select(near, 1, t)
        return length * dr.select(near, 1 + t / 2 + dr.square(t) / 6, (dr.exp(t_far) - 1) / t_far)

    n = dr.two_pi * ((1 + B) * g(1 - C) - g(2 - C)) / dr.square(B)
    return D_abc(h, B, C) / n
