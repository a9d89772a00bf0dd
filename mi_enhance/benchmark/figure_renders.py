"""Renders of measured files beside models that were fitted to them (the paper's Figs. 5, 14 and 16)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import mitsuba as mi
import numpy as np

from ..data.loading import load
from ..evaluation.truth import rendered_truth
from ..material.material import Material
from ..output.figure import sheet
from ..system.files import material_name, replacing
from ..system.progress import Callback, silent
from .contenders import ANALYTIC, EXACT, NBRDF, REFERENCE, contenders
from .errors import TRUTH, rendered_errors
from .hybrid_contender import HYBRID

OWN = "specialized on the file, 12-12"  # as many multiply-adds as NBRDF
NAMES = {
    EXACT: "enhanced",
    OWN: "own network",
    REFERENCE: "GGX",
    HYBRID: "hybrid (2026)",
}  # in a figure, where all contenders are plugins in Python
LABELS = {
    5: (EXACT, OWN, REFERENCE, "Low's ABC", NBRDF, HYBRID),
    14: (EXACT, OWN, REFERENCE, NBRDF),
    16: (EXACT, OWN, REFERENCE, *ANALYTIC, NBRDF, HYBRID),
}
UNSEEN = 50_000  # pairs that errors are measured on


def renders(
    number: int,
    paths: Sequence[str | Path],
    folder: Path,
    *,
    model: Material | None = None,
    n_samples: int = 100_000,
    resolution: int = 256,
    spp: int = 256,
    seed: int = 0,
    progress: Callback = silent,
) -> list[dict]:
    """Fit the models of a figure to measured files, render and judge them, and draw the figure.

    Parameters
    ----------
    number : {5, 14, 16}
        5 and 14 are pictures with error maps, a row for each file; 16 is a plot of SSIM and Delta E_ITP over all files.
    paths : sequence of str or Path
        RGL ``.bsdf`` files.
    folder : Path
        Keeps fits and renders; ``figure_<number>.png`` is the figure.
    model, n_samples, seed
        Of the fits, see :func:`mi_enhance.benchmark.contenders.contenders`.
    resolution, spp : int
        Of the renders.
    progress : callable

    Returns
    -------
    list of dict
        One row for each file and model: ``material``, ``label``, ``ssim``, ``delta_E_ITP_1000``, ``log_l1``.
    """
    rows = []
    for path in paths:
        truth, name = shown_file(path, number), material_name(path)
        fits = folder / "fits" / name
        measured = load(path, n_samples=n_samples, seed=seed)
        unseen = load(path, n_samples=UNSEEN, seed=seed + 1)
        only = (*LABELS[number], TRUTH)
        fitted = contenders(truth, measured, fits, model=model, only=only, seed=seed, progress=progress)
        # in the order of the figure
        by_name = {NAMES.get(label, label): fitted[label] for label in only}

        def bsdfs(by_name: Mapping = by_name) -> dict[str, mi.BSDF]:
            return {label: c.bsdf() for label, c in by_name.items()}

        errors = rendered_errors(
            list(by_name),
            bsdfs,
            unseen,
            folder / f"renders_{number}" / name,
            resolution=resolution,
            spp=spp,
            seed=seed,
            progress=progress,
        )
        rows += [{"material": name, "label": label, **errors[label]} for label in by_name if label != TRUTH]
    picture = folder / f"figure_{number}.png"
    if number == 16:
        _plot(rows, picture)
    else:
        stack([folder / f"renders_{number}" / material_name(path) / "comparison.png" for path in paths], picture)
    return rows


def shown_file(path: str | Path, number: int) -> dict:
    """Return the BSDF of a measured file that a figure shows; a ValueError if Mitsuba cannot render it."""
    truth = rendered_truth(path, f"figure {number}")
    if truth is None:
        raise ValueError(f'figure {number}: "{path}" is no RGL file. The truth must be one that renders.')
    return truth


def stack(pictures: Sequence[Path], path: Path) -> None:
    """Write PNG files of the same width, one below the other."""
    tiles = [np.array(mi.Bitmap(str(picture))) for picture in pictures]
    with replacing(path) as temporary:
        mi.Bitmap(np.concatenate(tiles)).write(str(temporary))


def _plot(rows: Sequence[Mapping], path: Path) -> None:
    """Draw the errors of every model over all materials, those first that the first model renders best."""
    first = rows[0]["label"]
    order = [r["material"] for r in sorted(rows, key=lambda r: -r["ssim"]) if r["label"] == first]
    with sheet(path, (max(7, 1.2 * len(order)), 8), 110) as figure:
        for axes, key, text in zip(
            figure.subplots(2, 1, sharex=True), ("ssim", "delta_E_ITP_1000"), ("SSIM", "$10^3$ ΔE ITP"), strict=True
        ):
            for label in dict.fromkeys(r["label"] for r in rows):
                values = {r["material"]: r[key] for r in rows if r["label"] == label}
                style = {"lw": 2.5, "color": "black", "zorder": 3} if label == first else {"lw": 1}
                axes.plot(order, [values[m] for m in order], "o-", ms=4, label=label, **style)
            axes.set_ylabel(text)
            axes.grid(alpha=0.3)
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter("{x:g}")
        axes.yaxis.set_minor_formatter("{x:g}")
        axes.tick_params(axis="x", rotation=45)
        axes.legend(fontsize=8)
