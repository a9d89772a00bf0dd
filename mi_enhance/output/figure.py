"""Figures that are written as PNG, whole or not at all, without the user's backend."""

from __future__ import annotations

import contextlib

from ..system.files import replacing


@contextlib.contextmanager
def sheet(path, size, dpi, layout="constrained"):
    """Yield a figure that is written as PNG when the block ends: `size` in inches, axes laid out to fit.

    With `layout` None axes stay where they are put. The figure has its own Agg canvas: pyplot, and so the user's
    backend, is never touched.

    Examples
    --------
    >>> with sheet("plot.png", (8, 5), 100) as figure:  # doctest: +SKIP
    ...     figure.add_subplot().plot([1, 2])
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, dpi=dpi, layout=layout)
    FigureCanvasAgg(figure)
    yield figure
    with replacing(path) as temporary:
        figure.savefig(temporary, format="png")
