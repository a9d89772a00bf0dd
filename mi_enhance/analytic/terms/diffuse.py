"""Diffuse terms M and their directional factors B."""

from __future__ import annotations

import drjit as dr


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
