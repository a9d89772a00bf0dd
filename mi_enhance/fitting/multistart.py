"""Fits from many starts on few samples, of which the best go on with more.

One function fits all: a material is a surface of one texel.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol

import numpy as np

from ..analytic.parameter_space import Space
from ..neural.enhanced_brdf import EnhancedBRDF
from ..numerics import levenberg_marquardt
from .library_prior import Prior
from .objective import Objective

LANES = 1 << 17  # samples fitted together: bounds the memory, 110 MB of Jacobian for ggx2


class Stage(NamedTuple):
    """A part of a fit from many starts.

    Parameters
    ----------
    n_samples : int or None
        Samples of each texel; all if None.
    survivors : int or None
        Starts of each texel that go on from the stage before; all if None.
    n_steps : int
        Most steps.
    """

    n_samples: int | None
    survivors: int | None
    n_steps: int


class Samples(Protocol):
    """The samples of T texels; :class:`mi_enhance.fitting.texel_batches.TexelSamples` is one."""

    n: int

    def problem(self, brdf: EnhancedBRDF, index: np.ndarray, n_samples: int | None = None) -> Objective:
        """Return the loss of the texels `index`, which may repeat, on their first `n_samples` samples."""


def minimize(
    samples: Samples,
    brdf: EnhancedBRDF,
    index: np.ndarray,
    u: np.ndarray,
    stages: Sequence[Stage],
    *,
    space: Space,
    known: Prior | None = None,
    tolerance: float = 1e-4,
    report: Callable[[Stage, int, np.ndarray], None] | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the best parameters (T, P) that are found for some texels, and their losses (T,) without the prior.

    Parameters
    ----------
    samples : Samples
    brdf : EnhancedBRDF
    index : array (T,)
        The texels.
    u : array (T, K, P)
        K starts of each, as `space` optimizes them.
    stages : sequence of Stage
    space : Space
    known : Prior, optional
        With a mean or precision for each of the T texels, or one for all.
    tolerance : float
        See :func:`mi_enhance.numerics.levenberg_marquardt.minimize`.
    report : callable, optional
        ``report(stage, step, losses)`` after every step of a batch.
    """
    losses: np.ndarray = np.zeros(u.shape[:2])
    for stage in stages:
        t, k, p = u.shape
        if stage.survivors is not None and stage.survivors < k:
            u, k = _best(u, losses, stage.survivors), stage.survivors
        n = min(stage.n_samples or samples.n, samples.n)
        parts = []
        for row in batches(np.arange(t * k), n):
            problem = samples.problem(brdf, index[row // k], n)
            loss, equations = known.of(row // k).added(problem) if known else (problem.loss, problem.normal_equations)
            parts.append(
                levenberg_marquardt.minimize(
                    loss,
                    equations,
                    u.reshape(-1, p)[row],
                    space.low,
                    space.high,
                    steps=stage.n_steps,
                    tolerance=tolerance,
                    callback=(lambda step, found, stage=stage: report(stage, step, found)) if report else None,
                )
            )
        flat, found = (np.concatenate(v) for v in zip(*parts, strict=True))
        u, losses = flat.reshape(t, k, p), found.reshape(t, k)
    best, losses = _best(u, losses, 1)[:, 0], losses.min(axis=1)
    return best, losses - (known.loss(best) if known else 0)


def nearest(
    samples: Samples, brdf: EnhancedBRDF, index: np.ndarray, candidates: np.ndarray, k: int, n_samples: int
) -> np.ndarray:
    """Return those k of the candidates (M, P) that explain each texel best as they are, (T, k, P).

    Parameters
    ----------
    samples : Samples
    brdf : EnhancedBRDF
    index : array (T,)
        The texels.
    candidates : array (M, P)
        Parameters as they are optimized, for example those of the training materials.
    k : int
    n_samples : int
        First samples of each texel that decide.
    """
    losses, m = [], len(candidates)
    # values alone take a quarter of the memory
    for part in batches(index, m * min(n_samples, samples.n) / 4):
        problem = samples.problem(brdf, np.repeat(part, m), n_samples)
        losses.append(problem.loss(np.tile(candidates, (len(part), 1))).reshape(-1, m))
    return candidates[np.argsort(np.concatenate(losses), axis=1)[:, :k]]


def batches(index: np.ndarray, lanes: float) -> list[np.ndarray]:
    """Divide problems of so many lanes each into as many at once as memory allows.

    Examples
    --------
    >>> [len(b) for b in batches(np.arange(5), LANES / 2)]
    [2, 2, 1]
    """
    return np.array_split(index, min(len(index), int(np.ceil(len(index) * lanes / LANES))))


def _best(u: np.ndarray, losses: np.ndarray, k: int) -> np.ndarray:
    """Return the k starts (T, k, P) of least loss of each texel."""
    return np.take_along_axis(u, np.argsort(losses, axis=1)[:, :k, None], axis=1)
