"""Models in which other analytic terms stand in some slots, so that parts of several models compete at a slot.

The paper leaves this to future work (section 3, last paragraph); :mod:`mi_enhance.hypercube.search` tries them beside
modules.
"""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Callable, Mapping

import numpy as np

from . import geometry
from .lobes import AroundBack, Lobe, of_slot
from .models.model import Model, renamed
from .terms.registry import ALTERNATIVES, Alternative, get

__all__ = ["ALTERNATIVES", "Alternative", "get", "own_names", "start", "with_terms"]


def with_terms(model: Model, chosen: Mapping[str, str]) -> Model:
    """Return the model with other analytic terms in some slots.

    Parameters
    ----------
    model : Model
    chosen : dict of str to str
        Slot -> name in :data:`ALTERNATIVES`. In a slot of a second lobe ("D2") a term reads that lobe's parameters.

    Returns
    -------
    Model
        With the parameters that the terms bring appended to its own.

    Raises
    ------
    KeyError
        For an unknown slot or term.
    ValueError
        If a term needs a parameter that neither the model has nor the term brings.

    Examples
    --------
    >>> from mi_enhance import models
    >>> print(with_terms(models.get("ggx"), {"D": "D_beckmann", "F": "F_dielectric"}))
    M + S * D_beckmann * F_dielectric * G * 1/E
    """
    for slot, name in chosen.items():
        model = _with_term(model, slot, get(name, slot), name)
    return dataclasses.replace(model, terms={**model.terms, **chosen})


def _with_term(model: Model, slot: str, alternative: Alternative, name: str) -> Model:
    if model.graph.find(slot).args:
        raise ValueError(f'alternatives: "{slot}" of model "{model.name}" is an operator; a term cannot stand there.')
    own = own_names(model, slot, alternative)
    known = {q.name for q in model.parameters}
    brought = tuple(
        dataclasses.replace(q, name=own[q.name]) for q in alternative.parameters if own[q.name] not in known
    )
    missing = {n for n in own.values() if n not in known} - {q.name for q in brought} - geometry.QUANTITIES.keys()
    if missing:
        raise ValueError(
            f'alternatives: {name} needs {", ".join(sorted(missing))}, which model "{model.name}" does not have.'
        )
    graph = model.graph.exchange(renamed(slot, alternative.term, own, name))
    lobes = model.lobes
    if alternative.roughness or alternative.around_back:
        lobes = _lobes_with(model.lobes, of_slot(slot), alternative, own)
    return dataclasses.replace(
        model,
        graph=graph,
        parameters=(*model.parameters, *brought),
        extra=(*model.extra, *(q.name for q in brought)),
        lobes=lobes,
    )


def own_names(model: Model, slot: str, alternative: Alternative) -> dict[str, str]:
    """Return the names in the model of a term's arguments: in a second lobe, those of its own parameters."""
    lobe = of_slot(slot)
    usual = {q.name for q in model.parameters if q.name not in model.extra}
    brought = {q.name for q in alternative.parameters if q.name not in usual}
    names = inspect.signature(alternative.term).parameters
    return {n: lobe.own(n) if lobe.own(n) in usual or n in brought else n for n in names}


def start(model: Model, slot: str, name: str, values: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Compute values of the parameters that a term brings, with which it resembles the usual term of the slot.

    Parameters
    ----------
    model : Model
    slot, name : str
        The term called `name` is put there.
    values : dict of str to array (M,)
        Parameters of the model without that term.

    Returns
    -------
    dict of str to array (M,)
        Clipped to range.
    """
    alternative, lobe = get(name, slot), of_slot(slot)
    own = own_names(model, slot, alternative)
    usual = {n: values.get(lobe.own(n), v) for n, v in values.items()}
    ranges = {q.name: q for q in alternative.parameters}
    return {
        own[n]: np.clip(v, ranges[n].low, ranges[n].high)
        for n, v in alternative.start(usual).items()
        if own[n] not in values
    }


def _lobes_with(
    lobes: Callable[[Mapping], list[tuple]], lobe: Lobe, alternative: Alternative, own: Mapping[str, str]
) -> Callable[[Mapping], list[tuple]]:
    """Return the function `lobes` with another roughness, or another place, of one of them."""

    def changed(params: Mapping) -> list[tuple]:
        result = list(lobes(params))
        values = result[lobe.index]
        if alternative.roughness:
            alpha = alternative.roughness({n: params[o] for n, o in own.items() if o in params})
            values = (values[0], alpha, alpha)
        result[lobe.index] = AroundBack(values) if alternative.around_back else values
        return result

    return changed
