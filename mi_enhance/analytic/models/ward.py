"""Ward's anisotropic model."""

from __future__ import annotations

from .. import parameters as p
from .. import terms
from ..graph import Node
from .model import Model
from .registry import model


@model
def ward() -> Model:
    r"""Ward's anisotropic model, neither Fresnel nor shadowing; 11 parameters.

    .. math::
        f = \frac{\rho_d}{\pi} + \rho_s \frac{1}{\sqrt{\cos\theta_i \cos\theta_o}}
            \frac{\exp(-(h_x^2/\alpha_x^2 + h_y^2/\alpha_y^2) / h_z^2)}{4 \pi \alpha_x \alpha_y}

    The original normalization; the albedo of its lobe grows without bound towards grazing angles, as
    1 / sqrt(cos_theta_i).

    Returns
    -------
    Model

    References
    ----------
    Ward 1992, *Measuring and Modeling Anisotropic Reflection*, eq. (5a).

    Examples
    --------
    >>> print(ward())
    M + S * D * 1/E
    """
    m, s, d = Node("M", terms.M_lambert), Node("S", terms.S_constant), Node("D", terms.D_ward)
    return Model(
        name="ward",
        graph=m + s * (d * Node("1/E", terms.inv_E_ward)),
        parameters=(p.N_X, p.N_Y, p.T_THETA, p.RHO_D, p.RHO_S, p.ALPHA_X, p.ALPHA_Y),
        source="Ward 1992",
    )
