"""Analytic terms of reflectance models, one function each, with its source. They read like the textbook.

Arguments are bound by name, see :func:`mi_enhance.geometry.quantities` and :mod:`mi_enhance.parameters`.
"""

from __future__ import annotations

import drjit as dr

from .geometry import MIN_COS


def M_lambert(rho_d):
    r"""Diffuse term, :math:`M = \rho_d / \pi`.

    Parameters
    ----------
    rho_d : mi.Color3f
        Diffuse albedo in [0, 1], linear RGB.

    Returns
    -------
    mi.Color3f
        Reflectance in 1/sr.

    References
    ----------
    Lambert 1760, *Photometria*.

    Examples
    --------
    >>> M_lambert(mi.Color3f(3.1415927))
    [[1, 1, 1]]
    """
    return rho_d * dr.inv_pi


def B_lambert(cos_theta_i, cos_theta_o):
    """Directional factor of the diffuse term, B = 1: Lambert's reflects the same in all directions.

    A node to be replaced: rough and translucent materials brighten towards the light or at the edges.

    Parameters
    ----------
    cos_theta_i, cos_theta_o : mi.Float, N lanes
        Cosines of viewer and light; unused.

    Returns
    -------
    float

    References
    ----------
    Lambert 1760, *Photometria*; Oren and Nayar 1994, *Generalization of Lambert's Reflectance Model*, for what it lacks.

    Examples
    --------
    >>> B_lambert(mi.Float(1), mi.Float(0.5))
    1.0
    """
    return 1.0


def S_constant(rho_s):
    """Specular scale, S = rho_s.

    Parameters
    ----------
    rho_s : mi.Color3f
        Specular albedo, linear RGB, at least 0 (OpenSVBRDF: up to 10), no unit.

    Returns
    -------
    mi.Color3f
        `rho_s` itself.

    References
    ----------
    Ma et al. 2023, *OpenSVBRDF*: f = rho_d / pi + rho_s D F G / (4 cos_theta_i cos_theta_o).

    Examples
    --------
    >>> S_constant(mi.Color3f(2))
    [[2, 2, 2]]
    """
    return rho_s


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


def G_smith_ggx(wi, wo, alpha_x, alpha_y):
    r"""Separable Smith shadowing and masking of GGX, :math:`G = G_1(\omega_i) G_1(\omega_o)`.

    .. math::
        G_1(\omega) = \frac{2 \cos\theta}
            {\cos\theta + \sqrt{\cos^2\theta + \alpha_x^2 \omega_x^2 + \alpha_y^2 \omega_y^2}}

    Parameters
    ----------
    wi, wo : mi.Vector3f, N lanes
        Directions towards viewer and light, local frame, above the horizon.
    alpha_x, alpha_y : mi.Float, 1 or N lanes
        Roughness along t and b, in (0, 1].

    Returns
    -------
    mi.Float, N lanes
        Visible fraction in [0, 1].

    References
    ----------
    Walter et al. 2007, eqs. (23) and (34), multiplied through by cos_theta: finite at the horizon where tan is not.

    Examples
    --------
    >>> G_smith_ggx(mi.Vector3f(0, 0, 1), mi.Vector3f(0, 0, 1), mi.Float(0.5), mi.Float(0.5))
    [1]
    """

    def g1(w):
        c = dr.maximum(w.z, 0)
        root = dr.sqrt(dr.square(w.z) + dr.square(alpha_x * w.x) + dr.square(alpha_y * w.y))
        return 2 * c / (c + root)

    return g1(wi) * g1(wo)


def inv_E(cos_theta_i, cos_theta_o):
    r"""Normalisation of the microfacet model, :math:`1/E = 1/(4 \cos\theta_i \cos\theta_o)`.

    Parameters
    ----------
    cos_theta_i, cos_theta_o : mi.Float, N lanes
        Cosines of viewer and light. Below 1e-4 they count as 1e-4: keeps the value finite at grazing angles.

    Returns
    -------
    mi.Float, N lanes
        At least 1/4.

    References
    ----------
    Walter et al. 2007, eq. (20).

    Examples
    --------
    >>> inv_E(mi.Float(1), mi.Float(0.5))
    [0.5]
    """
    return dr.rcp(4 * dr.maximum(cos_theta_i, MIN_COS) * dr.maximum(cos_theta_o, MIN_COS))
