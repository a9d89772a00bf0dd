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
from ..neural.trainable import fused
from ..sampling import albedo
from .material import Material, roughnesses

_SAMPLES = 1 << 14
# Sine of the largest angle of the views whose mean an edit holds, 65 degrees: what a factor says at the horizon, where
# hardly anything is seen, must not decide how bright the rest is.
_SEEN = float(np.sin(np.radians(65)))


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
    terms = [] if material.factors_in_rgb else list(_terms(material))
    albedos = _albedos(material) if terms else []
    for k, slot, colour in terms:
        enhanced, analytic = (float(v[0]) for v in albedos[k])
        largest = params[colour.name].max()
        # 1e-6: a term that reflects nothing, or has no colour, has nothing to move
        if min(enhanced, analytic, largest) < 1e-6:
            continue
        scale = np.clip(min(enhanced / analytic, colour.high / largest), np.exp(-MAX_LOG), np.exp(MAX_LOG))
        params[colour.name] = params[colour.name] * scale
        params[f"norm_{slot}"] = np.array([-np.log(scale)])
    return _with_plain_factors(dataclasses.replace(material, params=params))


def _with_plain_factors(material: Material) -> Material:
    """The same BRDF, with the mean of every factor in RGB moved into the colour of its term, channel by channel."""
    factors = list(_factors(material))
    albedos = _albedos(material) if factors else []
    for k, slot, colour in factors:
        enhanced, analytic = albedos[k]
        value = material.params[colour.name]
        with np.errstate(divide="ignore", invalid="ignore"):
            scale = np.minimum(enhanced / analytic, colour.high / value)
        # 1e-6: a channel that reflects nothing, or has no colour, has nothing to move
        scale = np.where((enhanced < 1e-6) | (analytic < 1e-6) | (value < 1e-6), 1, scale)
        params = {**material.params, colour.name: value * scale}
        material = _shifted(dataclasses.replace(material, params=params), slot, -np.log(scale))
    return material


def reshaped(material: Material, before: Material) -> Material:
    """Return an edited material whose terms reflect, to their analytic ones, what they did before the edit.

    Factors were learned at one roughness. Elsewhere they extrapolate, and a paint would turn to silver; so their mean
    is held, channel by channel, and only their shape follows the edit. An edit that leaves the shape of the lobes
    changes nothing here.
    """
    brdf = before.brdf
    shape = [p.name for p in brdf.model.parameters if not p.is_colour and p.name not in parameters.FRAME]
    if all(np.array_equal(material.params[name], before.params[name]) for name in shape):
        return material
    known, now = brdf.reference or roughnesses(before.params), roughnesses(material.params)
    brdf = dataclasses.replace(brdf, reference=known if known != now else None)
    material = dataclasses.replace(material, brdf=brdf)
    factors = list(_factors(material))
    found = [_albedos(m, _SEEN) for m in (material, before)] if factors else []
    for k, slot, _ in factors:
        # 1e-9: a term may be 0
        after, then = (np.log(np.maximum(part[k][0], 1e-9) / np.maximum(part[k][1], 1e-9)) for part in found)
        material = _shifted(material, slot, then - after)
    return material


def _factors(material: Material) -> Iterator[tuple[int, str, parameters.Parameter]]:
    """Additive terms with one colour and a factor in RGB: number, slot, colour."""
    brdf = material.brdf
    slots = {slot for c in brdf.distilled if c.channels == 3 for slot in c.slots}
    if brdf.trunk and brdf.trunk.channels == 3 and not slots:
        slots = set(brdf.trunk.slots)
    colours = {p.name: p for p in brdf.model.parameters if p.is_colour}
    for k, term in enumerate(_parts(brdf.model.graph, "+")):
        own = [name for node in term.walk() for name in node.inputs or () if name in colours]
        found = [node.name for node in term.walk() if node.name in slots]
        if len(own) == 1 and len(found) == 1:
            yield k, found[0], colours[own[0]]


def _shifted(material: Material, slot: str, logs: np.ndarray) -> Material:
    """Return the material with numbers, one per channel, added to the logarithms of a factor."""
    brdf = material.brdf
    if brdf.distilled:
        distilled = tuple(c.shifted(slot, logs) if slot in c.slots else c for c in brdf.distilled)
        return dataclasses.replace(material, brdf=dataclasses.replace(brdf, distilled=distilled))
    assert brdf.trunk is not None
    if brdf.trunk.basis:
        norm = np.clip(material.params[f"norm_{slot}"] + logs, -MAX_LOG, MAX_LOG)
        return dataclasses.replace(material, params={**material.params, f"norm_{slot}": norm})
    read = material.params["read_out"].copy()
    numbers = read[brdf.trunk.numbers_of(slot)].reshape(len(logs), -1)  # a view
    numbers[:, -1] = np.clip(numbers[:, -1] + logs, -MAX_LOG, MAX_LOG)
    return dataclasses.replace(material, params={**material.params, "read_out": read})


def plain(material: Material) -> Material:
    """The same BRDF with every ``norm`` at 0, as fits work on it; colours are cut off at their range."""
    params = dict(material.params)
    for _, slot, colour in _terms(material):
        scale = np.exp(params[f"norm_{slot}"])
        params[colour.name] = np.clip(params[colour.name] * scale, colour.low, colour.high)
        params[f"norm_{slot}"] = np.zeros_like(params[f"norm_{slot}"])
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


def _albedos(material: Material, sine: float = 1.0) -> list[tuple[np.ndarray, np.ndarray]]:
    """Albedo in RGB, under even light up to that sine, of every additive term with colour 1: enhanced, analytic."""
    brdf = material.brdf
    params = material.as_drjit() | {name: mi.Color3f(1) for name in parameters.colours(brdf.model.parameters)}
    rng = np.random.default_rng(0)
    u = [mi.Float(rng.random(_SAMPLES).astype(np.float32)) for _ in range(5)]
    disk = mi.warp.square_to_uniform_disk_concentric(mi.Point2f(u[0], u[1])) * sine
    wi = mi.Vector3f(disk.x, disk.y, dr.safe_sqrt(1 - dr.squared_norm(disk)))
    even = albedo.even_shares(len(brdf.model.lobes(params)))
    wo, density = albedo.draw(wi, params, even, u[2:], brdf.model)
    graph, record, active = brdf.prepare(wi, wo, params, fused(brdf.networks))

    terms = [node(record) for g in (graph, brdf.model.graph) for node in _parts(g, "+")]
    values = [dr.select(active, albedo.reflected(c, wo, density), 0) for f in terms for c in mi.Color3f(f)]
    dr.eval(values)  # together: each alone would take the networks again
    means = np.array([dr.mean(v)[0] for v in values], np.float64).reshape(2, -1, 3)
    return list(zip(*means, strict=True))
