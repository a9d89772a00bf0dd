"""Analytic reflectance models as graphs with named parameters: what an enhancement starts from (paper, section 3)."""

from __future__ import annotations

import dataclasses
import difflib

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


MODELS = {"ggx": ggx}


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
