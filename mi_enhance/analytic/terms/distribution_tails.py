"""Distributions of microfacet normals whose tail has a parameter of its own; GGX and Beckmann are among them."""

from __future__ import annotations

from collections.abc import Mapping

import drjit as dr
import numpy as np

from .. import parameters as p
from .distribution import _MIN_COS2_H
from .registry import term

_MAX_EXPONENT = 1e4  # exp of minus this is 0; a larger power would become inf, and its derivative NaN


def _slope2(h, alpha_x, alpha_y):
    """Return the squared slope of a normal in roughnesses, and 1 / (pi alpha_x alpha_y cos^4)."""
    cos2 = dr.maximum(dr.square(h.z), _MIN_COS2_H)
    # the reciprocal before the square, as in D_beckmann
    height = dr.square(dr.rcp(cos2)) * dr.rcp(dr.pi * alpha_x * alpha_y)
    return (dr.square(h.x / alpha_x) + dr.square(h.y / alpha_y)) / cos2, height


def _as_beckmann(values: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    return {"beckmann_gamma": np.full_like(values["alpha_x"], 1)}


@term("D", parameters=(p.BECKMANN_GAMMA,), start=_as_beckmann)
def D_generalized_beckmann(h, alpha_x, alpha_y, beckmann_gamma):
    r"""Generalized Beckmann distribution of microfacet normals, anisotropic.

    .. math::
        D(h) = \frac{\gamma}{\Gamma(1/\gamma) \pi \alpha_x \alpha_y h_z^4} \exp(-s^\gamma), \quad
        s = \frac{h_x^2/\alpha_x^2 + h_y^2/\alpha_y^2}{h_z^2}

    Parameters
    ----------
    h : mi.Vector3f, N lanes
        Half vector, unit length, local frame. h_z^2 below 1e-8 counts as 1e-8, as in :func:`D_beckmann`.
    alpha_x, alpha_y : mi.Float, 1 or N lanes
        Roughness along t and b, in (0, 1].
    beckmann_gamma : mi.Float, 1 or N lanes
        Shape, in [0.2, 4]: 1 is Beckmann; below, the peak is sharper and the tail longer. s below 1e-12 counts as
        1e-12: the slope of its power is infinite at 0.

    Returns
    -------
    mi.Float, N lanes
        Density in 1/sr; integrates to 1 against cos_theta_h over the hemisphere.

    References
    ----------
    Hoffman 2016, *Recent Advances in Physically Based Shading*, after a model that Brady et al. 2014, *genBRDF*, found:
    made invariant to the shape, so that Smith's shadowing exists; here with two roughnesses.

    Examples
    --------
    >>> D_generalized_beckmann(mi.Vector3f(0, 0, 1), mi.Float(0.5), mi.Float(0.5), mi.Float(1))
    [1.27324]
    """
    s, height = _slope2(h, alpha_x, alpha_y)
    power = dr.minimum(beckmann_gamma * dr.log(dr.maximum(s, 1e-12)), dr.log(_MAX_EXPONENT))
    shape = dr.rcp(beckmann_gamma)
    return height * dr.exp(-dr.exp(power) - dr.lgamma(shape)) * beckmann_gamma


def _as_ggx(name: str):
    return lambda values: {name: np.full_like(values["alpha_x"], 2)}


@term("D", parameters=(p.CAUCHY_Q,), start=_as_ggx("cauchy_q"))
def D_hyper_cauchy(h, alpha_x, alpha_y, cauchy_q):
    r"""Hyper-Cauchy distribution of microfacet normals, anisotropic.

    .. math::
        D(h) = \frac{q - 1}{\pi \alpha_x \alpha_y h_z^4 (1 + s)^q}, \quad
        s = \frac{h_x^2/\alpha_x^2 + h_y^2/\alpha_y^2}{h_z^2}

    Parameters
    ----------
    h : mi.Vector3f, N lanes
        Half vector, unit length, local frame. h_z^2 below 1e-8 counts as 1e-8, as in :func:`D_beckmann`.
    alpha_x, alpha_y : mi.Float, 1 or N lanes
        Roughness along t and b, in (0, 1]; alpha^2 is the 2 sigma^2 of the source.
    cauchy_q : mi.Float, 1 or N lanes
        Fall-off of the tail, in [1.5, 10]: 2 is GGX.

    Returns
    -------
    mi.Float, N lanes
        Density in 1/sr; integrates to 1 against cos_theta_h over the hemisphere.

    References
    ----------
    Wellems et al. 2006, *Long wave infrared polarimetric model*; as a distribution of normals: Butler and Marciniak
    2014, *Robust categorization of microfacet BRDF models*. Two roughnesses in place of one.

    Examples
    --------
    >>> D_hyper_cauchy(mi.Vector3f(0, 0, 1), mi.Float(0.5), mi.Float(0.5), mi.Float(2))
    [1.27324]
    """
    s, height = _slope2(h, alpha_x, alpha_y)
    return height * (cauchy_q - 1) * dr.exp(-cauchy_q * dr.log(1 + s))


@term("D", parameters=(p.STUDENT_GAMMA,), start=_as_ggx("student_gamma"))
def D_student_t(h, alpha_x, alpha_y, student_gamma):
    r"""Student's t-distribution of the slopes, anisotropic: from GGX to Beckmann by one parameter.

    .. math::
        D(h) = \frac{1}{\pi \alpha_x \alpha_y h_z^4} \left( 1 + \frac{s}{\gamma - 1} \right)^{-\gamma}, \quad
        s = \frac{h_x^2/\alpha_x^2 + h_y^2/\alpha_y^2}{h_z^2}

    Parameters
    ----------
    h : mi.Vector3f, N lanes
        Half vector, unit length, local frame. h_z^2 below 1e-8 counts as 1e-8, as in :func:`D_beckmann`.
    alpha_x, alpha_y : mi.Float, 1 or N lanes
        Roughness along t and b, in (0, 1].
    student_gamma : mi.Float, 1 or N lanes
        Fall-off of the tail, in [1.5, 40]: 2 is GGX, towards infinity it is Beckmann.

    Returns
    -------
    mi.Float, N lanes
        Density in 1/sr; integrates to 1 against cos_theta_h over the hemisphere.

    References
    ----------
    Ribardiere, Bringier, Meneveaux and Simonot 2017, *STD: Student's t-Distribution of Slopes for Microfacet Based
    BSDFs*, eq. (8). Their shadowing is left to the model's G.

    Examples
    --------
    >>> D_student_t(mi.Vector3f(0, 0, 1), mi.Float(0.5), mi.Float(0.5), mi.Float(3))
    [1.27324]
    """
    s, height = _slope2(h, alpha_x, alpha_y)
    return height * dr.exp(-student_gamma * dr.log(1 + s / (student_gamma - 1)))
