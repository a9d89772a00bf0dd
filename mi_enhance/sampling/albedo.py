"""Quadrature of f cos: directions drawn from the lobes of a BRDF and the cosine, each with the weight f cos / pdf."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import drjit as dr
import mitsuba as mi

from ..analytic.models.model import Model
from ..neural.enhanced_brdf import EnhancedBRDF
from ..numerics.sequences import even_numbers
from . import importance


def draw(
    wi: mi.Vector3f, params: Mapping, shares: Sequence, u: Sequence[mi.Float], model: Model
) -> tuple[mi.Vector3f, mi.Float]:
    """Draw directions of the light.

    Parameters
    ----------
    wi, params, shares, model
        As for :func:`mi_enhance.sampling.importance.sample`.
    u : sequence of 3 mi.Float
        Numbers in [0, 1), such as :func:`mi_enhance.numerics.sequences.even_numbers`.

    Returns
    -------
    wo : mi.Vector3f
    density : mi.Float
        In 1/sr; 0 where nothing is drawn.
    """
    wo = importance.sample(wi, params, shares, u[0], mi.Point2f(u[1], u[2]), model)
    return wo, importance.pdf(wi, wo, params, shares, model)


def reflected(f, wo: mi.Vector3f, density: mi.Float):
    """Return f cos / pdf for what :func:`draw` gave, whose mean is the albedo; 0 where nothing is drawn."""
    return dr.select(density > 0, f * wo.z / density, 0)


def even_shares(n_lobes: int) -> list[mi.Float]:
    """Return shares of which the lobes have half, all alike, and the cosine the other."""
    return [mi.Float(0.5 / n_lobes)] * n_lobes


def mean_of(colour: mi.Color3f) -> float:
    """Return the mean of a colour of one lane."""
    return sum(float(c[0]) for c in colour) / 3


def lobe_albedo(brdf: EnhancedBRDF, params: Mapping, n: int = 4096) -> float:
    """Return the albedo of the lobes for rho_s = 1 in all, at 30 degrees: it decides how often they are sampled.

    A rough number is enough (any is unbiased), so it is kept when rho_d or rho_s are edited.

    Parameters
    ----------
    brdf : EnhancedBRDF
    params : dict
        Parameters of the material, one lane each, as of ``Material.as_drjit``.
    n : int
        Samples of the estimate.

    Returns
    -------
    float
        At least 0.

    Examples
    --------
    >>> from mi_enhance import Material
    >>> m = Material.analytic("ggx").edit(F0=1.0, alpha_x=0.01, alpha_y=0.01)
    >>> round(lobe_albedo(m.brdf, m.as_drjit()), 2)
    1.0
    """
    wi = mi.Vector3f(0.5, 0, 0.8660254) + dr.zeros(mi.Vector3f, n)
    lobes = brdf.model.lobes(params)
    wo, density = draw(wi, params, even_shares(len(lobes)), even_numbers(n), brdf.model)
    total = dr.mean(reflected(dr.mean(brdf(wi, wo, params)), wo, density))[0]
    rho_s = sum(float(dr.mean(rho_s)[0]) for rho_s, *_ in lobes)
    return max(total - mean_of(params["rho_d"]), 0.0) / max(rho_s, 1e-6)  # 1e-6: without a lobe it does not matter
