"""Fits of thousands of texels at once: every texel has parameters and samples of its own, all share the networks.

A few texels, the anchors, are fitted with care, from many starts. Where they end is where the others start, unless
their own analytic fit is better: materials on a surface resemble each other more than they resemble any library.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable
from concurrent.futures import Executor

import numpy as np

from ..analytic import parameter_space, parameters
from ..material.low_rank import of_low_rank
from ..material.material import Material
from ..material.material_maps import MaterialMaps
from ..neural.enhance import trunk_start
from ..neural.enhanced_brdf import EnhancedBRDF
from ..sampling import albedo
from ..system.progress import Callback, silent
from ..system.variants import require_rgb
from . import library_prior
from .analytic_fit import analytic_starts
from .fit import check_material
from .multistart import Stage, nearest
from .report import TexelReport
from .texel_batches import TexelSamples, check

_ANCHORS = 32
_NEAREST = 8  # training materials an anchor starts from, besides its analytic fit
_SCREEN = 16  # samples by which starts are compared as they are
# Chosen on mixtures of MERL materials that training keeps aside.
_ANALYTIC = (Stage(32, None, 4), Stage(None, 2, 4), Stage(None, 1, 15))
_CAREFUL = (Stage(None, None, 10), Stage(None, 2, 10), Stage(None, 1, 30))
_QUICK = (Stage(None, None, 4), Stage(None, 1, 12))
_SWEEP = (Stage(None, None, 0), Stage(None, 1, 6))
# The smoothness of each sweep over that asked for. A strong pull first moves whole regions into one minimum: with the
# last one from the beginning, borders between minima that explain the samples equally well stay where they are.
_SWEEPS = (10.0, 3.0, 1.0)
_AS_IT_IS = (Stage(None, None, 0),)

_Known = Callable[[np.ndarray], library_prior.Prior]  # of texels by their index


@dataclasses.dataclass(frozen=True, eq=False)
class TexelFit:
    """Result of :func:`fit_texels`.

    Parameters
    ----------
    maps : MaterialMaps
        All parameters that fits move. Colours are as fitted, not normalized as those of
        :func:`mi_enhance.fitting.fit.fit` are. ``maps.material.report`` is `report`.
    log_l1, log_l1_analytic : array (H, W)
        Eq. 1 of each texel, and that of the model without neural modules.
    report : TexelReport
        Means, seconds and sizes.
    """

    maps: MaterialMaps
    log_l1: np.ndarray
    log_l1_analytic: np.ndarray
    report: TexelReport


def fit_texels(
    material: Material,
    wi: np.ndarray,
    wo: np.ndarray,
    f: np.ndarray,
    *,
    smoothness: float = 0.0,
    seed: int = 0,
    executor: Executor | None = None,
    progress: Callback = silent,
) -> TexelFit:
    r"""Fit a material of its own to every texel of a surface.

    Parameters
    ----------
    material : Material
        A network (``Material.pretrained()``) or an analytic model (``Material.analytic("ggx")``). Of a network with
        free read-outs the form of low rank is fitted.
    wi, wo : array (S, 3), (H, W, S, 3) or (T, S, 3)
        Unit vectors towards viewer and light: the same for all texels, or of each.
    f : array (H, W, S, 3) or (T, S, 3)
        Reflectance of each texel, 1/sr without the cosine, linear RGB, at least 0. T texels become one row.
    smoothness : float
        At least 0. Above, a texel is pulled towards the mean of its neighbours: further sweeps add
        :math:`\frac{s L}{2P} \sum_p ((u_p - \bar u_p) / \sigma_p)^2` to its loss, with P optimized parameters u, their
        standard deviations :math:`\sigma` over the surface, and L the mean loss of all texels. At 1 a texel that
        differs from its neighbours as much as any two texels do pays half the mean loss for it. The first sweeps pull
        ten and three times as much. Give 3 where neighbours are of similar material and maps are interpolated in
        renders: more than half of the seams between minima go.
    seed : int
        Of the choice of anchors and the order of samples.
    executor : concurrent.futures.Executor, optional
        Who fits the batches of texels: processes, or a Dask cluster (``Client(address).get_executor(pure=False)``),
        which does the work of a killed worker again. This process if left out. The result is the same.
    progress : callable, optional
        ``progress(Progress)`` after every batch of texels.

    Returns
    -------
    TexelFit

    Raises
    ------
    ValueError
        For shapes or values that are not as above, `smoothness` without a second dimension, or a material with
        a read-out of its own.
    RuntimeError
        If no JIT variant with RGB colours and gradients is active.

    Examples
    --------
    >>> from mi_enhance.data.directions import sample_pairs
    >>> wi, wo = sample_pairs(64)
    >>> truth = [Material.analytic("ggx").edit(alpha_x=a, alpha_y=a) for a in (0.2, 0.4)]
    >>> f = np.stack([m.evaluate(wi, wo) for m in truth])
    >>> found = fit_texels(Material.analytic("ggx"), wi, wo, f)
    >>> found.maps.shape, bool(found.log_l1.max() < 1e-3)
    ((1, 2), True)
    """
    require_rgb("fit_texels()")
    check_material(material, "fit_texels()")
    wi, wo, f = (np.asarray(a) for a in (wi, wo, f))
    shape = check("fit_texels()", wi, wo, f)
    if not smoothness >= 0 or not np.isfinite(smoothness):
        raise ValueError(f"fit_texels(): smoothness is {smoothness}; it must be a number >= 0.")
    if smoothness and f.ndim == 3:
        raise ValueError("fit_texels(): smoothness needs neighbours: give f as (H, W, S, 3).")
    start = time.perf_counter()
    rng = np.random.default_rng(seed)
    surface = TexelSamples(wi, wo, f, rng, executor)
    material = of_low_rank(material.unspecialized, "fit_texels()")
    brdf, analytic = material.brdf, EnhancedBRDF(material.brdf.model, {})
    space = parameter_space.Space(analytic.parameters)
    starts = space.to_free(analytic_starts(analytic))
    u, loss_analytic = surface.fit(
        analytic, lambda index: np.tile(starts, (len(index), 1, 1)), _ANALYTIC, "analytic", progress=progress
    )
    loss, known = loss_analytic, None
    if brdf.networks:
        space = parameter_space.Space(brdf.parameters)
        initial = parameters.flatten(brdf.parameters, parameters.initial(brdf.parameters))
        first = np.tile(initial, (len(u), 1))
        first[:, : u.shape[1]] = parameter_space.Space(analytic.parameters).to_physical(u)
        u = space.to_free(trunk_start(brdf, first) if brdf.trunk else first)
        known = _known(material, loss_analytic / surface.n)
        u, loss = _enhanced(surface, material, u, known, rng, progress)
    if smoothness:
        u, loss = _smoothed(surface, brdf, shape, u, loss, known, smoothness, progress)
    seconds = time.perf_counter() - start
    report: TexelReport = {
        "model": str(brdf),
        "log_l1": float(loss.mean()),
        "log_l1_analytic": float(loss_analytic.mean()),
        "seconds": seconds,
        "seconds_per_1000": 1000 * seconds / len(u),
        "n_texels": len(u),
        "n_samples": surface.n,
        "smoothness": float(smoothness),
        "seed": seed,
    }
    maps = _maps(material, space.to_physical(u).reshape(*shape, -1), report)
    return TexelFit(maps, loss.reshape(shape), loss_analytic.reshape(shape), report)


def log_l1_of_texels(maps: MaterialMaps, wi: np.ndarray, wo: np.ndarray, f: np.ndarray) -> np.ndarray:
    """Return the log-L1 (eq. 1) of every texel on given samples, such as some that the fit did not see.

    Parameters
    ----------
    maps : MaterialMaps
    wi, wo, f : arrays
        As for :func:`fit_texels`, f of shape (H, W, S, 3).

    Returns
    -------
    array (H, W)

    Examples
    --------
    >>> m = Material.analytic("ggx")
    >>> maps = MaterialMaps(m, {"F0": np.full((1, 2, 1), 0.04)})
    >>> up = np.array([[0, 0, 1.0]])
    >>> log_l1_of_texels(maps, up, up, np.tile(m.evaluate(up, up), (1, 2, 1, 1))).round(6)
    array([[0., 0.]])
    """
    shape = check("log_l1_of_texels()", wi, wo, f)
    if shape != maps.shape:
        raise ValueError(f"log_l1_of_texels(): f is for {shape} texels, the maps have {maps.shape}.")
    brdf = maps.material.brdf
    surface = TexelSamples(wi, wo, f, np.random.default_rng(0))
    vectors = maps.as_vectors().reshape(len(surface.f), -1)
    u = parameter_space.Space(brdf.parameters).to_free(vectors.astype(np.float64))
    _, loss = surface.fit(brdf, lambda index: u[index][:, None], _AS_IT_IS, "")
    return loss.reshape(shape)


def _known(material: Material, weight: np.ndarray) -> _Known | None:
    """Return the prior of texels by their index: a Gaussian over the training materials, of weight mean |r| / n.

    The n residuals r of a texel are taken to have a Laplace distribution of the size they have for the analytic model,
    the channels of a sample not to be independent of each other.
    """
    return (lambda index: library_prior.from_library(material, weight[index])) if material.library is not None else None


def _enhanced(
    surface: TexelSamples,
    material: Material,
    u: np.ndarray,
    known: _Known | None,
    rng: np.random.Generator,
    progress: Callback,
) -> tuple[np.ndarray, np.ndarray]:
    """Fit the anchors first, then all texels, from their analytic fits `u`, completed."""
    brdf = material.brdf
    anchors = rng.choice(len(u), min(_ANCHORS, len(u)), replace=False)
    library = None
    if material.library is not None:
        library = parameter_space.Space(brdf.parameters).to_free(np.asarray(material.library, np.float64))

    def with_nearest(candidates: np.ndarray | None, k: int) -> Callable[[np.ndarray], np.ndarray]:
        """Return starts: a texel's own, and the k candidates that explain it best."""

        def starts(index: np.ndarray) -> np.ndarray:
            own = u[index][:, None]
            if candidates is None:
                return own
            return np.concatenate([own, nearest(surface, brdf, index, candidates, k, _SCREEN)], axis=1)

        return starts

    found, loss = surface.fit(
        brdf, with_nearest(library, _NEAREST), _CAREFUL, "anchors", index=anchors, known=known, progress=progress
    )
    if len(anchors) == len(u):
        order = np.argsort(anchors)
        return found[order], loss[order]
    return surface.fit(brdf, with_nearest(found, 1), _QUICK, "enhanced", known=known, progress=progress)


def _smoothed(
    surface: TexelSamples,
    brdf: EnhancedBRDF,
    shape: tuple[int, int],
    u: np.ndarray,
    loss: np.ndarray,
    known: _Known | None,
    smoothness: float,
    progress: Callback,
) -> tuple[np.ndarray, np.ndarray]:
    """Sweep over the surface, pulling every texel towards the mean of its neighbours, from its own values and that."""
    for sweep, factor in enumerate(_SWEEPS, 1):
        mean = _neighbours(u.reshape(*shape, -1)).reshape(u.shape)
        spread = u.std(0)
        # a parameter that is the same everywhere has nothing to be smoothed
        weight = np.divide(1, spread**2, out=np.zeros_like(spread), where=spread > 1e-9)
        precision = np.diag(factor * smoothness * loss.mean() / u.shape[1] * weight)

        def pull(index, mean=mean, precision=precision):
            neighbours = library_prior.Prior(mean[index], precision)
            return neighbours + known(index) if known else neighbours

        starts = np.stack([u, mean], axis=1)
        label = f"sweep {sweep}"
        u, loss = surface.fit(brdf, starts.__getitem__, _SWEEP, label, known=pull, progress=progress)
    return u, loss


def _neighbours(values: np.ndarray) -> np.ndarray:
    """Return the mean of the texels above, below, left and right, as far as there are any; (H, W, P).

    Examples
    --------
    >>> _neighbours(np.array([[[1.0], [2.0], [6.0]]]))[0, :, 0]
    array([2. , 3.5, 2. ])
    """
    padded = np.pad(np.concatenate([values, np.ones_like(values[..., :1])], axis=2), ((1, 1), (1, 1), (0, 0)))
    total = padded[:-2, 1:-1] + padded[2:, 1:-1] + padded[1:-1, :-2] + padded[1:-1, 2:]
    return total[..., :-1] / np.maximum(total[..., -1:], 1)  # 1: a surface of one texel has no neighbours


def _maps(material: Material, values: np.ndarray, report: TexelReport) -> MaterialMaps:
    """Return maps of what varies; the rest, and what decides sampling, is that of the mean over the surface."""
    parts = parameters.unflatten(material.brdf.parameters, np.moveaxis(values, 2, 0))
    # not an edit, which holds what factors in RGB reflect
    params = {**material.params, **{name: v.mean((1, 2)) for name, v in parts.items()}}
    base = dataclasses.replace(material, params=params, report={**report}, library=None)
    base = dataclasses.replace(base, lobe_albedo=albedo.lobe_albedo(base.brdf, base.as_drjit()))
    varying = {p.name for p in material.brdf.parameters if not p.fixed}
    return MaterialMaps(base, {name: np.moveaxis(v, 0, 2) for name, v in parts.items() if name in varying})
