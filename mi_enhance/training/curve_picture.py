"""The curve of a training as a picture."""

from __future__ import annotations

from ..output.figure import sheet


def draw_curve(records, path):
    """Draw the losses of a training over its steps: solid for what it trains on, dashed for validation.

    Parameters
    ----------
    records : list of dict
        Each with ``step``, ``seconds``, and losses under any other key.
    path : str or Path
        PNG.

    Examples
    --------
    >>> draw_curve([{"step": 1, "loss": 0.02}, {"step": 2, "loss": 0.01}], "curve.png")  # doctest: +SKIP
    """
    with sheet(path, (10, 5), 90) as figure:
        axes = figure.add_subplot()
        for key in dict.fromkeys(key for r in records for key in r if key not in ("step", "seconds")):
            rows = [(r["step"], r[key]) for r in records if key in r]
            style = {"ls": "--", "marker": "o", "ms": 3} if key.startswith("validation") else {"ls": "-"}
            axes.plot(*zip(*rows, strict=True), label=key, lw=2.5 if key == "loss" else 1, **style)
        axes.set(xlabel="step", ylabel="log-L1", yscale="log")
        axes.grid(alpha=0.3, which="both")
        axes.legend(fontsize=8, loc="center left", bbox_to_anchor=(1, 0.5))  # beside the curves, which fill the axes
