"""The record of a model: a graph, its parameters, starts of its fits, the GGX lobes that cover it."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping

from .. import parameters as p
from ..graph import Node
from ..lobes import LOBES, without_absent


def lobes_of_alpha(params: Mapping) -> list[tuple]:
    """Return (rho_s, alpha_x, alpha_y) of each lobe of a model that has roughness and specular albedo."""
    return [tuple(params[name] for name in (q.rho_s, q.alpha_x, q.alpha_y)) for q in LOBES if q.rho_s in params]


# The loss has a local minimum for each lobe width it can explain: one start for each.
_ROUGHNESSES = tuple({"alpha_x": alpha, "alpha_y": alpha} for alpha in (0.02, 0.06, 0.15, 0.3, 0.5, 0.8))


@dataclasses.dataclass(frozen=True)
class Model:
    """A graph, the parameters it reads, and its source. Prints as its equation.

    Parameters
    ----------
    name : str
        Its name in files and for :func:`mi_enhance.models.get`.
    graph : Node
    parameters : tuple of Parameter
    source : str
        Literature.
    starts : tuple of dict
        Starts of an analytic fit, each with the values that differ from the initial ones; by default six roughnesses.
    lobes : callable
        ``lobes(params) -> [(rho_s, alpha_x, alpha_y), ...]``: GGX lobes that cover the model's own, for sampling.
    v_cavity : bool
        True if the model masks with V-cavities: visible normals are then drawn with theirs instead of Smith's.
    terms : dict of str to str
        Slots that hold another analytic term than the model's own, see :mod:`mi_enhance.analytic.alternative_terms`.
    extra : tuple of str
        Names of the parameters that those terms brought; modules do not read them.
    text : str
        The text that a model of :func:`mi_enhance.models.from_expression` was read from; files keep it.

    Examples
    --------
    >>> from mi_enhance import models
    >>> print(models.ggx())
    M + S * D * F * G * 1/E
    >>> len(models.ggx().graph.slots)
    11
    """

    name: str
    graph: Node
    parameters: tuple[p.Parameter, ...]
    source: str
    starts: tuple[dict[str, float], ...] = _ROUGHNESSES
    lobes: Callable[[Mapping], list[tuple]] = lobes_of_alpha
    v_cavity: bool = False
    terms: Mapping[str, str] = dataclasses.field(default_factory=dict)
    extra: tuple[str, ...] = ()
    text: str = dataclasses.field(default="", repr=False)

    def __str__(self) -> str:
        return str(self.graph)

    def present_lobes(self, params: Mapping) -> list[tuple]:
        """Return :attr:`lobes` without those whose colour is not among `params`: it is 0."""
        return [lobe for lobe in without_absent(self.lobes, p.colours(self.parameters), params) if lobe]


def renamed(name: str, term: Callable, own: Mapping[str, str], label: str = "") -> Node:
    """Return a node whose `term` reads other quantities than those of its arguments' names: argument -> quantity."""
    return Node(name, lambda **q: term(**{n: q[o] for n, o in own.items()}), inputs=tuple(own.values()), label=label)
