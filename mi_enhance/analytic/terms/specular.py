"""Specular scales S."""

from __future__ import annotations


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
