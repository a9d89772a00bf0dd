"""The sampling mixture of a material: the share of each lobe."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

from ..analytic import parameters
from ..analytic.lobes import without_absent
from ..analytic.models.model import Model
from .importance import _GGX

# Neither technique is ever left to chance alone: a share of 5 % bounds the weight of what the other one misses.
MIN_SHARE = 0.05


NODES = 8  # of a mixture, evenly spaced in the square root of the cosine


class Mixture(NamedTuple):
    """The shares that sample a material.

    :func:`mi_enhance.sampling.mixture_fit.fit_mixture` finds them; the file of the material keeps them.

    Parameters
    ----------
    scales : tuple of float
        Factor on the roughness of each lobe of the model.
    albedos : tuple of tuple of float
        For each lobe, and last for the cosine, at NODES angles of the view from the horizon up, or once if it is the
        same at all of them: its share is in proportion to this times its colour, so that edits of colours carry over.
    """

    scales: tuple[float, ...]
    albedos: tuple[tuple[float, ...], ...]


def of_lobe_albedo(n_lobes: int, lobe_albedo: float) -> Mixture:
    """Return the mixture of a material that has none of its own: shares in proportion to the albedos.

    Parameters
    ----------
    n_lobes : int
        Lobes of the model.
    lobe_albedo : float
        Albedo of all lobes for rho_s = 1, see :func:`mi_enhance.sampling.albedo.lobe_albedo`.

    Examples
    --------
    >>> of_lobe_albedo(1, 0.1).scales, [row[0] for row in of_lobe_albedo(1, 0.1).albedos]
    ((1.0,), [0.1, 1.0])
    """
    # 1e-6: as a fit, no lobe is left out for ever; its colour may be edited
    albedos = np.array([max(lobe_albedo, 1e-6)] * n_lobes + [1.0])
    return Mixture((1.0,) * n_lobes, tuple((float(v),) for v in albedos / albedos.max()))


def scaled(model: Model, lobes: Sequence[tuple]) -> Model:
    """The model with other lobes to sample: (index of the own lobe, factor on its roughness) of each.

    Examples
    --------
    >>> wide = scaled(_GGX, [(0, 2.0)])
    >>> wide.lobes({"rho_s": mi.Color3f(1), "alpha_x": mi.Float(0.1), "alpha_y": mi.Float(0.2)})[0][1:]
    ([0.2], [0.4])
    """
    colours = parameters.colours(model.parameters)

    def result(params):
        own = without_absent(model.lobes, colours, params)
        return [
            type(own[k])((own[k][0], *(dr.clip(a * c, *parameters.ROUGHNESS) for a in own[k][1:])))
            for k, c in lobes
            if own[k] is not None
        ]

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
    lobes = without_absent(model.lobes, parameters.colours(model.parameters), params)
    strengths = [lobe and lobe[0] for lobe in lobes] + [params.get("rho_d")]
    nodes = len(albedos) // len(strengths)
    x = dr.sqrt(dr.clip(cos, 0, 1)) * (nodes - 1)
    k = dr.minimum(mi.UInt32(x), max(nodes - 2, 0))

    def at(j):
        low = dr.gather(mi.Float, albedos, k + j * nodes if nodes > 1 else j)
        return dr.lerp(low, dr.gather(mi.Float, albedos, k + (j * nodes + 1)), x - mi.Float(k)) if nodes > 1 else low

    # 1e-6: a black material samples all alike
    weights = [(dr.mean(rho) + 1e-6) * at(j) for j, rho in enumerate(strengths) if rho is not None]
    n = len([rho for rho in strengths[:-1] if rho is not None])
    # 1e-12: both factors may be 1e-6
    free = (1 - MIN_SHARE * (n + 1)) / dr.maximum(sum(weights), 1e-12) if weights else 0
    return [MIN_SHARE + free * w for w in weights[:n]]


def shares(params: Mapping, lobe_albedo, model: Model = _GGX) -> list[mi.Float]:
    """Probability of drawing each lobe in a quadrature, the same at every view; the cosine has the rest.

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
    strengths = [dr.mean(rho_s) for rho_s, *_ in model.present_lobes(params)]
    if not strengths:
        return []
    diffuse = dr.mean(params["rho_d"]) if "rho_d" in params else 0
    specular = sum(strengths) * lobe_albedo
    # 1e-6: a black material samples the cosine, one without any lobe all of them alike
    total = dr.clip(specular / (specular + diffuse + 1e-6), MIN_SHARE * len(strengths), 1 - MIN_SHARE)
    free = total - MIN_SHARE * len(strengths)
    return [MIN_SHARE + free * (s + 1e-6) / (sum(strengths) + 1e-6 * len(strengths)) for s in strengths]
