"""Ashikhmin and Shirley's anisotropic Phong model."""

from __future__ import annotations

from collections.abc import Mapping

import drjit as dr

from .. import parameters as p
from .. import terms
from ..graph import Node
from .model import Model
from .registry import model


def lobes_of_ashikhmin_shirley(params: Mapping) -> list[tuple]:
    """Return a GGX lobe for cos^n, of roughness alpha^2 = 2 / (n + 2): with it Beckmann's lobe is closest to cos^n."""
    alpha = (dr.sqrt(2 / (params[n] + 2)) for n in ("n_u", "n_v"))
    return [(params["rho_s"], *alpha)] if "rho_s" in params else []


# Roughnesses of 0.02 to 0.8, alpha^2 = 2 / (n + 2).
_EXPONENTS = tuple({"n_u": n, "n_v": n} for n in (5000.0, 550.0, 87.0, 20.0, 6.0, 1.1))


@model
def ashikhmin_shirley() -> Model:
    r"""Ashikhmin and Shirley's anisotropic Phong model over a diffuse term that leaves room for it; 12 parameters.

    .. math::
        f = \frac{\rho_d}{\pi} B + \rho_s \frac{D F}{4 \cos\theta_d \max(\cos\theta_i, \cos\theta_o)}

    The original has one specular colour R_s, in Schlick's term and, as 1 - R_s, in the diffuse one. Here F0 stands in
    both places and rho_s scales the specular term alone, so that f is linear in the colours: with a grey R_s the
    original is F0 = R_s and rho_s = 1. With another rho_s the two terms together may reflect more or less than 1.
    rho_d is not quite the albedo of the diffuse term, which falls towards grazing angles.

    Returns
    -------
    Model

    References
    ----------
    Ashikhmin and Shirley 2000, *An Anisotropic Phong BRDF Model*.

    Examples
    --------
    >>> print(ashikhmin_shirley())
    M * B + S * D * F * 1/E
    """
    m, b = Node("M", terms.M_lambert), Node("B", terms.B_ashikhmin_shirley)
    s, d, f = Node("S", terms.S_constant), Node("D", terms.D_ashikhmin_shirley), Node("F", terms.F_schlick)
    return Model(
        name="ashikhmin_shirley",
        graph=m * b + s * (d * (f * Node("1/E", terms.inv_E_ashikhmin_shirley))),
        parameters=(p.N_X, p.N_Y, p.T_THETA, p.RHO_D, p.RHO_S, p.N_U, p.N_V, p.F0),
        source="Ashikhmin and Shirley 2000",
        starts=_EXPONENTS,
        lobes=lobes_of_ashikhmin_shirley,
        v_cavity=True,  # towards grazing angles this lobe, too, grows as 1 / cos_theta_i
    )
