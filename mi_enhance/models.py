"""Analytic reflectance models as graphs with named parameters: what an enhancement starts from (paper, section 3)."""

from __future__ import annotations

import dataclasses
import difflib
import inspect
from collections.abc import Callable

from . import parameters as p
from . import terms
from .graph import Node


@dataclasses.dataclass(frozen=True)
class Model:
    """A graph, the parameters it reads, and where it comes from. Prints as its equation.

    Examples
    --------
    >>> print(ggx())
    M + S * D * F * G * 1/E
    >>> len(ggx().graph.slots)
    11
    """

    name: str
    graph: Node
    parameters: tuple[p.Parameter, ...]
    source: str

    def __str__(self) -> str:
        return str(self.graph)


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


def ggx2() -> Model:
    """Two GGX lobes over a directional diffuse term: 17 parameters, 12 terms, 11 operators.

    What measured materials show beside one GGX is given nodes of its own: a factor B of the diffuse term (retro-reflection,
    grazing edges; 1 for Lambert) and a second lobe with its own colour and roughness (a coat over paint, flakes, the
    wide tail of metals, the white of grazing angles). Three colours with three scalar factors span all of RGB.

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
    )


def _second(name: str, term: Callable) -> Node:
    """A node of the second lobe: `term` with rho_s2, alpha_x2, alpha_y2 in place of the first lobe's parameters."""
    own = {n: f"{n}2" if n in ("rho_s", "alpha_x", "alpha_y") else n for n in inspect.signature(term).parameters}
    return Node(name, lambda **q: term(**{n: q[own[n]] for n in own}), inputs=tuple(own.values()))


MODELS = {"ggx": ggx, "ggx2": ggx2}


def get(name: str) -> Model:
    """Return the model called `name`.

    Raises
    ------
    KeyError
        If there is none; the message lists the choices.

    Examples
    --------
    >>> get("ggx").name
    'ggx'
    """
    if name not in MODELS:
        hint = difflib.get_close_matches(name, MODELS, 1)
        raise KeyError(
            f'models.get(): unknown model "{name}". Choose one of: {", ".join(sorted(MODELS))}.'
            + (f' Did you mean "{hint[0]}"?' if hint else "")
        )
    return MODELS[name]()
