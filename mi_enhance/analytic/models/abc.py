"""The microfacet ABC model of Low et al."""

from __future__ import annotations

from collections.abc import Mapping

from .. import parameters as p
from .. import terms
from ..graph import Node
from ..terms.distribution_abc import alpha_of_abc
from .model import Model
from .registry import model


def lobes_of_abc(params: Mapping) -> list[tuple]:
    """Return a GGX lobe as high as the ABC lobe, and as wide as :func:`alpha_of_abc` says."""
    alpha = alpha_of_abc(params["B"], params["C"])
    return [(params["A"] * (4 * alpha * alpha), alpha, alpha)]  # rho_s / (4 pi alpha^2) = A / pi


# Matte, satin, glossy, polished, metal, wide tails, cloth: what the published fits of MERL look like.
_ABC_STARTS = tuple(
    {"A": a, "B": b, "C": c, "ior": n}
    for a, b, c, n in (
        (1.0, 30.0, 1.7, 1.5),
        (5.0, 300.0, 1.2, 1.5),
        (50.0, 5e3, 1.2, 1.7),
        (500.0, 7e4, 1.2, 1.5),
        (1000.0, 2e5, 1.1, 5.0),
        (100.0, 1e6, 0.6, 5.0),
        (0.5, 2e6, 0.12, 2.5),
    )
)


@model
def abc() -> Model:
    r"""The microfacet ABC model: isotropic, for glossy surfaces with wide tails; 9 parameters.

    .. math::
        f = \frac{\rho_d}{\pi} + A \frac{F G}{\pi \cos\theta_i \cos\theta_o (1 + B (1 - \cos\theta_h))^C}

    A stands in a slot of its own, S, so that what is right of it is a scalar. It is the height of the peak, not an
    albedo: the energy of the lobe changes with B and C. Published values of rho_d, A, B, C and ior can be used as they
    are.

    Returns
    -------
    Model

    References
    ----------
    Low, Kronander, Ynnerman and Unger 2012, *BRDF Models for Accurate and Efficient Rendering of Glossy Surfaces*.

    Examples
    --------
    >>> print(abc(), p.count(abc().parameters))
    M + S * D * F * G * 1/E 9
    """
    m, s, d = Node("M", terms.M_lambert), Node("S", terms.S_abc), Node("D", terms.D_abc)
    f, g = Node("F", terms.F_dielectric), Node("G", terms.G_v_cavity)
    return Model(
        name="abc",
        graph=m + s * (d * (f * (g * Node("1/E", terms.inv_E_pi)))),
        parameters=(p.RHO_D, p.ABC_A, p.ABC_B, p.ABC_C, p.IOR),
        source="Low et al. 2012",
        starts=_ABC_STARTS,
        lobes=lobes_of_abc,
        v_cavity=True,
    )
