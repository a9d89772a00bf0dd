"""Fits of thousands of texels at once: every texel has parameters and samples of its own, all share the networks.

A few texels, the anchors, are fitted with care, from many starts. Where they end is where the others start, unless
their own analytic fit is better: materials on a surface resemble each other more than they resemble any library.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Sequence

import numpy as np
from tqdm import tqdm

from . import levenberg, parameters, prior, sampling
from .data import Measurements
from .enhance import EnhancedBRDF
from .fit import analytic_starts, require_rgb
from .maps import MaterialMaps
from .material import Material
from .objective import Objective, stacked

_LANES = 1 << 17  # samples fitted together: bounds the memory, 110 MB of Jacobian for ggx2
_ANCHORS = 32
_NEAREST = 8  # training materials an anchor starts from, besides its analytic fit
_SCREEN = 16  # samples by which starts are compared as they are
# Samples (None: all), starts of each texel that go on, most steps. Chosen on mixtures of MERL materials that training
# keeps aside.
_ANALYTIC = ((32, None, 4), (None, 2, 4), (None, 1, 15))
_CAREFUL = ((None, None, 10), (None, 2, 10), (None, 1, 30))
_QUICK = ((None, None, 4), (None, 1, 12))
_SWEEP = ((None, None, 0), (None, 1, 6))
_SWEEPS = 3

_AS_IT_IS = ((None, None, 0),)


def fit_texels(
    material: Material,
    wi: np.ndarray,
    wo: np.ndarray,
    f: np.ndarray,
    *,
    smoothness: float = 0.0,
    seed: int = 0,
    progress: bool = True,
) -> tuple[MaterialMaps, dict[str, np.ndarray]]:
    r"""Fit a material of its own to every texel of a surface.

    Parameters
    ----------
    material : Material
        A network (``Material.network()``) or an analytic model (``Material.analytic("ggx")``).
    wi, wo : array (S, 3), (H, W, S, 3) or (T, S, 3)
        Unit vectors towards viewer and light: the same for all texels, or of each.
    f : array (H, W, S, 3) or (T, S, 3)
        Reflectance of each texel, 1/sr without the cosine, linear RGB, at least 0. T texels become one row.
    smoothness : float
        At least 0. Above, a texel is pulled towards the mean of its neighbours: further sweeps add
        :math:`\frac{s L}{2P} \sum_p ((u_p - \bar u_p) / \sigma_p)^2` to its loss, with P optimised parameters u, their
        standard deviations :math:`\sigma` over the surface, and L the mean loss of all texels. At 1 a texel that
        differs from its neighbours as much as any two texels do pays half the mean loss for it.
    seed : int
        Of the choice of anchors and the order of samples.
    progress : bool
        Show bars.

    Returns
    -------
    maps : MaterialMaps
        All parameters that fits move; ``maps.material.report`` has the mean ``log_l1``, ``log_l1_analytic``,
        ``seconds``, ``seconds_per_1000``, ``n_texels``, ``n_samples``. Colours are as fitted, not normalised as those
        of :func:`mi_enhance.fit` are.
    errors : dict
        ``log_l1`` and ``log_l1_analytic`` (the model without networks), each (H, W).

    Raises
    ------
    ValueError
        For shapes or values that are not as above, or `smoothness` without a second dimension.
    RuntimeError
        If no JIT variant with RGB colours and gradients is active.

    Examples
    --------
    >>> from mi_enhance.data.sampling import sample_pairs
    >>> wi, wo = sample_pairs(64)
    >>> truth = [Material.analytic("ggx").edit(alpha_x=a, alpha_y=a) for a in (0.2, 0.4)]
    >>> f = np.stack([m.evaluate(wi, wo) for m in truth])
    >>> maps, errors = fit_texels(Material.analytic("ggx"), wi, wo, f, progress=False)
    >>> maps.shape, bool(errors["log_l1"].max() < 1e-3)
    ((1, 2), True)
    """
    require_rgb("fit_texels()")
    shape = _check(wi, wo, f, smoothness)
    start = time.perf_counter()
    rng = np.random.default_rng(seed)
    surface = _Surface(wi, wo, f, shape, rng, progress)
    material = material.exact
    brdf, analytic = material.brdf, EnhancedBRDF(material.brdf.model, {})
    space = parameters.Space(analytic.parameters)
    starts = space.to(analytic_starts(analytic))
    u, loss_analytic = surface.fit(analytic, lambda index: np.tile(starts, (len(index), 1, 1)), _ANALYTIC, "analytic")
    loss = loss_analytic
    if brdf.networks:
        space = parameters.Space(brdf.parameters)
        initial = parameters.flatten(brdf.parameters, parameters.initial(brdf.parameters))
        u = np.concatenate([u, np.tile(space.to(initial)[u.shape[1] :], (len(u), 1))], axis=1)
        u, loss = _enhanced(surface, material, u, loss_analytic, rng)
    if smoothness:
        u, loss = _smoothed(surface, brdf, u, loss, smoothness)
    seconds = time.perf_counter() - start
    report = {
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
    errors = {"log_l1": loss.reshape(shape), "log_l1_analytic": loss_analytic.reshape(shape)}
    return _maps(material, space.back(u).reshape(*shape, -1), report), errors


def log_l1_of_texels(maps: MaterialMaps, wi: np.ndarray, wo: np.ndarray, f: np.ndarray) -> np.ndarray:
    """Log-L1 (eq. 1) of every texel on given samples, such as some that the fit did not see.

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
    shape = _check(wi, wo, f, 0)
    if shape != maps.shape:
        raise ValueError(f"log_l1_of_texels(): f is for {shape} texels, the maps have {maps.shape}.")
    brdf = maps.material.brdf
    surface = _Surface(wi, wo, f, shape, np.random.default_rng(0), progress=False)
    columns = {name: np.broadcast_to(v, (*shape, len(v))) for name, v in maps.material.params.items()} | maps.maps
    u = np.concatenate([columns[p.name] for p in brdf.parameters], axis=2).reshape(len(surface.f), -1)
    u = parameters.Space(brdf.parameters).to(u.astype(np.float64))
    _, loss = surface.fit(brdf, lambda index: u[index][:, None], _AS_IT_IS, "")
    return loss.reshape(shape)


class _Surface:
    """Samples of T texels in a random order, and fits of any of them, as many at once as memory allows."""

    def __init__(self, wi, wo, f, shape, rng, progress):
        self.n, self.shape, self.progress = f.shape[-2], shape, progress
        order = rng.permutation(self.n)  # the first few are then a fair choice
        wi, wo, self.f = (np.asarray(a, np.float32)[..., order, :] for a in (wi, wo, f.reshape(-1, self.n, 3)))
        self.wi, self.wo = (a if a.ndim == 2 else a.reshape(self.f.shape) for a in (wi, wo))

    def problem(self, brdf: EnhancedBRDF, index: np.ndarray, n: int | None = None) -> Objective:
        """The loss of the texels `index`, which may repeat, on their first `n` samples."""
        return stacked(brdf, *(a[:n] if a.ndim == 2 else a[index, :n] for a in (self.wi, self.wo, self.f)))

    def fit(
        self,
        brdf: EnhancedBRDF,
        starts: Callable,
        stages: Sequence,
        label: str,
        index: np.ndarray | None = None,
        known: Callable | None = None,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Best parameters (T, P) and losses (T,) of the texels `index`, all by default.

        Parameters
        ----------
        brdf : EnhancedBRDF
        starts : callable
            ``starts(index) -> (T, K, P)``: K starts for each of T texels.
        stages : sequence of (samples, starts that go on, steps)
        label : str
            Of the progress bar.
        index : array, optional
        known : callable, optional
            ``known(index) -> Prior`` with a precision for each texel.
        """
        index = np.arange(len(self.f)) if index is None else index
        step = max(1, _LANES // self.n)
        found = []
        with tqdm(total=len(index), desc=label, unit="texel", disable=not self.progress, leave=False) as bar:
            for k in range(0, len(index), step):
                part = index[k : k + step]
                found.append(self._fit(brdf, part, starts(part), stages, known(part) if known else None))
                bar.update(len(part))
        return tuple(np.concatenate(parts) for parts in zip(*found, strict=True))

    def _fit(self, brdf, index, u, stages, known):
        space, losses = parameters.Space(brdf.parameters), None
        for n, survivors, steps in stages:
            t, k, p = u.shape
            if survivors is not None and survivors < k:
                best = np.argsort(losses, axis=1)[:, :survivors]
                u, k = np.take_along_axis(u, best[..., None], axis=1), survivors
            parts = []
            for row in np.array_split(np.arange(t * k), -(-t * k * min(n or self.n, self.n) // _LANES)):
                problem = self.problem(brdf, index[row // k], n)
                loss, equations = problem.loss, problem.normal_equations
                if known:
                    loss, equations = known.of(row // k).added(problem)
                flat = u.reshape(-1, p)[row]
                parts.append(levenberg.minimize(loss, equations, flat, space.low, space.high, steps=steps))
            flat, losses = (np.concatenate(v) for v in zip(*parts, strict=True))
            u, losses = flat.reshape(t, k, p), losses.reshape(t, k)
        best = losses.argmin(1)[:, None]
        u, losses = np.take_along_axis(u, best[..., None], 1)[:, 0], np.take_along_axis(losses, best, 1)[:, 0]
        return u, losses - (known.loss(u) if known else 0)

    def nearest(self, brdf: EnhancedBRDF, index: np.ndarray, candidates: np.ndarray, k: int) -> np.ndarray:
        """Those k of the candidates (M, P) that explain each texel best as they are, (T, k, P)."""
        losses, m = [], len(candidates)
        for part in np.array_split(index, -(-len(index) * m * _SCREEN // (4 * _LANES))):
            problem = self.problem(brdf, np.repeat(part, m), _SCREEN)
            losses.append(problem.loss(np.tile(candidates, (len(part), 1))).reshape(-1, m))
        return candidates[np.argsort(np.concatenate(losses), axis=1)[:, :k]]


def _enhanced(surface: _Surface, material: Material, u, loss_analytic, rng) -> tuple[np.ndarray, np.ndarray]:
    """Anchors first, then all texels, from their analytic fits `u`, completed."""
    brdf, known = material.brdf, None
    anchors = rng.choice(len(u), min(_ANCHORS, len(u)), replace=False)
    starts = lambda index: u[index][:, None]  # noqa: E731
    if material.library is not None:
        library = parameters.Space(brdf.parameters).to(np.asarray(material.library, np.float64))
        # Residuals with the Laplace distribution of the analytic model's, the channels of a sample not independent of
        # each other: so much a Gaussian weighs beside the mean of n of them.
        pull = prior.from_library(material, loss_analytic / surface.n)
        known = pull.of
        starts = lambda index: np.concatenate(  # noqa: E731
            [u[index][:, None], surface.nearest(brdf, index, library, _NEAREST)], axis=1
        )
    found, loss = surface.fit(brdf, starts, _CAREFUL, "anchors", anchors, known)
    if len(anchors) == len(u):
        order = np.argsort(anchors)
        return found[order], loss[order]

    def seen(index):
        return np.concatenate([u[index][:, None], surface.nearest(brdf, index, found, 1)], axis=1)

    return surface.fit(brdf, seen, _QUICK, "enhanced", known=known)


def _smoothed(surface: _Surface, brdf: EnhancedBRDF, u, loss, smoothness: float) -> tuple[np.ndarray, np.ndarray]:
    """Sweeps that pull every texel towards the mean of its neighbours; starts are the texel's own and that mean."""
    for sweep in range(_SWEEPS):
        mean = _neighbours(u.reshape(*surface.shape, -1)).reshape(u.shape)
        spread = u.std(0)
        # a parameter that is the same everywhere has nothing to be smoothed
        weight = np.divide(1, spread**2, out=np.zeros_like(spread), where=spread > 1e-9)
        pull = prior.Prior(mean, np.tile(np.diag(smoothness * loss.mean() / u.shape[1] * weight), (len(u), 1, 1)))
        starts = np.stack([u, mean], axis=1)
        u, loss = surface.fit(brdf, starts.__getitem__, _SWEEP, f"sweep {sweep + 1}", known=pull.of)
    return u, loss


def _neighbours(values: np.ndarray) -> np.ndarray:
    """Mean of the texels above, below, left and right, as far as there are any; (H, W, P).

    Examples
    --------
    >>> _neighbours(np.array([[[1.0], [2.0], [6.0]]]))[0, :, 0]
    array([2. , 3.5, 2. ])
    """
    padded = np.pad(np.concatenate([values, np.ones_like(values[..., :1])], axis=2), ((1, 1), (1, 1), (0, 0)))
    total = padded[:-2, 1:-1] + padded[2:, 1:-1] + padded[1:-1, :-2] + padded[1:-1, 2:]
    return total[..., :-1] / np.maximum(total[..., -1:], 1)  # 1: a surface of one texel has no neighbours


def _maps(material: Material, values: np.ndarray, report: dict) -> MaterialMaps:
    """Maps of what varies; the rest, and what decides sampling, is that of the mean over the surface."""
    parts = parameters.unflatten(material.brdf.parameters, np.moveaxis(values, 2, 0))
    base = material.edit(**{name: v.mean((1, 2)) for name, v in parts.items()})
    base = dataclasses.replace(base, report=report, library=None)
    base = dataclasses.replace(base, lobe_albedo=sampling.lobe_albedo(base))
    varying = {p.name for p in material.brdf.parameters if not p.fixed}
    return MaterialMaps(base, {name: np.moveaxis(v, 0, 2) for name, v in parts.items() if name in varying})


def _check(wi, wo, f, smoothness) -> tuple[int, int]:
    """Height and width in texels, or an error."""
    where = "fit_texels()"
    if f.ndim not in (3, 4) or f.shape[-1] != 3 or 0 in f.shape:
        raise ValueError(f"{where}: f has shape {f.shape}; (H, W, S, 3) or (T, S, 3) is needed, none of them 0.")
    for name, a in (("wi", wi), ("wo", wo)):
        if a.shape not in (f.shape, f.shape[-2:]):
            raise ValueError(f"{where}: {name} has shape {a.shape}; {f.shape[-2:]} or {f.shape} is needed.")
    bad = ~(np.isfinite(f) & (f >= 0))
    if bad.any():
        at = tuple(np.argwhere(bad)[0].tolist())
        raise ValueError(f"{where}: f{list(at)} is {f[at]}; it must be finite and >= 0. See data.clamp_negative().")
    full = np.broadcast_to(wi, f.shape), np.broadcast_to(wo, f.shape)
    wi, wo = (wi, wo) if wi.ndim == wo.ndim == 2 else (a.reshape(-1, 3) for a in full)
    Measurements(wi, wo, np.zeros_like(wi), where)  # checks the directions
    if not smoothness >= 0 or not np.isfinite(smoothness):
        raise ValueError(f"{where}: smoothness is {smoothness}; it must be a number >= 0.")
    if smoothness and f.ndim == 3:
        raise ValueError(f"{where}: smoothness needs neighbours: give f as (H, W, S, 3).")
    return f.shape[:2] if f.ndim == 4 else (1, f.shape[0])
