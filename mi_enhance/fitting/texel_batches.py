"""The samples of all texels of a surface, and fits of any of them, as many at once as memory allows."""

from __future__ import annotations

import copy
import dataclasses
import functools
import tempfile
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from pathlib import Path

import mitsuba as mi
import numpy as np

from ..analytic.parameter_space import Space
from ..data.measurements import Measurements
from ..material.material import Material
from ..neural.enhanced_brdf import EnhancedBRDF
from ..system.progress import Callback, Progress, silent
from ..system.workers import alone, run_all
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
    executor : concurrent.futures.Executor, optional
        Who fits the batches; this process if left out.
    """

    def __init__(
        self,
        wi: np.ndarray,
        wo: np.ndarray,
        f: np.ndarray,
        rng: np.random.Generator,
        executor: Executor | None = None,
    ):
        self.n, self.executor = f.shape[-2], executor
        order = rng.permutation(self.n)
        wi, wo, self.f = (np.asarray(a, np.float32)[..., order, :] for a in (wi, wo, f.reshape(-1, self.n, 3)))
        self.wi, self.wo = (a if a.ndim == 2 else a.reshape(self.f.shape) for a in (wi, wo))

    def problem(self, brdf: EnhancedBRDF, index: np.ndarray, n_samples: int | None = None) -> Objective:
        """Return the loss of the texels `index`, which may repeat, on their first `n_samples` samples."""
        n = n_samples
        return stacked(brdf, *(a[:n] if a.ndim == 2 else a[index, :n] for a in (self.wi, self.wo, self.f)))

    def part(self, index: np.ndarray) -> TexelSamples:
        """Return the samples of the texels `index` alone, which another process can be given."""
        result = copy.copy(self)
        result.wi, result.wo = (a if a.ndim == 2 else a[index] for a in (self.wi, self.wo))
        result.f, result.executor = self.f[index], None
        return result

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
        step = max(1, multistart.LANES // self.n)
        parts = [index[k : k + step] for k in range(0, len(index), step)]

        def batch(k: int) -> _Batch:
            return _Batch(self.part(parts[k]), starts(parts[k]), known(parts[k]) if known else None)

        def tell(found: Mapping) -> None:
            if found:
                losses = list(found.values())[-1][1]
                n = sum(len(loss) for _, loss in found.values())
                progress(Progress(label, n, len(index), {"loss": float(losses.mean())}))

        if self.executor is None:
            found = list(run_all(lambda k: batch(k).fit(brdf, stages), range(len(parts)), tell=tell).values())
        else:
            batches = [batch(k) for k in range(len(parts))]
            run = functools.partial(_fit_elsewhere, _packed(brdf), mi.variant() or "", tuple(stages))
            done = run_all(run, batches, self.executor, tell)
            found = [done[one] for one in batches]
        u, losses = (np.concatenate(arrays) for arrays in zip(*found, strict=True))
        return u, losses


@dataclasses.dataclass(frozen=True, eq=False)
class _Batch:
    """Texels that are fitted together, and what they start from."""

    samples: TexelSamples
    starts: np.ndarray
    known: Prior | None

    def fit(self, brdf: EnhancedBRDF, stages: Sequence[multistart.Stage]) -> tuple[np.ndarray, np.ndarray]:
        """Return the best parameters and losses."""
        index, space = np.arange(len(self.samples.f)), Space(brdf.parameters)
        return multistart.minimize(self.samples, brdf, index, self.starts, stages, space=space, known=self.known)


def _fit_elsewhere(
    network: bytes, variant: str, stages: Sequence[multistart.Stage], batch: _Batch
) -> tuple[np.ndarray, np.ndarray]:
    """Fit one batch in a process that is given the BRDF as the file of a material."""
    with alone(variant):
        return batch.fit(_unpacked(network), stages)


def _packed(brdf: EnhancedBRDF) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "network.bsdf"
        Material(brdf, {}).save(path)
        return path.read_bytes()


@functools.lru_cache(4)
def _unpacked(network: bytes) -> EnhancedBRDF:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "network.bsdf"
        path.write_bytes(network)
        return Material.load(path).brdf


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
