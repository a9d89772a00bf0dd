"""Slices of fits to few and odd samples (the paper's Fig. 7)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import mitsuba as mi
import numpy as np

from ..data.directions import MIN_COS, direction
from ..data.loading import load
from ..data.measurements import Measurements
from ..evaluation.reflectance import reflectance
from ..fitting.losses import log_l1
from ..material.material import Material
from ..output.figure import sheet
from ..output.srgb import encode_srgb
from ..system.files import material_name
from ..system.progress import Callback, silent
from .contenders import EXACT, NBRDF, contenders
from .errors import TRUTH
from .figure_renders import NAMES, UNSEEN, shown_file
from .odd_samples import retro_reflective

_SIZE = 256  # pixels on a side
_VIEW = np.radians(45)  # from the normal to the fixed direction
_BRIGHT = 99  # percentile of the truth that is shown as white


def slices(
    paths: Sequence[str | Path],
    folder: Path,
    *,
    model: Material | None = None,
    n_samples: int = 100_000,
    seed: int = 0,
    progress: Callback = silent,
) -> list[dict]:
    """Fit the enhanced model and NBRDF to all angles and to retro-reflective samples, and draw ``figure_7.png``.

    Each image is a slice: the light over the whole hemisphere, seen from above, for a viewer at 45 degrees, times the
    cosine. The first columns are fits to samples uniform in all four Rusinkiewicz angles, the last ones fits to samples
    whose directions lie within 3 degrees of each other. Arguments as of
    :func:`mi_enhance.benchmark.figure_renders.renders`.

    Returns
    -------
    list of dict
        One row for each column and model: ``samples``, ``material``, ``label``, ``log_l1`` over all directions.
    """

    def all_angles(path: str | Path, n: int, seed: int) -> Measurements:
        return load(path, n_samples=n, seed=seed)

    kinds: dict[str, Callable[[str | Path, int, int], Measurements]]
    kinds = {"all angles": all_angles, "retro-reflective only": retro_reflective}
    rows, columns = [], []
    labels = {label: NAMES.get(label, label) for label in (TRUTH, EXACT, NBRDF)}
    for kind, draw in kinds.items():
        for path in paths:
            truth, name = shown_file(path, 7), material_name(path)
            own = folder / "fits" / (name if kind == "all angles" else f"{name}_retro")
            fitted = contenders(
                truth, draw(path, n_samples, seed), own, model=model, only=labels, seed=seed, progress=progress
            )
            unseen = load(path, n_samples=UNSEEN, seed=seed + 1)
            column = {}
            for label, text in labels.items():
                bsdf = fitted[label].bsdf()
                f = np.maximum(reflectance(bsdf, unseen.wi, unseen.wo), 0)
                rows.append({"samples": kind, "material": name, "label": text})
                rows[-1]["log_l1"] = log_l1(f, unseen.f, unseen.wo[:, 2])
                column[text] = _slice(bsdf), rows[-1]["log_l1"]
            columns.append((f"{name}\n{kind}", column))
    _draw(columns, folder / "figure_7.png")
    return [row for row in rows if row["label"] != TRUTH]


def _slice(bsdf: mi.BSDF) -> np.ndarray:
    """Return f cos for lights over the hemisphere, (H, W, 3); NaN outside of the disc."""
    x, y = np.meshgrid(*[(np.arange(_SIZE) + 0.5) / _SIZE * 2 - 1] * 2)
    inside = x**2 + y**2 < 1 - MIN_COS**2
    wo = np.stack([x[inside], -y[inside], np.sqrt(1 - x[inside] ** 2 - y[inside] ** 2)], 1)
    wi = np.broadcast_to(direction(_VIEW, np.pi), wo.shape)
    image = np.full((_SIZE, _SIZE, 3), np.nan)
    image[inside] = np.maximum(reflectance(bsdf, wi, wo), 0) * wo[:, 2:]
    return image


def _draw(columns: Sequence[tuple[str, dict]], path: Path) -> None:
    labels = list(columns[0][1])
    with sheet(path, (2 * len(columns), 2.1 * len(labels) + 0.4), 128) as figure:
        grid = figure.subplots(len(labels), len(columns), squeeze=False)
        for k, (title, column) in enumerate(columns):
            white = np.nanpercentile(column[labels[0]][0], _BRIGHT)
            for axes, (label, (image, error)) in zip(grid[:, k], column.items(), strict=True):
                # 1e-6: a black material is black
                axes.imshow(encode_srgb(np.nan_to_num(image / max(white, 1e-6), nan=1.0)))
                axes.set(xticks=[], yticks=[])
                axes.set_frame_on(False)
                axes.set_xlabel("" if label == labels[0] else f"{error:.4f}", fontsize=8)
                if k == 0:
                    axes.set_ylabel(label)
            grid[0, k].set_title(title, fontsize=8)
