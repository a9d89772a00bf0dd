"""Directional albedos by quadrature."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi

from ..numerics.sequences import even_numbers
from .importance import pdf, sample


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
    params = material.as_drjit()
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
