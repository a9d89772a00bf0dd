"""The record that every fit takes: pairs of directions and reflectance."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ..system.checks import unit_vectors


@dataclass(frozen=True, eq=False)
class Measurements:
    """N samples of one BRDF: pairs of directions and the reflectance measured there.

    Parameters
    ----------
    wi, wo : array (N, 3)
        Unit vectors towards the viewer and towards the light, above the horizon (z > 0). Kept as float32.
    f : array (N, 3)
        Reflectance f_r in 1/sr without the cosine, linear RGB, >= 0. Kept as float32.
    name : str
        The material.
    source : str
        One line: which reader, which file, what was left out.
    clamped_fraction : float
        Share of the 3 N values that were negative in the source and are 0 here.

    Raises
    ------
    ValueError
        If a shape, a value or a direction is not as above; the message names the first bad sample.

    Examples
    --------
    >>> m = Measurements([[0, 0, 1]], [[0, 0.6, 0.8]], [[0.1, 0.2, 0.3]], "paper", "by hand")
    >>> m
    Measurements(name='paper', source='by hand', clamped_fraction=0.0)
    >>> m.f.shape
    (1, 3)
    """

    wi: np.ndarray = field(repr=False)
    wo: np.ndarray = field(repr=False)
    f: np.ndarray = field(repr=False)
    name: str = "unnamed"
    source: str = ""
    clamped_fraction: float = 0.0

    def __post_init__(self) -> None:
        with np.errstate(over="ignore"):  # a float64 beyond the float32 range becomes inf, which is refused below
            for key in ("wi", "wo", "f"):
                object.__setattr__(self, key, np.ascontiguousarray(getattr(self, key), dtype=np.float32))
        where = f'Measurements("{self.name}")'
        shapes = self.wi.shape, self.wo.shape, self.f.shape
        if len(set(shapes)) > 1 or self.f.ndim != 2 or self.f.shape[1] != 3:
            raise ValueError(f"{where}: wi, wo and f have shapes {shapes}; all three must be (N, 3).")
        if len(self.f) == 0:
            raise ValueError(f"{where}: no sample at all; at least one is needed.")
        for key in ("wi", "wo", "f"):
            _refuse(where, key, getattr(self, key), ~np.isfinite(getattr(self, key)).all(axis=1), "must be finite")
        for key in ("wi", "wo"):
            a = getattr(self, key)
            unit_vectors(a, key, where)
            _refuse(where, key, a, a[:, 2] <= 0, "must be above the horizon (z > 0); leave this sample out")
        _refuse(where, "f", self.f, (self.f < 0).any(axis=1), "must be >= 0; clamp it and say so in clamped_fraction")
        if not 0 <= self.clamped_fraction <= 1:
            raise ValueError(f"{where}: clamped_fraction is {self.clamped_fraction}; it is a share, in [0, 1].")


def split(measurements: Measurements, n: int, seed: int = 0) -> tuple[Measurements, Measurements]:
    """Keep `n` random samples aside, at least one; return (the others, those).

    Raises
    ------
    ValueError
        If there are fewer than two samples.

    Examples
    --------
    >>> m = Measurements(*[[[0, 0, 1]] * 5] * 3)
    >>> [len(part.f) for part in split(m, 1)]
    [4, 1]
    """
    total = len(measurements.f)
    if total < 2:
        raise ValueError(f'split(): "{measurements.name}" has {total} sample; at least two are needed. Measure more.')
    order = np.random.default_rng(seed).permutation(total)
    n = min(max(n, 1), total - 1)
    rows = np.sort(order[n:]), np.sort(order[:n])
    a, b = (replace(measurements, wi=measurements.wi[k], wo=measurements.wo[k], f=measurements.f[k]) for k in rows)
    return a, b


def _refuse(where: str, key: str, a: np.ndarray, bad: Any, rule: str) -> None:
    """Raise for the first sample marked in `bad`."""
    if bad.any():
        k = int(np.argmax(bad))
        raise ValueError(f"{where}: {key}[{k}] is {a[k].tolist()}; it {rule}. {int(bad.sum())} samples are like this.")


def clamp_negative(f: np.ndarray) -> tuple[np.ndarray, float]:
    """Set negative values to 0 and return (f, share of the values that were negative); NaN and inf stay."""
    negative = (f < 0) & np.isfinite(f)
    return np.where(negative, 0, f), float(negative.mean()) if f.size else 0.0
