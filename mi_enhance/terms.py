"""Analytic terms of reflectance models, one function each, with its source. They read like the textbook.

Arguments are bound by name, see :func:`mi_enhance.geometry.quantities` and :mod:`mi_enhance.parameters`.
"""

from __future__ import annotations

import drjit as dr

from .geometry import MIN_COS

# Smallest squared cosine of a half vector that enters a division: exp(-tan^2) is 0 there for every roughness up to 1.
_MIN_COS2_H = 1e-8


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
    Lambert 1760, *Photometria*; what it lacks: Oren and Nayar 1994, *Generalization of Lambert's Reflectance Model*.

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


def inv_E_pi(cos_theta_i, cos_theta_o):
    r"""Normalisation of Cook and Torrance and of the ABC model, :math:`1/E = 1/(\pi \cos\theta_i \cos\theta_o)`.

    Parameters
    ----------
    cos_theta_i, cos_theta_o : mi.Float, N lanes
        Cosines of viewer and light. Below 1e-4 they count as 1e-4: keeps the value finite at grazing angles.

    Returns
    -------
    mi.Float, N lanes
        At least 1/pi. With a D that integrates to 1 the right factor is 1/4 (:func:`inv_E`): these lobes are 4/pi times
        as bright for the same specular scale.

    References
    ----------
    Cook and Torrance 1982, *A Reflectance Model for Computer Graphics*, the equation of R_s.

    Examples
    --------
    >>> inv_E_pi(mi.Float(1), mi.Float(0.5))
    [0.63662]
    """
    return dr.rcp(dr.pi * dr.maximum(cos_theta_i, MIN_COS) * dr.maximum(cos_theta_o, MIN_COS))


def inv_E_ward(cos_theta_i, cos_theta_o):
    r"""Normalisation of Ward's model, :math:`1/E = 1/(4 \sqrt{\cos\theta_i \cos\theta_o})`.

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
    Ward 1992, *Measuring and Modeling Anisotropic Reflection*, eq. (5a).

    Examples
    --------
    >>> inv_E_ward(mi.Float(1), mi.Float(0.25))
    [0.5]
    """
    return 0.25 * dr.rsqrt(dr.maximum(cos_theta_i, MIN_COS) * dr.maximum(cos_theta_o, MIN_COS))


def inv_E_ashikhmin_shirley(cos_theta_d, cos_theta_i, cos_theta_o):
    r"""Normalisation of Ashikhmin and Shirley, :math:`1/E = 1/(4 \cos\theta_d \max(\cos\theta_i, \cos\theta_o))`.

    Parameters
    ----------
    cos_theta_d : mi.Float, N lanes
        Cosine between the half vector and either direction. Below 1e-4 it counts as 1e-4: keeps the value finite at
        grazing angles.
    cos_theta_i, cos_theta_o : mi.Float, N lanes
        Cosines of viewer and light; the larger of them counts as at least 1e-4, for the same reason.

    Returns
    -------
    mi.Float, N lanes
        At least 1/4.

    References
    ----------
    Ashikhmin and Shirley 2000, *An Anisotropic Phong BRDF Model*, the specular term.

    Examples
    --------
    >>> inv_E_ashikhmin_shirley(mi.Float(1), mi.Float(0.25), mi.Float(0.5))
    [0.5]
    """
    return dr.rcp(4 * dr.maximum(cos_theta_d, MIN_COS) * dr.maximum(dr.maximum(cos_theta_i, cos_theta_o), MIN_COS))


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


def B_ashikhmin_shirley(cos_theta_i, cos_theta_o, F0):
    r"""Directional factor of Ashikhmin and Shirley's diffuse term: what the specular one leaves over.

    .. math::
        B = \frac{28}{23} (1 - F_0) \left( 1 - \left( 1 - \frac{\cos\theta_i}{2} \right)^5 \right)
            \left( 1 - \left( 1 - \frac{\cos\theta_o}{2} \right)^5 \right)

    Parameters
    ----------
    cos_theta_i, cos_theta_o : mi.Float, N lanes
        Cosines of viewer and light, in [0, 1].
    F0 : mi.Float, 1 or N lanes
        Specular reflectance at normal incidence, in [0, 1].

    Returns
    -------
    mi.Float, N lanes
        Times rho_d / pi, :func:`M_lambert`, the diffuse term; 0 at the horizon.

    References
    ----------
    Ashikhmin and Shirley 2000, *An Anisotropic Phong BRDF Model*, the diffuse term, with F0 for their R_s.

    Examples
    --------
    >>> B_ashikhmin_shirley(mi.Float(1), mi.Float(0), mi.Float(0.04))
    [0]
    """

    def rest(c):  # multiplied out: the difference keeps no digit of a cosine of 1e-7
        x = 0.5 * c
        return x * (5 + x * (-10 + x * (10 + x * (-5 + x))))

    return 28 / 23 * (1 - F0) * rest(cos_theta_i) * rest(cos_theta_o)


def S_abc(A):
    """Height and colour of the ABC model's peak, S = A.

    Parameters
    ----------
    A : mi.Color3f
        Linear RGB, above 0, no unit; published fits reach from 0.08 to 5,710.

    Returns
    -------
    mi.Color3f
        `A` itself.

    References
    ----------
    Low et al. 2012, *BRDF Models for Accurate and Efficient Rendering of Glossy Surfaces*: the A of
    A / (1 + B (1 - cos_theta_h))^C, :func:`D_abc` the rest.

    Examples
    --------
    >>> S_abc(mi.Color3f(2))
    [[2, 2, 2]]
    """
    return A


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
        In (0, 1]; not normalised.

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


def F_cook_torrance(cos_theta_d, F0):
    r"""Exact Fresnel reflectance of a dielectric with reflectance F0 at normal incidence, unpolarised light.

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


def F_dielectric(cos_theta_d, ior):
    r"""Exact Fresnel reflectance of a dielectric by its index of refraction, unpolarised light.

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


def G_v_cavity(cos_theta_h, cos_theta_i, cos_theta_o, cos_theta_d):
    r"""Shadowing and masking by V-shaped grooves.

    .. math::
        G = \min\left( 1, \frac{2 \cos\theta_h \cos\theta_i}{\cos\theta_d},
            \frac{2 \cos\theta_h \cos\theta_o}{\cos\theta_d} \right)

    Parameters
    ----------
    cos_theta_h, cos_theta_i, cos_theta_o : mi.Float, N lanes
        Cosines of half vector, viewer and light; above the horizon.
    cos_theta_d : mi.Float, N lanes
        Cosine between the half vector and either direction. Below 1e-7 it counts as 1e-7: no 0 / 0 for directions that
        oppose each other.

    Returns
    -------
    mi.Float, N lanes
        Visible fraction in [0, 1].

    References
    ----------
    Cook and Torrance 1982, *A Reflectance Model for Computer Graphics*, the equation of G, after Torrance and Sparrow
    1967.

    Examples
    --------
    >>> G_v_cavity(mi.Float(0.5), mi.Float(0.5), mi.Float(0.25), mi.Float(1))
    [0.25]
    """
    smaller = dr.minimum(cos_theta_i, cos_theta_o)
    return dr.minimum(1, 2 * cos_theta_h * smaller / dr.maximum(cos_theta_d, 1e-7))
