"""The microfacet ABC model of Low et al."""

from __future__ import annotations

from collections.abc import Mapping

import drjit as dr

from .. import parameters as p
from .. import terms
from ..graph import Node
from .model import Model


def lobes_of_abc(params: Mapping) -> list[tuple]:
    """A GGX lobe for the ABC lobe: as high, and as wide as the mean of two widths.

    Its peak is narrow and its tail wide; the geometric mean of the alpha with the same half width at half maximum and
    of the alpha with half of the weight inside the same angle halves the noise of the former where tails are wide.
    """
    alpha = alpha_of_abc(params["B"], params["C"])
    return [(params["A"] * (4 * alpha * alpha), alpha, alpha)]  # rho_s / (4 pi alpha^2) = A / pi


def alpha_of_abc(B, C):
    """Roughness of the GGX lobe that covers the ABC distribution, see :func:`lobes_of_abc`."""
    # x = 1 - cos(theta_h). Half the maximum: (1 + B x)^-C = 1/2; of GGX: sin^2 (1 - alpha^2) = alpha^2 (sqrt(2) - 1).
    x = dr.minimum((dr.exp2(dr.rcp(C)) - 1) / B, 1)
    sin2 = x * (2 - x)
    peak2 = sin2 / (sin2 + (2**0.5 - 1))
    # Half the weight: (1 + B x)^(1 - C) halfway between its values at x = 0 and 1; 0 / 0 at C = 1, but not beside it.
    length = dr.log(1 + B)
    k = (1 - C) * length
    k = dr.select(dr.abs(k) < 1e-2, 1e-2, k)
    x = dr.minimum((dr.exp(dr.log(0.5 * (1 + dr.exp(k))) / k * length) - 1) / B, 1)
    half2 = x * (2 - x)
    # 1e-4: where Mitsuba's own microfacet distribution ends
    return dr.maximum(dr.sqrt(dr.sqrt(peak2 * half2)), 1e-4)


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
