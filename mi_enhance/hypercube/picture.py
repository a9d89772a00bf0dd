"""The picture of a search (the paper's Figs. 1 and 4): states, what every candidate was worth, errors, the front."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from ..output.figure import sheet

_SPREAD = 0.2  # colours end where a candidate is this much better or worse than the unchanged state


def draw_search(
    stages: list[dict], front: list[dict], choices: Mapping[str, Sequence], path: str | Path, *, cost: str
) -> None:
    """Draw the stages of a search and write the picture.

    Parameters
    ----------
    stages, front : list of dict
        As :class:`mi_enhance.hypercube.search.SearchResult` has them; the front is its ``pareto``.
    choices : dict of str to sequence
        The choices of every slot, in the order of the formula.
    path : str or Path
        PNG.
    cost : str
        The setting that says how costs are measured.

    Examples
    --------
    >>> draw_search(found.stages, found.pareto, choices, "search.png", cost="measured")  # doctest: +SKIP
    """
    unit = "ns" if cost == "measured" else "1,000 multiply-adds"
    with sheet(path, (16, 2.2 + 0.5 * max(len(stages), 5)), 100) as figure:
        left, middle, right = figure.subplots(1, 3, width_ratios=(max(6, len(choices)) * 0.75, 5, 5))
        _states(left, stages, list(choices))
        _errors(middle, stages)
        _front(right, stages, front, unit)
        figure.suptitle(" → ".join(dict.fromkeys(s["equation"] for s in stages)), fontsize=11)


def _states(axes, stages: list[dict], slots: list[str]) -> None:
    """One row per stage: the digits of the state it began with, coloured by what changing them was worth."""
    gains = np.full((len(stages), len(slots)), np.nan)
    for i, s in enumerate(stages):
        for row in s["candidates"]:
            changed = [k for k, (a, b) in enumerate(zip(s["current"], row["digits"], strict=True)) if a != b]
            if len(changed) == 1:  # larger steps of a search with distance 2 have no cell of their own
                ratio = row["loss"] / s["unchanged"]
                gains[i, changed[0]] = np.nanmin([gains[i, changed[0]], ratio])
    image = axes.imshow(gains, cmap="PuOr_r", vmin=1 - _SPREAD, vmax=1 + _SPREAD, aspect="auto")
    for i, s in enumerate(stages):
        for k in range(len(slots)):
            text = str(s["current"][k])
            value = abs(image.norm(gains[i, k]) - 0.5)  # white on the dark ends of the scale
            axes.text(k, i, text, ha="center", va="center", fontsize=8, color="white" if value > 0.3 else "black")
            if s["best"][k] != s["current"][k]:
                axes.add_patch(_frame(k, i))
    axes.set_xticks(range(len(slots)), slots, rotation=45)
    axes.set_yticks(range(len(stages)), [f"{s['stage']}  {s['change']}" for s in stages])
    axes.set_title("state at the start of each stage (frame: what changed)", fontsize=9)
    axes.figure.colorbar(image, ax=axes, shrink=0.8, label="loss of the change / loss unchanged")


def _frame(k: int, i: int):
    from matplotlib.patches import Rectangle

    return Rectangle((k - 0.5, i - 0.5), 1, 1, fill=False, lw=2.5, ec="black")


def _errors(axes, stages: list[dict]) -> None:
    """Loss of every candidate, of the unchanged state and of the one chosen, stage by stage."""
    x = [s["stage"] for s in stages]
    for s in stages:
        losses = [row["loss"] for row in s["candidates"]]
        axes.plot([s["stage"]] * len(losses), losses, ".", color="0.75", zorder=1)
    axes.plot(x, [s["unchanged"] for s in stages], "o--", color="tab:blue", ms=4, label="unchanged state, trained on")
    axes.plot(x, [s["loss"] for s in stages], "o-", color="tab:orange", label="chosen")
    if any("validation" in s for s in stages):
        axes.plot(x, [s.get("validation") for s in stages], "s:", color="tab:green", ms=4, label="unseen materials")
    axes.set(xlabel="stage", ylabel="log-L1", yscale="log", xticks=x)
    axes.set_title("error after each stage", fontsize=9)
    axes.grid(alpha=0.3, which="both")
    axes.legend(fontsize=8)


def _front(axes, stages: list[dict], front: list[dict], unit: str) -> None:
    rows = [row for s in stages for row in s["candidates"]]
    axes.plot([r["cost"] for r in rows], [r["loss"] for r in rows], ".", color="0.75")
    axes.step([r["cost"] for r in front], [r["loss"] for r in front], "o-", where="post", color="tab:orange", ms=4)
    axes.set(xlabel=f"cost of one evaluation, {unit}", ylabel="log-L1", yscale="log")
    axes.set_title("all candidates, and the front", fontsize=9)
    axes.grid(alpha=0.3, which="both")
