"""Shadowing and masking terms G."""

from __future__ import annotations

import drjit as dr

from .registry import term


@term("G")
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


@term("G")
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
