"""What a material does not need is left out: terms that are 0, the frame of the surface, features that say nothing.

Exact: the BRDF that is left gives the same values for the parameters it was made for.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import mitsuba as mi
import numpy as np

from ..analytic import parameters
from .enhanced_brdf import EnhancedBRDF


def simplify(brdf: EnhancedBRDF, values: Mapping[str, np.ndarray]) -> tuple[EnhancedBRDF, frozenset[str]]:
    """Leave out what changes nothing for the given parameters.

    Parameters
    ----------
    brdf : EnhancedBRDF
    values : dict of str to array
        Parameters that are known: the same everywhere on the surface, and not being optimized.

    Returns
    -------
    brdf : EnhancedBRDF
        Without the terms that are 0 and their networks.
    left_out : frozenset of str
        Parameters of value 0 that it must be evaluated without: colours, the frame, ``asymmetry``.

    Examples
    --------
    >>> from mi_enhance import Material
    >>> m = Material.analytic("ggx2")
    >>> print(*simplify(m.brdf, m.params))  # doctest: +ELLIPSIS
    M * B + S * D * F * G * 1/E frozenset({...})
    """
    zero = {name for name, v in values.items() if not np.any(v)}
    left_out = set(parameters.FRAME) if zero.issuperset(parameters.FRAME) else set()
    networks = dict(brdf.modules)
    graph = brdf.model.graph.without(_zero_terms(brdf, zero), networks)
    if graph is not None:
        networks = {slot: mlp for slot, mlp in networks.items() if slot in graph.slots}
        read = {name for node in graph.walk() for name in node.inputs}
        left_out |= parameters.colours(brdf.model.parameters) & zero - read
    else:  # a black material: something must be left to evaluate
        graph = brdf.model.graph
    if "asymmetry" in zero and brdf.inputs == "shape":  # its two features come last
        left_out.add("asymmetry")
        networks = {slot: _without_asymmetry(mlp) if mlp.n_folded else mlp for slot, mlp in networks.items()}
    gone = set(brdf.model.graph.slots) - set(graph.slots)
    compact = (c.without(gone, ("difference", "log_ratio") if "asymmetry" in left_out else ()) for c in brdf.distilled)
    model = dataclasses.replace(brdf.model, graph=graph)
    result = dataclasses.replace(brdf, model=model, modules=networks, distilled=tuple(c for c in compact if c))
    return result, frozenset(left_out)


def _zero_terms(brdf: EnhancedBRDF, zero: set[str]) -> list[str]:
    """Terms that are 0 because of a colour that nothing else reads."""
    terms = [node for node in brdf.model.graph.walk() if not node.args]
    colours = parameters.colours(brdf.model.parameters)
    result = []
    for node in terms:
        own = set(node.inputs)
        if own and own <= zero & colours and not any(own & set(other.inputs) for other in terms if other is not node):
            if not np.any(np.array(node.fn(**{name: mi.Color3f(0) for name in node.inputs}))):
                result.append(node.name)
    return result


def _without_asymmetry(mlp):
    """The network without its last two inputs."""
    (w, b), *rest = mlp.layers
    return dataclasses.replace(mlp, layers=((w[:, :-2], b), *rest)) if mlp.varies else mlp
