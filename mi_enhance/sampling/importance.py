"""Importance sampling: a mixture of visible GGX normals and the cosine, with its exact density (paper, section 5.2).

The lobes are what the analytic model says of itself (``Model.lobes``), with the parameters of the enhanced one.
Mitsuba's own microfacet distribution draws visible normals (Heitz 2018); models that mask with V-cavities see theirs.
The cosine is that of the surface, which the integrand has, not that of a tilted normal: their ratio has no bound.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import drjit as dr
import mitsuba as mi

from ..analytic import geometry, models, terms
from ..analytic.lobes import AroundBack
from ..analytic.models.model import Model

_GGX = models.ggx()


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
    lobes = model.present_lobes(params)
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
    back: Any = mi.Mask(isinstance(lobes[0], AroundBack))  # type: ignore[operator]
    for lobe, own in zip(lobes[1:], shares[1:], strict=True):
        later, (_, b_x, b_y) = sample1 >= first + share, lobe
        around = mi.Mask(isinstance(lobe, AroundBack))  # type: ignore[operator]
        back = dr.select(later, around, back)
        a_x, a_y, first, share = (
            dr.select(later, *v) for v in ((b_x, a_x), (b_y, a_y), (first + share, first), (own, share))
        )
    if any(isinstance(lobe, AroundBack) for lobe in lobes):
        # The light lies around the viewer as it does around the mirror direction of the viewer's mirror image.
        local = dr.select(back, _mirrored(local), local)
        view = dr.select(back, _mirrored(view), view)
    if model.v_cavity:
        # All normals. Mitsuba takes the sine from the cosine: at alpha 0.01 slopes below a tenth of it come in steps.
        (sin, cos), slope = dr.sincos(dr.two_pi * sample2.y), dr.sqrt(sample2.x / (1 - sample2.x))
        normal = dr.normalize(mi.Vector3f(a_x * slope * cos, a_y * slope * sin, 1))
        other = mi.Vector3f(-normal.x, -normal.y, normal.z)
        seen, hidden = (dr.maximum(dr.dot(view, side), 0) for side in (normal, other))  # type: ignore[arg-type]
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
    local_i, local_o = q["wi"], q["wo"]
    density = (1 - sum(shares)) * mi.warp.square_to_cosine_hemisphere_pdf(wo)
    for lobe, share in zip(model.present_lobes(params), shares, strict=True):
        _, a_x, a_y = lobe
        h, viewer = q["h"], local_i
        if isinstance(lobe, AroundBack):
            h, viewer = geometry.back_vector(local_i, local_o)[0], _mirrored(local_i)
        # G1 D (h.wi) / cos_theta_i, over the Jacobian 4 (h.wi) of the reflection; written without h.wi, which rounds to
        # 0 or below at grazing angles and would leave a mirror direction without density.
        if model.v_cavity:
            # G1 = min(1, 2 h.n cos_theta_i / h.wi); h.wi is half the length of wi + wo, 1e-7 keeps it out of 0 / 0
            h_wi = dr.maximum(dr.norm(viewer + local_o) / 2, 1e-7)
            visible = dr.minimum(dr.rcp(4 * local_i.z), h.z / (2 * h_wi))
        else:
            root = dr.sqrt(dr.square(local_i.z) + dr.square(a_x * local_i.x) + dr.square(a_y * local_i.y))
            visible = dr.rcp(2 * (local_i.z + root))
        density += share * terms.D_ggx(h, a_x, a_y) * visible
    return dr.select(active, density, 0)


def _mirrored(w: mi.Vector3f) -> mi.Vector3f:
    """Return the mirror image of a direction about the normal."""
    return mi.Vector3f(-w.x, -w.y, w.z)
