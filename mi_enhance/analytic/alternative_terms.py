"""Analytic terms that can stand in for one another, so that parts of several models compete at a slot.

The paper leaves this to future work (section 3, last paragraph); :mod:`mi_enhance.hypercube.search` tries them beside networks.
"""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Callable, Mapping

import numpy as np

from . import geometry, terms
from . import parameters as p
from .models.abc import alpha_of_abc
from .models.model import Model, renamed


@dataclasses.dataclass(frozen=True)
class Alternative:
    """An analytic term, and what it needs to take another's place.

    Parameters
    ----------
    term : callable
        From :mod:`mi_enhance.analytic.terms`.
    parameters : tuple of Parameter
        Those it may bring along.
    start : callable
        ``start(values) -> dict``: values of these parameters with which it resembles the usual term of the slot most,
        from the values of the model's own, arrays (M,).
    roughness : callable, optional
        ``roughness(params) -> alpha`` of the GGX lobe that covers it, if its width is not alpha_x, alpha_y.
    """

    term: Callable
    parameters: tuple[p.Parameter, ...] = ()
    start: Callable[[Mapping], dict] = lambda values: {}
    roughness: Callable | None = None


def _abc_like_ggx(values: Mapping) -> dict:
    """1 + B x = 1 + (1/alpha^2 - 1) sin^2(theta_h) for small angles."""
    return {"B": 2 * (1 / (values["alpha_x"] * values["alpha_y"]) - 1), "C": np.full_like(values["alpha_x"], 2)}


def _ior_of_f0(values: Mapping) -> dict:
    root = np.sqrt(np.clip(values["F0"], 0, 0.96))  # 0.96: an index of 100, where the range of `ior` ends
    return {"ior": (1 + root) / (1 - root)}


ALTERNATIVES = {
    "D_ggx": Alternative(terms.D_ggx),
    "D_beckmann": Alternative(terms.D_beckmann),
    "D_ward": Alternative(terms.D_ward),
    "D_abc_normalised": Alternative(
        terms.D_abc_normalised, (p.ABC_B, p.ABC_C), _abc_like_ggx, lambda q: alpha_of_abc(q["B"], q["C"])
    ),
    "F_schlick": Alternative(terms.F_schlick, (p.F0,), lambda values: {"F0": np.full_like(values["alpha_x"], 0.04)}),
    "F_cook_torrance": Alternative(terms.F_cook_torrance, (p.F0,)),
    "F_dielectric": Alternative(terms.F_dielectric, (p.IOR,), _ior_of_f0),
    "G_smith_ggx": Alternative(terms.G_smith_ggx),
    "G_v_cavity": Alternative(terms.G_v_cavity),
    "inv_E": Alternative(terms.inv_E),
    "inv_E_pi": Alternative(terms.inv_E_pi),
    "inv_E_ward": Alternative(terms.inv_E_ward),
}


def get(name: str) -> Alternative:
    """Return the alternative called `name`; KeyError with the choices if there is none."""
    if name not in ALTERNATIVES:
        raise KeyError(f'alternatives: unknown term "{name}". Choose one of: {", ".join(ALTERNATIVES)}.')
    return ALTERNATIVES[name]


def with_terms(model: Model, chosen: Mapping[str, str]) -> Model:
    """The model with other analytic terms in some slots.

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
        model = _with_term(model, slot, get(name), name)
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
    if alternative.roughness:
        lobes = _lobes_with(model.lobes, 1 if slot.endswith("2") else 0, alternative, own)
    return dataclasses.replace(
        model,
        graph=graph,
        parameters=(*model.parameters, *brought),
        extra=(*model.extra, *(q.name for q in brought)),
        lobes=lobes,
    )


def own_names(model: Model, slot: str, alternative: Alternative) -> dict[str, str]:
    """What the arguments of a term are called in the model: those of a second lobe end in 2, if there are such."""
    names = list(inspect.signature(alternative.term).parameters)
    if not slot.endswith("2"):
        return {n: n for n in names}
    usual = {q.name for q in model.parameters if q.name not in model.extra}
    second = {n for n in usual if n.endswith("2")}
    brought = {q.name for q in alternative.parameters if q.name not in usual}
    return {n: f"{n}2" if f"{n}2" in second or n in brought else n for n in names}


def start(model: Model, slot: str, name: str, values: Mapping) -> dict:
    """Values of the parameters that a term brings, (M,) each, so that it resembles the usual one; clipped to range."""
    alternative = get(name)
    own = own_names(model, slot, alternative)
    usual = {n: values.get(f"{n}2", v) if slot.endswith("2") else v for n, v in values.items()}
    ranges = {q.name: q for q in alternative.parameters}
    return {
        own[n]: np.clip(v, ranges[n].low, ranges[n].high)
        for n, v in alternative.start(usual).items()
        if own[n] not in values
    }


def _lobes_with(lobes: Callable, k: int, alternative: Alternative, own: Mapping[str, str]) -> Callable:
    """The lobes of a model, the k-th with the roughness of another distribution."""

    def changed(params):
        result = list(lobes(params))
        alpha = alternative.roughness({n: params[o] for n, o in own.items() if o in params})
        result[k] = (result[k][0], alpha, alpha)
        return result

    return changed
