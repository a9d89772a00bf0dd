"""Normalizations 1/E."""

from __future__ import annotations

import drjit as dr

from ..geometry import MIN_COS
from .registry import term


@term("1/E")
def inv_E(cos_theta_i, cos_theta_o):
    r"""Normalization of the microfacet model, :math:`1/E = 1/(4 \cos\theta_i \cos\theta_o)`.

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


@term("1/E")
def inv_E_pi(cos_theta_i, cos_theta_o):
    r"""Normalization of Cook and Torrance and of the ABC model, :math:`1/E = 1/(\pi \cos\theta_i \cos\theta_o)`.

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


@term("1/E")
def inv_E_ward(cos_theta_i, cos_theta_o):
    r"""Normalization of Ward's model, :math:`1/E = 1/(4 \sqrt{\cos\theta_i \cos\theta_o})`.

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
    r"""Normalization of Ashikhmin and Shirley, :math:`1/E = 1/(4 \cos\theta_d \max(\cos\theta_i, \cos\theta_o))`.

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
