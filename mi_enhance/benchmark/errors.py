"""The errors of models: on unseen samples of a measured file, and in a render beside it."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np

from ..data.measurements import Measurements
from ..evaluation.compare import compare
from ..evaluation.reflectance import reflectance
from ..fitting.losses import log_l1
from ..system.cache import cached
from ..system.files import digest
from ..system.progress import Callback, silent

TRUTH = "measured"  # label of the file itself


def rendered_errors(
    labels: Sequence[str],
    bsdfs: Callable[[], Mapping[str, mi.BSDF]],
    unseen: Measurements,
    folder: Path,
    *,
    resolution: int,
    spp: int,
    seed: int,
    progress: Callback = silent,
) -> dict[str, dict]:
    """Return the errors of every model on unseen samples and in a render, by label, or what an earlier call has left.

    Parameters
    ----------
    labels : sequence of str
        All models, and the truth (`TRUTH`) if it can be rendered; without it renders have no errors.
    bsdfs : callable
        Makes their BSDFs.
    unseen : Measurements
    folder : Path
        Keeps the errors, and ``comparison.png`` and the renders as of :func:`mi_enhance.evaluation.compare.compare`.
    resolution, spp, seed, progress
        Of the renders.

    Returns
    -------
    dict of str to dict
        ``ssim``, ``delta_E_ITP_1000``, ``mean_abs_log``, ``log_l1`` of each.
    """

    def compute() -> dict[str, dict]:
        models = dict(bsdfs())
        truth = models.pop(TRUTH, None)
        rows = compare(
            truth, models, folder, resolution=resolution, spp=spp, seed=seed, title=unseen.name, progress=progress
        )
        keys = ("ssim", "delta_E_ITP_1000", "mean_abs_log")
        result = {row["label"]: {k: row[k] for k in keys if k in row} for row in rows}
        for label, bsdf in {**models, **({TRUTH: truth} if truth else {})}.items():
            f = np.maximum(reflectance(bsdf, unseen.wi, unseen.wo), 0)  # files hold negative values
            result[label]["log_l1"] = log_l1(f, unseen.f, unseen.wo[:, 2])
        return result

    given = digest(" ".join(labels).encode(), unseen.wi, unseen.wo, unseen.f)
    name = f"errors_{resolution}_{spp}_{given}.json"
    return cached(folder / name, compute, lambda path: json.loads(path.read_text()), write_json)


def write_json(path: Path, content: Any) -> None:
    """Write an object that is read again by an interrupted run."""
    path.write_text(json.dumps(content, indent=1) + "\n")
