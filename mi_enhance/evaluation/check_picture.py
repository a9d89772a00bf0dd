"""The picture of a check: albedo over angle, peak of f, map of the reciprocity error."""

from __future__ import annotations

import numpy as np

from ..output.figure import sheet


def draw(angles, albedo, peaks, reciprocity, path, *, title):
    """Draw what :func:`mi_enhance.evaluation.check` found and write the picture.

    Parameters
    ----------
    angles : array (A,)
        Degrees of the view.
    albedo : array (A, azimuths, 3)
        Linear RGB; a line for each channel, a band from the smallest to the largest azimuth.
    peaks : array (A,)
        Largest f, 1/sr.
    reciprocity : array (M, M)
        Relative difference of f for both orders of the directions; polar angles from 0 to the horizon.
    path : str or Path
        PNG.
    title : str

    Examples
    --------
    >>> draw(np.arange(3), np.ones((3, 8, 3)), np.ones(3), np.zeros((4, 4)), "check.png", title="")  # doctest: +SKIP
    """
    from matplotlib.colors import LogNorm

    with sheet(path, (12, 3.6), 100) as figure:
        figure.suptitle(title, fontsize=10)
        left, middle, right = figure.subplots(1, 3)
        for channel, colour in enumerate(("tab:red", "tab:green", "tab:blue")):
            v = albedo[:, :, channel]
            left.plot(angles, v.mean(1), color=colour)
            left.fill_between(angles, v.min(1), v.max(1), color=colour, alpha=0.25, lw=0)
        left.axhline(1, color="black", lw=0.8, ls="--")
        left.set(xlabel="angle of the view, degrees", ylabel="directional albedo", ylim=(0, None))
        middle.plot(angles, np.maximum(peaks, 1e-6), color="black")  # 1e-6: black on the logarithmic scale
        middle.set(xlabel="angle of the view, degrees", ylabel="largest f, 1/sr", yscale="log")
        scale = LogNorm(1e-8, max(1e-6, float(reciprocity.max())))
        image = right.imshow(
            np.maximum(reciprocity, 1e-8), norm=scale, origin="lower", extent=(0, 90, 0, 90), cmap="viridis"
        )
        right.set(xlabel="angle of one direction", ylabel="angle of the other")
        figure.colorbar(image, ax=right, label="|f(a,b) - f(b,a)| / f")
        for axes in (left, middle):
            axes.grid(alpha=0.3)
