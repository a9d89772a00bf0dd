"""Pictures: a comparison (renders in a row, their figures, error maps with one scale), the curve of a training."""

from __future__ import annotations

import contextlib

from ..system.files import replacing

_DPI = 160  # 352 pixels for a tile: three of them fill the width of a README


@contextlib.contextmanager
def sheet(path, size, dpi):
    """Yield a figure that is written as PNG when the block ends: `size` in inches, axes laid out to fit.

    It has its own Agg canvas: pyplot, and so the user's backend, is never touched.

    Examples
    --------
    >>> with sheet("plot.png", (8, 5), 100) as figure:  # doctest: +SKIP
    ...     figure.add_subplot().plot([1, 2])
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, dpi=dpi, layout="constrained")
    FigureCanvasAgg(figure)
    yield figure
    with replacing(path) as temporary:
        figure.savefig(temporary, format="png")
