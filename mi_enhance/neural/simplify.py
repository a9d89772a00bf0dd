"""Leave out everything a material does not need: terms that are 0, the frame of the surface, features that are 0.

Exact: the BRDF that is left gives the same values for the parameters it was made for.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import mitsuba as mi
import numpy as np

from ..analytic import parameters
from ..analytic.models.model import Model
from .enhanced_brdf import EnhancedBRDF
from .inputs import ASYMMETRIC, names_of_directions
from .mlp import MLP


def simplify(brdf: EnhancedBRDF, values: Mapping[str, np.ndarray]) -> tuple[EnhancedBRDF, frozenset[str]]:
    """Leave out all that changes nothing for the given parameters.

    Parameters
    ----------
    brdf : EnhancedBRDF
    values : dict of str to array
        Parameters that are known: the same everywhere on the surface, and not being optimized.

    Returns
    -------
    brdf : EnhancedBRDF
        Without the terms that are 0 and their modules.
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
    modules, trunk = dict(brdf.modules), brdf.trunk
    graph = brdf.model.graph.without(_zero_terms(brdf, zero), modules)
    if graph is not None:
        modules = {slot: mlp for slot, mlp in modules.items() if slot in graph.slots}
        read = {name for node in graph.walk() for name in node.inputs}
        left_out |= parameters.colours(brdf.model.parameters) & zero - read
    else:  # a black material: something must be left to evaluate
        graph = brdf.model.graph
    if "asymmetry" in zero:
        left_out.add("asymmetry")
        modules = {slot: _without_asymmetry(mlp, brdf.model, brdf.inputs, slot) for slot, mlp in modules.items()}
        if trunk:
            mlp = _without_asymmetry(trunk.mlp, brdf.model, brdf.inputs, trunk.slots[0])
            trunk = dataclasses.replace(trunk, mlp=mlp)
    gone = set(brdf.model.graph.slots) - set(graph.slots)
    kept = (c.without(gone, ASYMMETRIC if "asymmetry" in left_out else ()) for c in brdf.distilled)
    model = dataclasses.replace(brdf.model, graph=graph)
    distilled = tuple(c for c in kept if c)
    result = dataclasses.replace(brdf, model=model, modules=modules, trunk=trunk, distilled=distilled)
    return result, frozenset(left_out)


def _zero_terms(brdf: EnhancedBRDF, zero: set[str]) -> list[str]:
    """Return the terms that are 0 because of a colour that nothing else reads."""
    terms = [node for node in brdf.model.graph.walk() if not node.args]
    colours = parameters.colours(brdf.model.parameters)
    result = []
    for node in terms:
        own = set(node.inputs)
        if own and own <= zero & colours and not any(own & set(other.inputs) for other in terms if other is not node):
            if not np.any(np.array(node.fn(**{name: mi.Color3f(0) for name in node.inputs}))):
                result.append(node.name)
    return result


def _without_asymmetry(mlp: MLP, model: Model, inputs: str, slot: str) -> MLP:
    """Return the module of a slot without the features that are 0 where asymmetry is; an operator has none."""
    if not (mlp.n_folded and mlp.varies):
        return mlp
    (w, b), *rest = mlp.layers
    names = names_of_directions(model, inputs, model.graph.find(slot))
    keep = [*range(mlp.n_folded), *(mlp.n_folded + k for k, name in enumerate(names) if name not in ASYMMETRIC)]
    return dataclasses.replace(mlp, layers=((w[:, keep], b), *rest))
