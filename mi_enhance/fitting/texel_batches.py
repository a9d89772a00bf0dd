"""The samples of all texels of a surface, and fits of any of them, as many at once as memory allows."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from tqdm import tqdm

from ..analytic import parameter_space
from ..data.measurements import Measurements
from ..neural.enhanced_brdf import EnhancedBRDF
from ..numerics import levenberg_marquardt
from .objective import Objective, stacked

_LANES = 1 << 17  # samples fitted together: bounds the memory, 110 MB of Jacobian for ggx2
_SCREEN = 16  # samples by which starts are compared as they are


class TexelSamples:
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
        space, losses = parameter_space.Space(brdf.parameters), None
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
                parts.append(levenberg_marquardt.minimize(loss, equations, flat, space.low, space.high, steps=steps))
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


def check(where: str, wi: np.ndarray, wo: np.ndarray, f: np.ndarray) -> tuple[int, int]:
    """Height and width in texels, or a ValueError that begins with `where`.

    Parameters
    ----------
    where : str
    wi, wo, f : array
        As for :func:`mi_enhance.fitting.fit_texels.fit_texels`.
    """
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
    return f.shape[:2] if f.ndim == 4 else (1, f.shape[0])
