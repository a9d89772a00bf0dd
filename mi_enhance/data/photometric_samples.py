"""Measurements from photographs with known normals and one light each: no light transport, no renderer, seconds."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..system.checks import positive_int
from .directions import directions_to_rusinkiewicz
from .measurements import Measurements, clamp_negative
from .photometric_file import PhotometricFile
from .registry import reader


def photometric(
    path: str | Path, *, split: str | None = "train", n_samples: int = 30_000, seed: int = 0
) -> Measurements:
    """Read photographs of one material, with known normals and lights, as measurements.

    Pixels in shadow (attached, or cast by a mesh), saturated ones, and those under a mask are left out.

    Parameters
    ----------
    path : str or Path
        A ``photometric.json`` or its folder; docs/photographs.md describes it.
    split : {"train", "test"} or None
        Frames to be read; all if None.
    n_samples : int
        At most so many pixels are drawn, half of them evenly, half evenly over half and difference angle: a highlight
        is a few pixels of a photograph. More take longer and say little more: neighbours see the same.
    seed : int

    Returns
    -------
    Measurements

    Raises
    ------
    FileNotFoundError, ValueError
        For a missing or damaged file, wrong entries, or photographs without a pixel that counts.

    Examples
    --------
    >>> photometric("ball").f.shape  # doctest: +SKIP
    (30000, 3)
    """
    n_samples = positive_int(n_samples, "n_samples", f'data.photometric("{path}")')
    file = PhotometricFile(path)
    parts = [(frame.wi[c], frame.wo[c], frame.f[c], len(c)) for frame in file.read(split) for c in [frame.counts]]
    where = file.where
    if not parts:
        raise ValueError(f'{where}: no frame has split "{split}". Choose another.')
    wi, wo, f = (np.concatenate([part[k] for part in parts]) for k in range(3))
    if not len(f):
        raise ValueError(
            f"{where}: no pixel of {len(parts)} photographs counts: all are masked, saturated, or face away from "
            "camera or light. Check the mask, and that normals and lights are in the same axes (x right, y up, z "
            "towards the camera)."
        )
    chosen = _chosen(wi, wo, n_samples, np.random.default_rng(seed))
    f, clamped = clamp_negative(f[chosen])
    source = (
        f"photographs {file.folder.name}/: {len(chosen)} of {len(wi)} pixels of {len(parts)} photographs, "
        f"{sum(part[3] for part in parts) - len(wi)} in shadow, saturated or masked"
    )
    return Measurements(_unit(wi[chosen]), _unit(wo[chosen]), f, file.folder.resolve().name, source, clamped)


@reader("photometric", about="photographs with normals and lights photometric.json", suffixes=(".json",))
def read(path: str | Path, *, n_samples: int, seed: int) -> Measurements:
    """Read the training frames of a ``photometric.json``, see :func:`photometric`."""
    return photometric(path, n_samples=n_samples, seed=seed)


class Texels(NamedTuple):
    """Samples of every texel, as :func:`mi_enhance.fitting.fit_texels.fit_texels` takes them.

    Parameters
    ----------
    wi, wo, f : array (H, W, S, 3), float32
        Of S photographs. A sample that does not count is replaced by one of the same texel that does.
    counts : array (H, W, S) of bool
        Samples that are measured. A texel with none holds those of black, seen and lit from above.
    """

    wi: np.ndarray
    wo: np.ndarray
    f: np.ndarray
    counts: np.ndarray


def photometric_texels(
    path: str | Path,
    *,
    split: str | None = "train",
    rows: tuple[int, int] | None = None,
    columns: tuple[int, int] | None = None,
    factor: int = 1,
) -> Texels:
    """Read photographs of a flat sample, or of any shape by one camera that stands still: a pixel is a texel.

    Parameters
    ----------
    path : str or Path
        As for :func:`photometric`.
    split : {"train", "test"} or None
        Frames to be read; all if None.
    rows, columns : (int, int), optional
        A window: first row and the one after the last, likewise columns.
    factor : int
        So many pixels on a side make a texel: the mean of those that count.

    Returns
    -------
    Texels

    Examples
    --------
    >>> wi, wo, f, counts = photometric_texels("cards", factor=2)  # doctest: +SKIP
    >>> found = me.fit_texels(me.Material.pretrained(), wi, wo, f)  # doctest: +SKIP
    """
    file = PhotometricFile(path)
    factor = positive_int(factor, "factor", file.where)
    height, width = file.mask.shape
    window = (slice(*(rows or (0, height))), slice(*(columns or (0, width))))
    if 0 in file.mask[window].shape:
        raise ValueError(f"{file.where}: the window of rows {rows} and columns {columns} holds no pixel.")
    if factor > min(file.mask[window].shape):
        sides = " x ".join(map(str, file.mask[window].shape[::-1]))
        raise ValueError(f"{file.where}: factor is {factor}, more than the {sides} pixels have on a side.")
    found = []
    for frame in file.read(split):
        arrays = []
        for values in (frame.wi, frame.wo, np.maximum(frame.f, 0), frame.counts[:, None]):
            whole = np.zeros((height, width, values.shape[1]), np.float32)
            whole[file.mask] = np.where(frame.counts[:, None], values, 0)
            arrays.append(_blocks(whole[window], factor))
        wi, wo, f, counts = arrays
        found.append((wi, wo, f / np.maximum(counts, 1e-6), counts[..., 0] > 0))  # 1e-6: a block without a sample
    if not found:
        raise ValueError(f'{file.where}: no frame has split "{split}". Choose another.')
    wi, wo, f, counts = (np.stack([part[k] for part in found], 2) for k in range(4))
    index = np.argsort(~counts, axis=2, kind="stable")  # those that count first
    order = np.take_along_axis(index, np.arange(counts.shape[2]) % np.maximum(counts.sum(2, keepdims=True), 1), 2)
    order = np.where(counts, np.arange(counts.shape[2]), order)
    wi, wo, f = (np.take_along_axis(a, order[..., None], 2) for a in (wi, wo, f))
    up = np.array([0, 0, 1], np.float32)
    none = ~counts.any(2)
    wi[none], wo[none], f[none] = up, up, 0
    return Texels(_unit(wi), _unit(wo), f, counts)


def _chosen(wi: np.ndarray, wo: np.ndarray, n: int, rng: np.random.Generator) -> np.ndarray:
    """Return the indices of at most n pixels, without replacement."""
    if n >= len(wi):
        return np.arange(len(wi))
    theta_h, _, theta_d, _ = directions_to_rusinkiewicz(wi, wo)
    # highlights are narrow: the square root makes cells smaller towards theta_h = 0, as in MERL's tables
    cells = np.minimum(90 * np.sqrt(theta_h / (np.pi / 2)), 89).astype(int) * 30
    cells += np.minimum(30 * theta_d / (np.pi / 2), 29).astype(int)
    p = 1 / np.bincount(cells)[cells]
    p = 0.5 * p / p.sum() + 0.5 / len(p)
    # Efraimidis and Spirakis 2006: the largest u ** (1 / p) are a weighted choice without replacement
    keys = np.log(rng.random(len(p))) / p
    return np.sort(np.argpartition(keys, -n)[-n:])


def _blocks(a: np.ndarray, factor: int) -> np.ndarray:
    """Return means over factor x factor pixels; what is left over at the right and lower border is cut off."""
    height, width = a.shape[0] // factor, a.shape[1] // factor
    return a[: height * factor, : width * factor].reshape(height, factor, width, factor, -1).mean((1, 3))


def _unit(v: np.ndarray) -> np.ndarray:
    return v / np.linalg.norm(v, axis=-1, keepdims=True)
