"""Distributions D of microfacet normals, by roughness or exponent."""

from __future__ import annotations

import drjit as dr

from .registry import term

# Smallest squared cosine of a half vector that enters a division: exp(-tan^2) is 0 there for every roughness up to 1.
_MIN_COS2_H = 1e-8


@term("D")
def D_ggx(h, alpha_x, alpha_y):
    r"""Anisotropic GGX (Trowbridge-Reitz) distribution of microfacet normals.

    .. math::
        D(h) = \frac{1}{\pi \alpha_x \alpha_y \left( h_x^2/\alpha_x^2 + h_y^2/\alpha_y^2 + h_z^2 \right)^2}

    Parameters
    ----------
    h : mi.Vector3f, N lanes
        Half vector, unit length, local frame.
    alpha_x, alpha_y : mi.Float, 1 or N lanes
        Roughness along t and b, in (0, 1].

    Returns
    -------
    mi.Float, N lanes
        Density in 1/sr; integrates to 1 against cos_theta_h over the hemisphere.

    References
    ----------
    Walter et al. 2007, *Microfacet Models for Refraction through Rough Surfaces*, eq. (33); anisotropic form: Heitz
    2014, *Understanding the Masking-Shadowing Function*, eq. (85).

    Examples
    --------
    >>> D_ggx(mi.Vector3f(0, 0, 1), mi.Float(0.5), mi.Float(0.5))
    [1.27324]
    """
    slope = dr.square(h.x / alpha_x) + dr.square(h.y / alpha_y) + dr.square(h.z)
    return dr.rcp(dr.pi * alpha_x * alpha_y * dr.square(slope))


@term("D")
def D_ward(h, alpha_x, alpha_y):
    r"""Ward's anisotropic lobe: a Gaussian of the slopes.

    .. math::
        D(h) = \frac{1}{\pi \alpha_x \alpha_y} \exp\left( -\frac{h_x^2/\alpha_x^2 + h_y^2/\alpha_y^2}{h_z^2} \right)

    Parameters
    ----------
    h : mi.Vector3f, N lanes
        Half vector, unit length, local frame. h_z^2 below 1e-8 counts as 1e-8: the slope stays finite where wi and wo
        both graze on the same side (the value is 0 there for any roughness).
    alpha_x, alpha_y : mi.Float, 1 or N lanes
        Roughness along t and b, in (0, 1].

    Returns
    -------
    mi.Float, N lanes
        In 1/sr; not a density of normals (its integral against cos_theta_h is below 1), see :func:`D_beckmann`.

    References
    ----------
    Ward 1992, *Measuring and Modeling Anisotropic Reflection*, eq. (5a), of which :func:`inv_E_ward` has the rest.

    Examples
    --------
    >>> D_ward(mi.Vector3f(0, 0, 1), mi.Float(0.5), mi.Float(0.5))
    [1.27324]
    """
    slope = (dr.square(h.x / alpha_x) + dr.square(h.y / alpha_y)) / dr.maximum(dr.square(h.z), _MIN_COS2_H)
    return dr.exp(-slope) * dr.rcp(dr.pi * alpha_x * alpha_y)


@term("D")
def D_beckmann(h, alpha_x, alpha_y):
    r"""Anisotropic Beckmann distribution of microfacet normals.

    .. math::
        D(h) = \frac{1}{\pi \alpha_x \alpha_y h_z^4}
            \exp\left( -\frac{h_x^2/\alpha_x^2 + h_y^2/\alpha_y^2}{h_z^2} \right)

    Parameters
    ----------
    h : mi.Vector3f, N lanes
        Half vector, unit length, local frame. h_z^2 below 1e-8 counts as 1e-8: no 0 * inf where wi and wo both graze on
        the same side (the value is 0 there for any roughness).
    alpha_x, alpha_y : mi.Float, 1 or N lanes
        Roughness along t and b, in (0, 1].

    Returns
    -------
    mi.Float, N lanes
        Density in 1/sr; integrates to 1 against cos_theta_h over the hemisphere.

    References
    ----------
    Walter et al. 2007, *Microfacet Models for Refraction through Rough Surfaces*, eq. (25), with two roughnesses as in
    Heitz 2014, *Understanding the Masking-Shadowing Function*. Cook and Torrance 1982 have a constant in its place.

    Examples
    --------
    >>> D_beckmann(mi.Vector3f(0, 0, 1), mi.Float(0.5), mi.Float(0.5))
    [1.27324]
    """
    # the reciprocal before the square: its derivative stays within float32 for h_z^2 = 1e-8
    return D_ward(h, alpha_x, alpha_y) * dr.square(dr.rcp(dr.maximum(dr.square(h.z), _MIN_COS2_H)))


def D_ashikhmin_shirley(h, n_u, n_v):
    r"""Ashikhmin and Shirley's distribution: a Phong lobe about the normal with an exponent for each tangent.

    .. math::
        D(h) = \frac{\sqrt{(n_u + 1)(n_v + 1)}}{2 \pi} h_z^e, \quad
        e = \frac{n_u h_x^2 + n_v h_y^2}{h_x^2 + h_y^2}

    Parameters
    ----------
    h : mi.Vector3f, N lanes
        Half vector, unit length, local frame, above the horizon. h_z below 1e-4 counts as 1e-4: its logarithm stays
        finite where wi and wo both graze on the same side.
    n_u, n_v : mi.Float, 1 or N lanes
        Exponents along t and b, at least 1.

    Returns
    -------
    mi.Float, N lanes
        Density of half vectors in 1/sr; integrates to 1 over the hemisphere without a cosine.

    References
    ----------
    Ashikhmin and Shirley 2000, *An Anisotropic Phong BRDF Model*, the specular term, of whose 1 / (8 pi)
    :func:`inv_E_ashikhmin_shirley` has a quarter. Near h = n written with log(h_z) = -2 atanh(u), where
    u = (1 - h_z) / (1 + h_z) = (h_x^2 + h_y^2) / (1 + h_z)^2, and the series of atanh(u) / u: the logarithm itself has
    an error of 6e-8 there, and e is up to 1e6.

    Examples
    --------
    >>> D_ashikhmin_shirley(mi.Vector3f(0, 0, 1), mi.Float(24), mi.Float(3))
    [1.59155]
    """
    sin2 = dr.square(h.x) + dr.square(h.y)
    u = sin2 / dr.square(1 + h.z)
    t = dr.square(dr.minimum(u, 0.25))
    atanh = 1 + t * (1 / 3 + t * (1 / 5 + t * (1 / 7 + t * (1 / 9 + t / 11))))  # over u, to 1e-8
    near = 2 * atanh / dr.square(1 + h.z)
    # sin2 is at least 0.64 where this is chosen; the floor keeps the derivative finite where it is not
    far = -dr.log(dr.maximum(h.z, 1e-4)) / dr.maximum(sin2, 0.5)
    exponent = (n_u * dr.square(h.x) + n_v * dr.square(h.y)) * dr.select(u < 0.25, near, far)
    return dr.sqrt((n_u + 1) * (n_v + 1)) * (0.5 * dr.inv_pi) * dr.exp(-exponent)
