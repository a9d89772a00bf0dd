"""The samples of all texels of a surface, and fits of any of them, as many at once as memory allows."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ..analytic.parameter_space import Space
from ..data.measurements import Measurements
from ..neural.enhanced_brdf import EnhancedBRDF
from ..system.progress import Callback, Progress, silent
from . import multistart
from .library_prior import Prior
from .objective import Objective
from .problems import stacked


class TexelSamples:
    """Samples of T texels in a random order: the first few are a fair choice.

    Parameters
    ----------
    wi, wo : array (S, 3) or (..., S, 3)
        Directions, the same for all texels or of each.
    f : array (..., S, 3)
        Reflectance of each texel.
    rng : numpy.random.Generator
        For the order.
    """

    def __init__(self, wi: np.ndarray, wo: np.ndarray, f: np.ndarray, rng: np.random.Generator):
        self.n = f.shape[-2]
        order = rng.permutation(self.n)
        wi, wo, self.f = (np.asarray(a, np.float32)[..., order, :] for a in (wi, wo, f.reshape(-1, self.n, 3)))
        self.wi, self.wo = (a if a.ndim == 2 else a.reshape(self.f.shape) for a in (wi, wo))

    def problem(self, brdf: EnhancedBRDF, index: np.ndarray, n_samples: int | None = None) -> Objective:
        """Return the loss of the texels `index`, which may repeat, on their first `n_samples` samples."""
        n = n_samples
        return stacked(brdf, *(a[:n] if a.ndim == 2 else a[index, :n] for a in (self.wi, self.wo, self.f)))

    def fit(
        self,
        brdf: EnhancedBRDF,
        starts: Callable[[np.ndarray], np.ndarray],
        stages: Sequence[multistart.Stage],
        label: str,
        *,
        index: np.ndarray | None = None,
        known: Callable[[np.ndarray], Prior] | None = None,
        progress: Callback = silent,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the best parameters (T, P) and losses (T,) of the texels `index`, all by default.

        Parameters
        ----------
        brdf : EnhancedBRDF
        starts : callable
            ``starts(index) -> (T, K, P)``: K starts for each of T texels.
        stages : sequence of Stage
        label : str
            Name of this fit in what `progress` is told.
        index : array, optional
        known : callable, optional
            ``known(index) -> Prior`` with a precision for each texel.
        progress : callable, optional
            ``progress(Progress)`` after every batch, in texels.
        """
        index = np.arange(len(self.f)) if index is None else index
        space, step = Space(brdf.parameters), max(1, multistart.LANES // self.n)
        found = []
        for k in range(0, len(index), step):
            part = index[k : k + step]
            prior = known(part) if known else None
            found.append(multistart.minimize(self, brdf, part, starts(part), stages, space=space, known=prior))
            progress(Progress(label, k + len(part), len(index), {"loss": float(found[-1][1].mean())}))
        u, losses = (np.concatenate(parts) for parts in zip(*found, strict=True))
        return u, losses


def check(where: str, wi: np.ndarray, wo: np.ndarray, f: np.ndarray) -> tuple[int, int]:
    """Return height and width in texels, or raise a ValueError that begins with `where`.

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
