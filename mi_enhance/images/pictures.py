"""Pictures of a fit to images: photographs over renders, error maps, error against time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import mitsuba as mi
import numpy as np

from ..fitting.uncertainty import OPEN
from ..output.figure import sheet
from ..output.srgb import encode_srgb
from ..system.files import replacing
from .targets import Target
from .uncertainty import TOLD, Uncertainty
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


def draw_uncertainty(found: Uncertainty, path: str | Path) -> None:
    """Write what photographs tell as PNG: a bar for each number, and a map of the reflectance of each material.

    Examples
    --------
    >>> draw_uncertainty(fit.uncertainty, "uncertainty.png")  # doctest: +SKIP
    """
    groups = found.groups()
    height = max(3.2, 0.24 * len(groups) + 1.6)
    with sheet(path, (5.5 + 4.2 * len(found.reflectance), height), 110) as figure:
        axes = np.atleast_1d(figure.subplots(1, 1 + len(found.reflectance)))
        for row, index in enumerate(groups.values()):
            share = np.sort(found.share[index])
            colours = ["#2a7" if s <= TOLD else "#fb3" if s <= OPEN else "#d54" for s in share]
            height = 0.8 / len(share)
            axes[0].barh(
                row - 0.4 + height * (np.arange(len(share)) + 0.5), np.maximum(share, 0.01), height, color=colours
            )
        axes[0].set_yticks(range(len(groups)), list(groups), fontsize=8)
        axes[0].invert_yaxis()
        axes[0].set(xlim=(0, 1), xlabel="standard deviation, share of that without photographs")
        axes[0].set_title("green: told, yellow: roughly, red: left open", fontsize=9)
        for ax, (name, std) in zip(axes[1:], found.reflectance.items(), strict=True):
            # above a factor of 2 a reflectance is as good as unknown
            shown = ax.imshow(std, cmap="inferno", vmin=0, vmax=np.log(2), extent=(0, 90, 90, 0), aspect="auto")
            ax.set(xlabel="difference angle (degrees)", ylabel="half angle (degrees)")
            ax.set_title(name, fontsize=9)
            figure.colorbar(shown, ax=ax, label="relative uncertainty of the reflectance", extend="max")
