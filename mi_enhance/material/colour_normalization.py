"""Colours that keep their meaning: what a network adds to or takes from a term's energy is moved out of the colour.

A fit cannot tell a bright colour under a dark network from a dark colour under a bright one. Afterwards each additive
term of the BRDF is scaled so that it reflects as much as the analytic term of the same parameters would: rho_d is then
the diffuse albedo, and rho_s what it is to GGX. The scale goes into ``norm_B``, ...; the BRDF stays the same.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import drjit as dr
import mitsuba as mi
import numpy as np

from ..analytic import parameters
from ..analytic.graph import Node
from ..analytic.parameters import MAX_LOG
from ..sampling import albedo
from .material import Material

_SAMPLES = 1 << 14


def normalize(material: Material) -> Material:
    """The same BRDF, with colours as the analytic model would need them to reflect as much.

    Parameters
    ----------
    material : Material
        Fitted; one without networks, or whose networks have no ``norm`` parameter, is returned as it is.

    Returns
    -------
    Material
        Where a colour would leave its range, the scale is only taken so far.
    """
    material = plain(material)
    params = dict(material.params)
    terms = list(_terms(material))
    albedos = _albedos(material) if terms else []
    for k, slot, colour in terms:
        enhanced, analytic = albedos[k]
        largest = params[colour.name].max()
        # 1e-6: a term that reflects nothing, or has no colour, has nothing to move
        if min(enhanced, analytic, largest) < 1e-6:
            continue
        scale = np.clip(min(enhanced / analytic, colour.high / largest), np.exp(-MAX_LOG), np.exp(MAX_LOG))
        params[colour.name] = params[colour.name] * scale
        params[f"norm_{slot}"] = np.array([-np.log(scale)])
    return dataclasses.replace(material, params=params)


def plain(material: Material) -> Material:
    """The same BRDF with every ``norm`` at 0, as fits work on it; colours are cut off at their range."""
    params = dict(material.params)
    for _, slot, colour in _terms(material):
        scale = np.exp(params[f"norm_{slot}"])
        params[colour.name] = np.clip(params[colour.name] * scale, colour.low, colour.high)
        params[f"norm_{slot}"] = np.zeros(1)
    return dataclasses.replace(material, params=params)


def _terms(material: Material) -> Iterator[tuple[int, str, parameters.Parameter]]:
    """Additive terms of the BRDF with one colour and a module that can be scaled: number, slot, colour."""
    colours = {p.name: p for p in material.brdf.model.parameters if p.is_colour}
    for k, term in enumerate(_parts(material.brdf.model.graph, "+")):
        slots = [n.name for n in _parts(term, "*") if f"norm_{n.name}" in material.params]
        own = [name for node in term.walk() for name in node.inputs or () if name in colours]
        operators = any(n.args and n.name in material.brdf.modules for n in term.walk())
        if slots and len(own) == 1 and not operators:  # a network of operands is not linear in them
            yield k, slots[0], colours[own[0]]


def _parts(node: Node, symbol: str) -> Iterator[Node]:
    """The summands ("+") or factors ("*") of a graph."""
    if node.symbol == symbol:
        for a in node.args:
            yield from _parts(a, symbol)
    else:
        yield node


def _albedos(material: Material) -> list[tuple[float, float]]:
    """Albedo under even light from all sides of every additive term with colour 1: enhanced, analytic."""
    brdf = material.brdf
    params = material.as_drjit() | {name: mi.Color3f(1) for name in parameters.colours(brdf.model.parameters)}
    rng = np.random.default_rng(0)
    u = [mi.Float(rng.random(_SAMPLES).astype(np.float32)) for _ in range(5)]
    wi = mi.warp.square_to_cosine_hemisphere(mi.Point2f(u[0], u[1]))
    even = albedo.even_shares(len(brdf.model.lobes(params)))
    wo, density = albedo.draw(wi, params, even, u[2:], brdf.model)
    graph, record, active = brdf.prepare(wi, wo, params)

    def mean(node):
        value = albedo.reflected(mi.Color3f(node(record)).x, wo, density)
        return float(dr.mean(dr.select(active, value, 0))[0])

    pairs = zip(_parts(graph, "+"), _parts(brdf.model.graph, "+"), strict=True)
    return [(mean(enhanced), mean(analytic)) for enhanced, analytic in pairs]
