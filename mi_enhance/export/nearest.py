"""The nearest parameters of another model: least log-L1, as all fits of this package, from several starts.

A model is a NumPy function of pairs of directions and named numbers, all inside boxes. It is minimized by the package's
Levenberg-Marquardt with differences for derivatives: a dozen unknowns need no more.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from ..data.directions import sample_pairs
from ..data.functions import Function, values
from ..numerics import levenberg_marquardt
from ..system.progress import Callback, Progress, silent
from .microfacets import Pairs

_STAGES = ((1024, None, 15), (4096, 3, 30))  # pairs, starts that are left, steps
_STEP = 1e-4  # of a difference, as a share of the box
_CHECKED = 50_000  # pairs that the error is stated for, none of them among the fitted ones


class Unknown(NamedTuple):
    """A number or a colour of a model and the box it lies in."""

    name: str
    low: float = 0.0
    high: float = 1.0
    start: float = 0.5
    size: int = 1


class OtherModel(NamedTuple):
    """A model of another program.

    Parameters
    ----------
    name : str
        For messages.
    unknowns : tuple of Unknown
    starts : tuple of dict
        Values that differ from those of the unknowns, each a place to start from.
    evaluate : callable
        ``evaluate(pairs, values) -> f``, (K, N, 3) in 1/sr for numbers (K, 1) and colours (K, 1, 3) by name.
    """

    name: str
    unknowns: tuple[Unknown, ...]
    starts: tuple[dict[str, float], ...]
    evaluate: Callable[[Pairs, Mapping[str, Any]], np.ndarray]


class Nearest(NamedTuple):
    """What was found: the values by name, a number or a list of three, and the error of them."""

    values: dict[str, Any]
    log_l1: float


def nearest(model: OtherModel, f: Function, *, seed: int = 0, progress: Callback = silent) -> Nearest:
    """Return the parameters of `model` that come nearest to the reflectance f.

    Parameters
    ----------
    model : OtherModel
    f : callable
        ``f(wi, wo) -> array (N, 3)``, f_r in 1/sr.
    seed : int
        Of the pairs of directions, uniform in Rusinkiewicz angles.
    progress : callable, optional
        Hears of every step.

    Returns
    -------
    Nearest
        Its `log_l1` is of pairs that were not fitted.

    Examples
    --------
    >>> grey = Unknown("grey")
    >>> lambert = lambda p, v: np.repeat((v["grey"] / np.pi + 0 * p.cos_i)[..., None], 3, -1)
    >>> model = OtherModel("lambert", (grey,), ({},), lambert)
    >>> round(nearest(model, lambda wi, wo: np.full((len(wi), 3), 0.2 / np.pi)).values["grey"], 3)
    0.2
    """
    low = _vector(model.unknowns, {u.name: u.low for u in model.unknowns})
    high = _vector(model.unknowns, {u.name: u.high for u in model.unknowns})
    base = {u.name: u.start for u in model.unknowns}
    u = np.array([_vector(model.unknowns, {**base, **start}) for start in model.starts])
    losses = np.zeros(len(u))
    for n, left, steps in _STAGES:
        problem = _Problem(model, f, n, seed, high - low, high)
        u = u[np.argsort(losses)[:left]]
        tell = lambda step, best, n=n, steps=steps: progress(  # noqa: E731
            Progress(f"{model.name}, {n} pairs", step + 1, steps, {"loss": float(best.min())})
        )
        u, losses = levenberg_marquardt.minimize(
            problem.loss, problem.normal_equations, u, low, high, steps=steps, callback=tell
        )
    best = u[int(np.argmin(losses))]
    named = _named(model.unknowns, best[None])
    found = {name: float(v[0, 0]) if v.ndim == 2 else v[0, 0].tolist() for name, v in named.items()}
    return Nearest(found, error(model, found, f, seed=seed + 1))


def error(model: OtherModel, found: Mapping[str, Any], f: Function, *, seed: int = 1) -> float:
    """Return the log-L1 of `model` with the values `found` against f."""
    problem = _Problem(model, f, _CHECKED, seed, np.ones(1), np.ones(1))
    return float(problem.loss(_vector(model.unknowns, found)[None])[0])


class _Problem:
    """The loss on n pairs, as :func:`mi_enhance.numerics.levenberg_marquardt.minimize` takes it."""

    def __init__(self, model: OtherModel, f: Function, n: int, seed: int, width: np.ndarray, high: np.ndarray):
        wi, wo = sample_pairs(n, seed=seed)
        self._model, self._pairs = model, Pairs.of(wi, wo)
        self._truth = np.log1p(np.maximum(values(f, wi, wo, "nearest()"), 0) * self._pairs.cos_o[:, None])
        self._step, self._high = _STEP * width, high

    def _residuals(self, u: np.ndarray) -> np.ndarray:
        """Return (K, 3 N) for parameters (K, P)."""
        f = self._model.evaluate(self._pairs, _named(self._model.unknowns, u))
        return (np.log1p(f * self._pairs.cos_o[:, None]) - self._truth).reshape(len(u), -1)

    def loss(self, u: np.ndarray) -> np.ndarray:
        return np.abs(self._residuals(u)).mean(1)

    def normal_equations(self, u: np.ndarray, epsilon: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        n_starts, n_unknowns = u.shape
        step = np.where(u + self._step > self._high, -self._step, self._step)  # away from the upper bound
        moved = u[:, None] + step[:, None] * np.eye(n_unknowns)
        r = self._residuals(u)
        # one start at a time: all of them would fill the memory
        slopes = np.stack([(self._residuals(m) - a) / s[:, None] for m, a, s in zip(moved, r, step, strict=True)])
        smooth = np.sqrt(r**2 + epsilon[:, None] ** 2)
        weighted = slopes / smooth[:, None]
        h = weighted @ slopes.transpose(0, 2, 1) / r.shape[1]
        return h, np.einsum("bpm,bm->bp", weighted, r) / r.shape[1], smooth.mean(1)


def _vector(unknowns: Sequence[Unknown], given: Mapping[str, Any]) -> np.ndarray:
    return np.concatenate([np.broadcast_to(np.asarray(given[u.name], np.float64), u.size) for u in unknowns])


def _named(unknowns: Sequence[Unknown], u: np.ndarray) -> dict[str, np.ndarray]:
    """Return numbers (K, 1) and colours (K, 1, 3) by name for vectors (K, P)."""
    result, k = {}, 0
    for one in unknowns:
        result[one.name] = u[:, k : k + 1] if one.size == 1 else u[:, None, k : k + one.size]
        k += one.size
    return result
