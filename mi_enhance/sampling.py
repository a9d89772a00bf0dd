"""Importance sampling: a mixture of visible GGX normals and the cosine, with its exact density (paper, section 5.2).

The lobes are what the analytic model says of itself (``Model.lobes``), with the parameters of the enhanced one.
Mitsuba's own microfacet distribution draws visible normals (Heitz 2018); models that mask with V-cavities see theirs.
The cosine is that of the surface, which the integrand has, not that of a tilted normal: their ratio has no bound.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import drjit as dr
import mitsuba as mi

from .analytic import geometry, models, parameters, terms
from .analytic.models.model import Model
from .numerics.sequences import even_numbers

# Neither technique is ever left to chance alone: a share of 5 % bounds the weight of what the other one misses.
MIN_SHARE = 0.05
NODES = 8  # of a mixture, evenly spaced in the square root of the cosine

_GGX = models.ggx()


class Mixture(NamedTuple):
    """How a material is sampled: found by :func:`mi_enhance.mixture.mixture`, kept in its file.

    Parameters
    ----------
    scales : tuple of float
        Factor on the roughness of each lobe of the model.
    albedos : tuple of tuple of float
        For each lobe, and last for the cosine, at NODES angles of the view from the horizon up: its share is in
        proportion to this times its colour, so that edits of colours carry over.
    """

    scales: tuple[float, ...]
    albedos: tuple[tuple[float, ...], ...]


def scaled(model: Model, lobes: Sequence[tuple]) -> Model:
    """The model with other lobes to sample: (index of the own lobe, factor on its roughness) of each.

    Examples
    --------
    >>> wide = scaled(_GGX, [(0, 2.0)])
    >>> wide.lobes({"rho_s": mi.Color3f(1), "alpha_x": mi.Float(0.1), "alpha_y": mi.Float(0.2)})[0][1:]
    ([0.2], [0.4])
    """
    absent = dict.fromkeys(parameters.colours(model.parameters))

    def result(params):
        own = model.lobes({**absent, **params})
        # 1e-4 to 1: where Mitsuba's own microfacet distribution ends, and where there is nothing wider
        return [(own[k][0], *(dr.clip(a * c, 1e-4, 1) for a in own[k][1:])) for k, c in lobes if own[k][0] is not None]

    return dataclasses.replace(model, lobes=result)


def shares_at(cos: mi.Float, params: Mapping, albedos: mi.Float, model: Model) -> list[mi.Float]:
    """Probability of sampling each lobe at a view, for a :class:`Mixture`; the cosine has the rest.

    Parameters
    ----------
    cos : mi.Float, N lanes
        Cosine of the view to the surface's normal.
    params : dict
        As for :func:`shares`; a colour that is left out takes its lobe with it.
    albedos : mi.Float
        Those of the mixture, lobe after lobe.
    model : Model

    Returns
    -------
    list of mi.Float
        At least 0.05 each.
    """
    absent = dict.fromkeys(parameters.colours(model.parameters))
    strengths = [rho for rho, *_ in model.lobes({**absent, **params})] + [params.get("rho_d")]
    x = dr.sqrt(dr.clip(cos, 0, 1)) * (NODES - 1)
    k = dr.minimum(mi.UInt32(x), NODES - 2)
    weights = []
    for j, rho in enumerate(strengths):
        if rho is not None:
            ends = (dr.gather(mi.Float, albedos, k + (j * NODES + d)) for d in (0, 1))
            # 1e-6: a black material samples all alike
            weights.append((dr.mean(rho) + 1e-6) * dr.lerp(*ends, x - mi.Float(k)))
    n = len([rho for rho in strengths[:-1] if rho is not None])
    # 1e-12: both factors may be 1e-6
    free = (1 - MIN_SHARE * (n + 1)) / dr.maximum(sum(weights), 1e-12) if weights else 0
    return [MIN_SHARE + free * w for w in weights[:n]]


def shares(params: Mapping, lobe_albedo, model: Model = _GGX) -> list[mi.Float]:
    """Probability of sampling each lobe: its part of the albedo; the cosine has the rest.

    Parameters
    ----------
    params : dict
        Parameter values, 1 or N lanes; reads ``rho_d`` and what the model's lobes are made of. A colour that is left
        out counts as 0: such a lobe is not sampled.
    lobe_albedo : mi.Float or float
        Albedo of all lobes for rho_s = 1, at normal incidence (:func:`lobe_albedo`).
    model : Model
        The analytic model.

    Returns
    -------
    list of mi.Float
        At least 0.05 each, at most 0.95 together.
    """
    strengths = [dr.mean(rho_s) for rho_s, *_ in model.lobes(params)]
    if not strengths:
        return []
    diffuse = dr.mean(params["rho_d"]) if "rho_d" in params else 0
    specular = sum(strengths) * lobe_albedo
    # 1e-6: a black material samples the cosine, one without any lobe all of them alike
    total = dr.clip(specular / (specular + diffuse + 1e-6), MIN_SHARE * len(strengths), 1 - MIN_SHARE)
    free = total - MIN_SHARE * len(strengths)
    return [MIN_SHARE + free * (s + 1e-6) / (sum(strengths) + 1e-6 * len(strengths)) for s in strengths]


def sample(
    wi: mi.Vector3f, params: Mapping, shares, sample1: mi.Float, sample2: mi.Point2f, model: Model = _GGX
) -> mi.Vector3f:
    """Draw a direction towards the light.

    Parameters
    ----------
    wi : mi.Vector3f, N lanes
        Direction towards the viewer, surface frame, above the horizon.
    params : dict
        Parameter values; reads the frame and the roughness.
    shares : list of mi.Float
        Probability of each lobe, :func:`shares`.
    sample1, sample2 : mi.Float, mi.Point2f
        Uniform random numbers in [0, 1).
    model : Model
        The analytic model.

    Returns
    -------
    mi.Vector3f
        Unit vector; may lie below the horizon, where the BRDF is 0.

    References
    ----------
    Heitz and d'Eon 2014, *Importance Sampling Microfacet-Based BSDFs using the Distribution of Visible Normals*: a
    V-cavity has two sides, n and its mirror image about the normal, seen in proportion to their projected areas.
    """
    lobes = model.lobes(params)
    # On the rim of the unit square Mitsuba's visible normals are NaN: one direction of eight million.
    sample2 = dr.clip(sample2, 1e-7, 1 - 1e-7)
    cosine = mi.warp.square_to_cosine_hemisphere(sample2)
    if not lobes:
        return cosine
    frame = geometry.frame_of(params)
    local = frame.to_local(wi)
    view = dr.select(local.z > 0, local, mi.Vector3f(0, 0, 1))
    # One distribution whose roughness is that of the lobe drawn: its code stands in the kernel once.
    _, a_x, a_y = lobes[0]
    first, share = mi.Float(0), shares[0]  # where the interval of the lobe in sample1 begins, and its length
    for (_, b_x, b_y), own in zip(lobes[1:], shares[1:], strict=True):
        later = sample1 >= first + share
        a_x, a_y, first, share = (
            dr.select(later, *v) for v in ((b_x, a_x), (b_y, a_y), (first + share, first), (own, share))
        )
    if model.v_cavity:
        # All normals. Mitsuba takes the sine from the cosine: at alpha 0.01 slopes below a tenth of it come in steps.
        (sin, cos), slope = dr.sincos(dr.two_pi * sample2.y), dr.sqrt(sample2.x / (1 - sample2.x))
        normal = dr.normalize(mi.Vector3f(a_x * slope * cos, a_y * slope * sin, 1))
        other = mi.Vector3f(-normal.x, -normal.y, normal.z)
        seen, hidden = (dr.maximum(dr.dot(view, side), 0) for side in (normal, other))
        # (sample1 - first) / share is uniform in [0, 1) where the lobe is drawn at all
        normal = dr.select((sample1 - first) * (seen + hidden) < share * seen, normal, other)
    else:
        distribution = mi.MicrofacetDistribution(mi.MicrofacetType.GGX, a_x, a_y, True)
        normal = mi.Vector3f(distribution.sample(view, sample2)[0])
    reflected = 2 * dr.dot(local, normal) * normal - local
    drawn = sample1 < first + share
    return dr.select(drawn, frame.to_world(reflected), cosine)


def pdf(wi: mi.Vector3f, wo: mi.Vector3f, params: Mapping, shares, model: Model = _GGX) -> mi.Float:
    """Density of :func:`sample` in 1/sr, 0 below either horizon; same arguments.

    References
    ----------
    Heitz 2018, *Sampling the GGX Distribution of Visible Normals*, eqs. (3) and (17).
    """
    q, active = geometry.local_quantities(wi, wo, params)
    local_i, local_o, h = q["wi"], q["wo"], q["h"]
    density = (1 - sum(shares)) * mi.warp.square_to_cosine_hemisphere_pdf(wo)
    for (_, a_x, a_y), share in zip(model.lobes(params), shares, strict=True):
        # G1 D (h.wi) / cos_theta_i, over the Jacobian 4 (h.wi) of the reflection; written without h.wi, which rounds to
        # 0 or below at grazing angles and would leave a mirror direction without density.
        if model.v_cavity:
            # G1 = min(1, 2 h.n cos_theta_i / h.wi); h.wi is half the length of wi + wo, 1e-7 keeps it out of 0 / 0
            h_wi = dr.maximum(dr.norm(local_i + local_o) / 2, 1e-7)
            visible = dr.minimum(dr.rcp(4 * local_i.z), h.z / (2 * h_wi))
        else:
            root = dr.sqrt(dr.square(local_i.z) + dr.square(a_x * local_i.x) + dr.square(a_y * local_i.y))
            visible = dr.rcp(2 * (local_i.z + root))
        density += share * terms.D_ggx(h, a_x, a_y) * visible
    return dr.select(active, density, 0)


def lobe_albedo(material, n: int = 4096) -> float:
    """Albedo of the lobes for rho_s = 1 in all at 30 degrees, which decides how often they are sampled.

    A rough number is enough (any is unbiased), so it is kept when rho_d or rho_s are edited.

    Parameters
    ----------
    material : Material
        Fitted material; needs a JIT variant.
    n : int
        Samples of the estimate.

    Returns
    -------
    float
        At least 0.
    """
    params = material.lanes()
    u = even_numbers(n)
    wi = mi.Vector3f(0.5, 0, 0.8660254) + dr.zeros(mi.Vector3f, n)
    model = material.brdf.model
    lobes = model.lobes(params)
    even = [mi.Float(0.5 / len(lobes))] * len(lobes)
    wo = sample(wi, params, even, u[0], mi.Point2f(u[1], u[2]), model)
    p = pdf(wi, wo, params, even, model)
    f = material.brdf(wi, wo, params)
    total = dr.mean(dr.select(p > 0, dr.mean(f) * wo.z / p, 0))[0]
    rho_d = float(material.params["rho_d"].mean())
    rho_s = sum(float(dr.mean(rho_s)[0]) for rho_s, *_ in lobes)
    return max(total - rho_d, 0.0) / max(rho_s, 1e-6)  # 1e-6: without a lobe the number does not matter
