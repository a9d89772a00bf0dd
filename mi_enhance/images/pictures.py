"""Pictures of a fit to images: photographs over renders, error maps, error against time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import mitsuba as mi
import numpy as np

from ..output.figure import sheet
from ..output.srgb import encode_srgb
from ..system.files import replacing
from .targets import Target
from .views import View

_SHOWN = 6  # views in a picture
_PERCENTILE = 99.5  # top of the error maps: a few edges must not make every map black


def preview(target: Target, image: np.ndarray, path: str | Path) -> None:
    """Write the first views of a target as PNG, photographs over the render of an iteration."""
    width = target.views[0].size[0] * min(_SHOWN, len(target.views))
    both = np.concatenate([target.image[:, :width], image[:, :width]])
    bitmap = mi.Bitmap(np.round(encode_srgb(both) * 255).astype(np.uint8))
    with replacing(path) as temporary:
        bitmap.write(temporary)


def draw_views(views: Sequence[View], renders: Sequence[np.ndarray], path: str | Path) -> None:
    """Write photograph, re-render and error map of some views as PNG: held-out ones first, then evenly spread.

    Examples
    --------
    >>> draw_views(views, fit.renders, "views.png")  # doctest: +SKIP
    """
    splits = getattr(views, "splits", None) or [v.split for v in views]
    order = sorted(range(len(views)), key=lambda k: splits[k] != "test")
    if len(order) > _SHOWN:
        order = [order[k] for k in np.linspace(0, len(order) - 1, _SHOWN).round().astype(int)]
    shown = {k: views[k].smaller(max(1, views[k].size[0] // renders[k].shape[1])) for k in order}
    errors = [np.abs(np.log1p(np.maximum(renders[k], 0)) - np.log1p(np.maximum(shown[k].image, 0))) for k in order]
    errors = [np.where(shown[k].mask, e.mean(-1), 0) for k, e in zip(order, errors, strict=True)]
    top = max(1e-3, *(float(np.percentile(e, _PERCENTILE)) for e in errors))  # 1e-3: every render equals its photograph
    with sheet(path, (1.8 * len(order), 5.6), 110) as figure:
        axes = figure.subplots(3, len(order), squeeze=False)
        for ax in axes.flat:
            ax.set(xticks=[], yticks=[])
        for column, k, error in zip(axes.T, order, errors, strict=True):
            column[0].imshow(encode_srgb(shown[k].image))
            split = "held out" if shown[k].split == "test" else "fitted"
            column[0].set_title(f"{shown[k].name}\n{split}", fontsize=8)
            column[1].imshow(encode_srgb(renders[k]))
            mapped = column[2].imshow(error, cmap="inferno", vmin=0, vmax=top)
        for ax, label in zip(axes[:, 0], ("photograph", "re-render", "error"), strict=True):
            ax.set_ylabel(label, fontsize=9)
        figure.colorbar(mapped, ax=axes[2].tolist(), label="abs. log difference", extend="max")


def draw_convergence(curves: Mapping[str, Sequence[dict]], path: str | Path) -> None:
    """Write loss against seconds as PNG, of one fit or several; compilation is where nothing happens.

    Examples
    --------
    >>> draw_convergence({"enhanced": fit.curve}, "convergence.png")  # doctest: +SKIP
    """
    with sheet(path, (7, 4), 100) as figure:
        axes = figure.add_subplot()
        for label, curve in curves.items():
            axes.plot(
                *zip(*((row["seconds"], row["loss"]) for row in curve), strict=True), ".-", ms=3, lw=0.8, label=label
            )
        axes.set(xlabel="seconds", ylabel="loss", yscale="log")
        axes.grid(alpha=0.3, which="both")
        axes.legend()
