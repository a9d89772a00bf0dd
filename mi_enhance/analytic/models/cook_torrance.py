"""Cook and Torrance's model."""

from __future__ import annotations

from .. import parameters as p
from .. import terms
from ..graph import Node
from .model import Model
from .registry import model

# Darker and with more Fresnel than the initial values: on MERL a third of the excess over the best of many starts.
_COOK_TORRANCE_STARTS = tuple(
    {"alpha_x": alpha, "alpha_y": alpha, "rho_d": 0.1, "rho_s": rho_s, "F0": f0}
    for alpha, rho_s, f0 in (
        (0.02, 0.3, 0.2),
        (0.06, 0.3, 0.2),
        (0.15, 0.3, 0.2),
        (0.3, 0.3, 0.2),
        (0.5, 0.3, 0.2),
        (0.8, 0.3, 0.2),
        (0.2, 0.2, 0.7),
        (0.5, 0.2, 0.7),
    )
)


@model
def cook_torrance() -> Model:
    r"""Cook and Torrance's model: Beckmann's distribution, V-cavities and the exact Fresnel reflectance; 12 parameters.

    .. math::
        f = \frac{\rho_d}{\pi} + \rho_s \frac{D F G}{\pi \cos\theta_i \cos\theta_o}

    The 1/pi is the original's, kept so that published values of rho_s can be used. With D normalized as it is here the
    lobe reflects up to 4 rho_s / pi: rho_s = pi / 4 is what rho_s = 1 is to ``ggx``. Anisotropy is the usual extension
    of D (the original is isotropic).

    Returns
    -------
    Model

    References
    ----------
    Cook and Torrance 1982, *A Reflectance Model for Computer Graphics*.

    Examples
    --------
    >>> print(cook_torrance())
    M + S * D * F * G * 1/E
    """
    m, s, d = Node("M", terms.M_lambert), Node("S", terms.S_constant), Node("D", terms.D_beckmann)
    f, g = Node("F", terms.F_cook_torrance), Node("G", terms.G_v_cavity)
    return Model(
        name="cook_torrance",
        graph=m + s * (d * (f * (g * Node("1/E", terms.inv_E_pi)))),
        parameters=(p.N_X, p.N_Y, p.T_THETA, p.RHO_D, p.RHO_S, p.ALPHA_X, p.ALPHA_Y, p.F0),
        source="Cook and Torrance 1982",
        starts=_COOK_TORRANCE_STARTS,
        v_cavity=True,
    )
