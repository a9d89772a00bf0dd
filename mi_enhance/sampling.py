"""Importance sampling: a mixture of visible GGX normals and the cosine, with its exact density (paper, section 5.2).

The lobe is that of the analytic model with the parameters of the enhanced one. Mitsuba's own microfacet distribution
draws the normals (Heitz 2018). The cosine is that of the surface, which the integrand has, not that of a tilted normal:
their ratio has no bound.
"""

from __future__ import annotations

from collections.abc import Mapping

import drjit as dr
import mitsuba as mi

from . import geometry, terms

# Neither technique is ever left to chance alone: a share of 5 % bounds the weight of what the other one misses.
_MIN_SHARE = 0.05


def specular_share(params: Mapping, lobe_albedo) -> mi.Float:
    """Probability of sampling the lobe: its part of the albedo.

    Parameters
    ----------
    params : dict
        Parameter values, 1 or N lanes; reads ``rho_d`` and ``rho_s``.
    lobe_albedo : mi.Float or float
        Albedo of the lobe for rho_s = 1, at normal incidence (:func:`lobe_albedo`).

    Returns
    -------
    mi.Float
        In [0.05, 0.95].
    """
    diffuse, specular = (dr.mean(c) for c in (params["rho_d"], params["rho_s"]))
    specular = specular * lobe_albedo
    # 1e-6: a black material samples the cosine
    return dr.clip(specular / (specular + diffuse + 1e-6), _MIN_SHARE, 1 - _MIN_SHARE)


def sample(wi: mi.Vector3f, params: Mapping, share, sample1: mi.Float, sample2: mi.Point2f) -> mi.Vector3f:
    """Draw a direction towards the light.

    Parameters
    ----------
    wi : mi.Vector3f, N lanes
        Direction towards the viewer, surface frame, above the horizon.
    params : dict
        Parameter values; reads the frame and the roughness.
    share : mi.Float
        Probability of the lobe, :func:`specular_share`.
    sample1, sample2 : mi.Float, mi.Point2f
        Uniform random numbers in [0, 1).

    Returns
    -------
    mi.Vector3f
        Unit vector; may lie below the horizon, where the BRDF is 0.
    """
    frame = geometry.frame(params["n_x"], params["n_y"], params["t_theta"])
    local = frame.to_local(wi)
    normal, _ = _distribution(params).sample(dr.select(local.z > 0, local, mi.Vector3f(0, 0, 1)), sample2)
    reflected = 2 * dr.dot(local, normal) * mi.Vector3f(normal) - local
    return dr.select(sample1 < share, frame.to_world(reflected), mi.warp.square_to_cosine_hemisphere(sample2))


def pdf(wi: mi.Vector3f, wo: mi.Vector3f, params: Mapping, share) -> mi.Float:
    """Density of :func:`sample` in 1/sr, 0 below either horizon; same arguments.

    References
    ----------
    Heitz 2018, *Sampling the GGX Distribution of Visible Normals*, eqs. (3) and (17).
    """
    frame = geometry.frame(params["n_x"], params["n_y"], params["t_theta"])
    local_i, local_o = frame.to_local(wi), frame.to_local(wo)
    active = (wi.z > 0) & (wo.z > 0) & (local_i.z > 0) & (local_o.z > 0)
    local_i, local_o = (dr.select(active, w, mi.Vector3f(0, 0, 1)) for w in (local_i, local_o))
    h = dr.normalize(local_i + local_o)
    # G1 D (h.wi) / cos_theta_i, over the Jacobian 4 (h.wi) of the reflection; written without h.wi, which rounds to 0
    # or below at grazing angles and would leave a mirror direction without density.
    a_x, a_y = params["alpha_x"], params["alpha_y"]
    root = dr.sqrt(dr.square(local_i.z) + dr.square(a_x * local_i.x) + dr.square(a_y * local_i.y))
    lobe = terms.D_ggx(h, a_x, a_y) / (2 * (local_i.z + root))
    cosine = mi.warp.square_to_cosine_hemisphere_pdf(wo)
    return dr.select(active, dr.lerp(cosine, lobe, share), 0)


def _distribution(params: Mapping) -> mi.MicrofacetDistribution:
    return mi.MicrofacetDistribution(mi.MicrofacetType.GGX, params["alpha_x"], params["alpha_y"], True)


def lobe_albedo(material, n: int = 4096) -> float:
    """Albedo of the lobe for rho_s = 1 at 30 degrees, which decides how often it is sampled.

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
    from . import parameters

    values = [mi.Float(float(v)) for v in material.vector()]
    params = parameters.unflatten(material.brdf.parameters, values)
    # Roberts 2018, R3 sequence: three coordinates that fill the cube evenly
    u = [0.5 + a * dr.arange(mi.Float, n) for a in (0.8191725134, 0.6710436067, 0.5497004779)]
    u = [v - dr.floor(v) for v in u]
    wi = mi.Vector3f(0.5, 0, 0.8660254) + dr.zeros(mi.Vector3f, n)
    share = mi.Float(0.5)
    wo = sample(wi, params, share, u[0], mi.Point2f(u[1], u[2]))
    p = pdf(wi, wo, params, share)
    f = material.brdf(wi, wo, params)
    total = dr.mean(dr.select(p > 0, dr.mean(f) * wo.z / p, 0))[0]
    rho_d, rho_s = float(material.params["rho_d"].mean()), float(material.params["rho_s"].mean())
    return max(total - rho_d, 0.0) / max(rho_s, 1e-6)  # 1e-6: without a lobe the number does not matter
