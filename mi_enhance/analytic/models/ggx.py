"""GGX, with one lobe and with two."""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Callable, Mapping

from .. import lobes, terms
from .. import parameters as p
from ..graph import Node
from .model import Model, lobes_of_alpha, renamed
from .registry import model

# Two roughnesses each, at half the initial strength: narrow over wide, and both wide.
_PAIRS = tuple(
    {"alpha_x": a, "alpha_y": a, "alpha_x2": b, "alpha_y2": b, "rho_s": 0.5, "rho_s2": 0.5}
    for a, b in ((0.02, 0.1), (0.02, 0.5), (0.06, 0.2), (0.06, 0.6), (0.15, 0.4), (0.3, 0.8), (0.5, 0.15), (0.8, 0.4))
)


@model
def ggx() -> Model:
    """Anisotropic Cook-Torrance with the GGX distribution: 12 parameters, 6 terms, 5 operators.

    The product associates to the right, ``M + S * (D * (F * (G * 1/E)))``: D, which reaches 1e6, stays outside of every
    operator module, and everything right of S is a scalar.

    Returns
    -------
    Model

    References
    ----------
    Walter et al. 2007, eq. (20); the paper's input model, section 7.
    """
    m, s = Node("M", terms.M_lambert), Node("S", terms.S_constant)
    d, f, g = Node("D", terms.D_ggx), Node("F", terms.F_schlick), Node("G", terms.G_smith_ggx)
    return Model(
        name="ggx",
        graph=m + s * (d * (f * (g * Node("1/E", terms.inv_E)))),
        parameters=(p.N_X, p.N_Y, p.T_THETA, p.RHO_D, p.RHO_S, p.ALPHA_X, p.ALPHA_Y, p.F0),
        source="Walter et al. 2007",
    )


@model
def ggx2() -> Model:
    """Two GGX lobes over a directional diffuse term: 17 parameters, 12 terms, 11 operators.

    Measured materials show more than one GGX, and it has nodes of its own: a factor B of the diffuse term (bright edges
    or retro-reflection; 1 for Lambert) and a second lobe with its own colour and roughness (a coat over paint, flakes,
    the wide tail of metals, the white of grazing angles). Three colours with three scalar factors span all of RGB.

    Returns
    -------
    Model

    References
    ----------
    Walter et al. 2007, eq. (20), twice; two lobes: Cook and Torrance 1982, section 2 (weighted sum of distributions).
    """
    m, b = Node("M", terms.M_lambert), Node("B", terms.B_lambert)
    s, d, f, g = (
        Node("S", terms.S_constant),
        Node("D", terms.D_ggx),
        Node("F", terms.F_schlick),
        Node("G", terms.G_smith_ggx),
    )
    s2, d2, f2, g2 = (
        _second("S2", terms.S_constant),
        _second("D2", terms.D_ggx),
        _second("F2", terms.F_schlick),
        _second("G2", terms.G_smith_ggx),
    )
    first = s * (d * (f * (g * Node("1/E", terms.inv_E))))
    second = s2 * (d2 * (f2 * (g2 * _second("1/E2", terms.inv_E))))
    return Model(
        name="ggx2",
        graph=m * b + first + second,
        parameters=(
            *(p.N_X, p.N_Y, p.T_THETA, p.RHO_D, p.RHO_S, p.ALPHA_X, p.ALPHA_Y, p.F0),
            *(p.RHO_S2, p.ALPHA_X2, p.ALPHA_Y2),
        ),
        source="Walter et al. 2007, two lobes",
        starts=_PAIRS,
    )


@model
def ggx_retro() -> Model:
    """GGX and a GGX lobe around the direction that light came from: 17 parameters, 12 terms, 11 operators.

    For tapes, paints with beads, and cloth. The parameters are those of :func:`ggx2`; rho_s2, alpha_x2 and alpha_y2 are
    those of the lobe that goes back.

    Returns
    -------
    Model

    References
    ----------
    Belcour et al. 2014, *BRDF Measurements and Analysis of Retroreflective Materials*.
    """
    back: dict[str, Callable] = {"D2": terms.D_retro_ggx, "F2": terms.F_retro_schlick}
    two = ggx2()
    graph = two.graph
    for slot, retro in back.items():
        graph = graph.exchange(_second(slot, retro, retro.__name__))

    def lobes_of(params: Mapping) -> list[tuple]:
        first, second = lobes_of_alpha(params)
        return [first, lobes.AroundBack(second)]

    return dataclasses.replace(
        two, name="ggx_retro", graph=graph, source="Walter et al. 2007; Belcour et al. 2014", lobes=lobes_of
    )


def _second(name: str, term: Callable, label: str = "") -> Node:
    """Return a node of the second lobe: `term` with rho_s2, alpha_x2, alpha_y2 for the first lobe's parameters."""
    names = inspect.signature(term).parameters
    return renamed(name, term, {n: lobes.SECOND.own(n) if n in lobes.OWN else n for n in names}, label)
