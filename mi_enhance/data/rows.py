"""Measurements out of rows, one pair of directions each: the last step of every reader of points."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np

from ..system.files import material_name
from .measurements import Measurements, clamp_negative

# More than this share of rows below the horizon is no accident: another axis is the normal, or another angle polar.
_MANY_BELOW = 0.5


def from_rows(
    path: str | Path,
    wi: np.ndarray,
    wo: np.ndarray,
    f: np.ndarray,
    *,
    where: str,
    about: str,
    notes: list[str],
    n_samples: int,
    seed: int,
    isotropic: bool = False,
) -> Measurements:
    """Return the rows above the horizon, at most `n_samples` of them.

    Parameters
    ----------
    path : str or Path
    wi, wo : array (N, 3)
        Unit vectors towards viewer and light.
    f : array (N, 3)
        1/sr, linear RGB; negative values become 0 and are counted.
    where, about : str
        The beginning of messages, and what kind of file it is.
    notes : list of str
        What the reader did to the values; joined in `source`.
    n_samples, seed : int
    isotropic : bool
        The file says nothing about the azimuth of the pair as a whole. Each row is turned about the normal by a random
        angle, so that a fit cannot read anisotropy into the one azimuth that was measured.

    Raises
    ------
    ValueError
        If no row is above the horizon.

    Warns
    -----
    UserWarning
        If more than half of the rows are below it.
    """
    notes = list(notes)
    above = (wi[:, 2] > 0) & (wo[:, 2] > 0)
    if not above.any():
        raise ValueError(
            f"{where}: no row has both directions above the horizon (z > 0). Is the normal +z in this table?"
        )
    if not above.all():
        notes.append(f"{np.sum(~above)} rows below the horizon dropped")
    if np.mean(~above) > _MANY_BELOW:
        warnings.warn(
            f"{where}: {np.sum(~above)} of {len(above)} rows have a direction below the horizon (z <= 0) and "
            "are dropped. The normal must be +z; polar angles are from it, in radians unless the table says degrees.",
            stacklevel=3,
        )
    rows = np.flatnonzero(above)
    rng = np.random.default_rng(seed)
    if len(rows) > n_samples:
        notes.append(f"{n_samples} of {len(rows)} rows drawn")
        rows = np.sort(rng.choice(rows, n_samples, replace=False))
    f, clamped_fraction = clamp_negative(f[rows])
    wi, wo = wi[rows], wo[rows]
    if isotropic:
        notes.append("each row turned about the normal at random: the file is isotropic")
        wi, wo = _turned(wi, wo, rng.random(len(rows)) * 2 * np.pi)
    source = "; ".join([f"{about} {path}", *notes])
    return Measurements(wi, wo, f, material_name(path), source, clamped_fraction)


def _turned(wi: np.ndarray, wo: np.ndarray, phi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Turn both directions of each row about the normal."""
    c, s = np.cos(phi), np.sin(phi)
    turned = [np.stack((c * w[:, 0] - s * w[:, 1], s * w[:, 0] + c * w[:, 1], w[:, 2]), 1) for w in (wi, wo)]
    return turned[0], turned[1]


def finite(values: np.ndarray, where: str, line: np.ndarray | None = None) -> None:
    """Raise for the first value of (N, C) that float32 cannot hold; `line` gives its place in the file."""
    bad = np.flatnonzero(~(np.abs(values) <= np.finfo(np.float32).max).all(1))
    if len(bad):
        place = f"line {line[bad[0]]}" if line is not None else f"value {bad[0] + 1}"
        raise ValueError(
            f"{where}: {place} holds {values[bad[0]].tolist()}, and {len(bad) - 1} more are not finite. The file is "
            "damaged; remove these rows or get it again."
        )
