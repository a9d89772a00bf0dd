"""The mixture that samples a fitted material with least variance: roughness of each lobe, shares over the angle.

For fixed lobes the second moment of f cos / pdf is a convex function of the shares, and for a given set of directions,
drawn once from a mixture that covers all candidates, everything but the shares is a constant.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import drjit as dr
import mitsuba as mi
import numpy as np

from ..neural import cooperative
from ..neural.enhanced_brdf import EnhancedBRDF
from ..numerics import sequences
from . import albedo, importance, lobe_mixture
from .lobe_mixture import MIN_SHARE, NODES, Mixture

_SCALES = (0.5, 0.7, 1.0, 1.4, 2.0, 3.0, 4.5)  # of the roughness of a lobe
_AZIMUTHS, _SAMPLES = 4, 1024  # of each cosine; directions of each view
_STEPS = 30
_DARK = 0.01  # a colour of 0 counts as this: its lobe, were it edited to 1, is then not all there is


def fit_mixture(brdf: EnhancedBRDF, params: Mapping) -> Mixture:
    """Find the mixture of least variance for a material, averaged over the angle of the view.

    Parameters
    ----------
    brdf : EnhancedBRDF
    params : dict
        Parameters of the material, one lane each, as of ``Material.as_drjit``.

    Returns
    -------
    Mixture
        Minimises the mean logarithm of the second moment of |f| cos / pdf; |f| is the norm of the three channels.

    References
    ----------
    Dupuy et al. 2015, *Extracting Microfacet-based BRDF Parameters from Arbitrary Materials with Power Iterations*, is
    what the paper (section 5.2) refits; this asks for the variance itself.

    Examples
    --------
    >>> from mi_enhance import Material
    >>> m = Material.analytic("ggx").edit(rho_d=0, rho_s=1)
    >>> len(fit_mixture(m.brdf, m.as_drjit()).scales)
    1
    """
    colours, g, densities = _tabulate(brdf, params)
    n_lobes = len(colours) - 1
    chosen = [_SCALES.index(1.0)] * n_lobes

    def columns(chosen):
        return densities[:, :, [k * len(_SCALES) + c for k, c in enumerate(chosen)] + [-1]]

    best = _shares(g, columns(chosen))
    for _ in range(2):  # one lobe after the other, twice: the second lobe decides what the first has to cover
        for k in range(n_lobes):
            for c in range(len(_SCALES)):
                trial = [*chosen[:k], c, *chosen[k + 1 :]]
                found = _shares(g, columns(trial))
                if found[1] < best[1] - 1e-3:  # what is hardly better is left as the model has it
                    chosen, best = trial, found
    free = (best[0] - MIN_SHARE) / (1 - MIN_SHARE * (n_lobes + 1))
    albedos = free / np.maximum(np.array(colours), _DARK)
    # 1e-6: no lobe is left out for ever; its colour may be edited
    albedos = np.maximum(albedos / albedos.max(1, keepdims=True), 1e-6)
    return Mixture(tuple(_SCALES[c] for c in chosen), tuple(map(tuple, albedos.T.round(6).tolist())))


def _tabulate(brdf: EnhancedBRDF, params: Mapping) -> tuple[list[float], np.ndarray, np.ndarray]:
    """Strengths of lobes and cosine; |f| cos, and the densities of all candidates, over that of the samples."""
    model = brdf.model
    lobes = model.lobes(params)
    colours = [float(dr.mean(rho)[0]) for rho, *_ in lobes] + [albedo.mean_of(params["rho_d"])]
    # candidates next to one another overlap: every other scale covers them all
    wide = lobe_mixture.scaled(model, [(k, c) for k in range(len(lobes)) for c in _SCALES[::2]])
    even = [mi.Float(1 / (len(lobes) * len(_SCALES[::2]) + 1))] * (len(lobes) * len(_SCALES[::2]))
    n = NODES * _AZIMUTHS * _SAMPLES
    k = dr.arange(mi.UInt32, n)
    u = sequences.even_numbers(n, k % _SAMPLES)
    view = k // _SAMPLES
    # 0.005: node 0 is the horizon itself
    cos = dr.maximum(dr.square(mi.Float(view // _AZIMUTHS) / (NODES - 1)), 0.005)
    sin, (s, c) = dr.safe_sqrt(1 - cos * cos), dr.sincos(mi.Float(view % _AZIMUTHS) * (dr.two_pi / _AZIMUTHS) + 0.4)
    wi = mi.Vector3f(sin * c, sin * s, cos)
    wo, q = albedo.draw(wi, params, even, u, wide)
    dr.eval(wi, wo, q)
    f = mi.Color3f(brdf(wi, wo, params, brdf.evaluators(cooperative.Cooperative)))
    g = albedo.reflected(dr.norm(f), wo, q)
    densities = [
        importance.pdf(wi, wo, params, [mi.Float(1)], lobe_mixture.scaled(model, [(k, c)]))
        for k in range(len(lobes))
        for c in _SCALES
    ] + [importance.pdf(wi, wo, params, [], dataclasses.replace(model, lobes=lambda _: []))]
    densities = [dr.select(q > 0, p / q, 0) for p in densities]
    dr.eval(g, densities)
    shape = NODES, _AZIMUTHS * _SAMPLES
    return colours, np.array(g).reshape(shape), np.stack([np.array(p).reshape(shape) for p in densities], -1)


def _shares(g: np.ndarray, p: np.ndarray) -> tuple[np.ndarray, float]:
    """Best shares (nodes, densities), and the mean logarithm of the second moment over the squared mean."""
    n = p.shape[2]
    free = np.full((len(g), n), 1 / n)
    square = np.square(g.astype(np.float64))
    for _ in range(_STEPS):
        w = MIN_SHARE + (1 - MIN_SHARE * n) * free
        # 1e-30: a direction below the horizon has no density, and no f
        total = np.maximum(np.einsum("jsn,jn->js", p, w), 1e-30)
        slope = np.einsum("js,jsn->jn", square / np.square(total), p)
        free = free * np.sqrt(slope + 1e-30)
        free /= free.sum(1, keepdims=True)
    w = MIN_SHARE + (1 - MIN_SHARE * n) * free
    moment = (square / np.maximum(np.einsum("jsn,jn->js", p, w), 1e-30)).mean(1)
    mean = np.maximum(np.square(g.mean(1, dtype=np.float64)), 1e-30)
    return w, float(np.log(np.maximum(moment / mean, 1e-30)).mean())
