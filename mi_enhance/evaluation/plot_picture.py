"""The picture of a BRDF, for `plot`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..output.figure import sheet
from ..output.srgb import encode_srgb
from .lobe_curves import INCIDENCES, Curves, luminance

_DPI = 110
_MEASURED = ("black", "0.45", "tab:green", "tab:purple")
_OWN, _ANCESTOR = "tab:orange", "tab:blue"
_FLOOR = 1e-4  # 1/sr: below, a logarithmic axis shows nothing of use
_TICKS = (0, 1, 5, 15, 30, 50, 70, 90)  # degrees of theta_h
_PANELS = 5  # of the last row: three slices, two errors
_PERCENTILE = 99.5  # top of the scales: a few steep values must not make all else black


def draw(curves: Mapping[str, Curves], n_measured: int, path: str | Path, *, title: str) -> None:
    """Draw curves and write the picture.

    Parameters
    ----------
    curves : dict of str to Curves
        Measurements first, then the material, then its ancestor, if any.
    n_measured : int
        How many are measurements.
    path : str or Path
        PNG.
    title : str

    Examples
    --------
    >>> draw({"grey": curves_of(f)}, 0, "grey.png", title="grey")  # doctest: +SKIP
    """
    styles = _styles(list(curves), n_measured)
    with sheet(path, (15, 11.5), _DPI) as figure:
        figure.suptitle(title, fontsize=11)
        top, bottom = figure.subfigures(2, 1, height_ratios=(2, 1.15))
        axes = top.subplots(2, 4, gridspec_kw={"height_ratios": (0.85, 1)})
        for k, theta in enumerate(INCIDENCES):
            place = axes[0, k].get_subplotspec()
            axes[0, k].remove()
            _lobe(top.add_subplot(place, projection="polar"), curves, styles, k, theta)
            _plane(axes[1, k], curves, styles, k, theta)
        _albedo(axes[0, 3], curves, styles)
        _peaks(axes[1, 3], curves, styles)
        axes[0, 3].legend(fontsize=8, loc="best")
        _slices(bottom, curves, n_measured)


def _styles(names: list[str], n_measured: int) -> dict[str, dict[str, Any]]:
    """Return what a line of each is drawn with: measurements dark and thick, the material in front."""
    styles = {}
    for k, name in enumerate(names):
        if k < n_measured:
            styles[name] = {"color": _MEASURED[k % len(_MEASURED)], "lw": 2.6, "alpha": 0.8}
        elif k == n_measured:
            styles[name] = {"color": _OWN, "lw": 1.6, "zorder": 3}
        else:
            styles[name] = {"color": _ANCESTOR, "lw": 1.3, "ls": "--"}
    return styles


def _lobe(axes: Any, curves: Mapping[str, Curves], styles: Mapping[str, dict], k: int, theta: float) -> None:
    from matplotlib.ticker import MaxNLocator

    for name, c in curves.items():
        angle = np.deg2rad(c.angles[k])
        axes.plot(angle, np.log1p(c.plane[k] * np.cos(angle)), **styles[name])
    axes.set(theta_zero_location="N", theta_direction=-1, thetamin=-90, thetamax=90)
    light = np.deg2rad(-theta)
    axes.axvline(light, color="goldenrod", lw=1.2, ls=":")
    axes.text(light, 0.6 * axes.get_rmax(), "light ", fontsize=8, color="goldenrod", ha="right", va="center")
    axes.tick_params(labelsize=7)
    axes.yaxis.set_major_locator(MaxNLocator(4))
    axes.set_rlabel_position(90)
    axes.set_title(f"lobe, light at {theta:.0f}°: log(1 + f cos)", fontsize=9, y=0.92)


def _plane(axes: Any, curves: Mapping[str, Curves], styles: Mapping[str, dict], k: int, theta: float) -> None:
    for name, c in curves.items():
        axes.plot(c.angles[k], np.maximum(c.plane[k], _FLOOR), **styles[name])
    axes.axvline(-theta, color="goldenrod", lw=1.2, ls=":")
    axes.axvline(theta, color="0.6", lw=0.8, ls=":")
    _scale(axes)
    axes.set(xlim=(-90, 90), xticks=range(-90, 91, 30), xlabel="angle of the viewer, degrees")
    axes.set_title(f"plane of incidence, light at {theta:.0f}°: f, 1/sr", fontsize=9)
    axes.grid(alpha=0.3)
    axes.tick_params(which="both", labelsize=8)


def _scale(axes: Any) -> None:
    """Make the axis logarithmic where its lines span decades."""
    from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

    low, high = axes.dataLim.intervaly
    if high > 20 * low:
        axes.set_yscale("log")
        axes.yaxis.set_major_locator(LogLocator(subs=(1,) if high > 500 * low else (1, 2, 5)))
        axes.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axes.yaxis.set_minor_formatter(NullFormatter())


def _albedo(axes: Any, curves: Mapping[str, Curves], styles: Mapping[str, dict]) -> None:
    for name, c in curves.items():
        for channel, hue in enumerate(("tab:red", "tab:green", "tab:blue")):
            style = {**styles[name], "lw": 0.8, "color": hue, "alpha": 0.35}
            axes.plot(c.albedo_angles, c.albedo[:, channel], **style)
        axes.plot(c.albedo_angles, luminance(c.albedo), label=name, **styles[name])
    highest = max(float(c.albedo.max()) for c in curves.values())
    if highest > 0.7:  # else the line of all light squeezes the curves
        axes.axhline(1, color="black", lw=0.8, ls=":")
    axes.set(xlim=(0, 90), ylim=(0, 1.1 * max(highest, 1e-3)), xlabel="angle of the view, degrees")
    axes.set_title("directional albedo (thin: R, G, B)", fontsize=9)
    axes.grid(alpha=0.3)
    axes.tick_params(which="both", labelsize=8)


def _peaks(axes: Any, curves: Mapping[str, Curves], styles: Mapping[str, dict]) -> None:
    """Along theta_d, where the half vector is the normal: Fresnel's side of the material."""
    for name, c in curves.items():
        column = luminance(np.expm1(c.slice[:, 0]))
        axes.plot(np.linspace(0, 89, len(column)), np.maximum(column, _FLOOR), **styles[name])
    _scale(axes)
    axes.set(xlim=(0, 90), xlabel="theta_d, degrees")
    axes.set_title("mirror direction (theta_h = 0): f cos, 1/sr", fontsize=9)
    axes.grid(alpha=0.3)
    axes.tick_params(which="both", labelsize=8)


def _slices(figure: Any, curves: Mapping[str, Curves], n_measured: int) -> None:
    """Slices of the first measurement, the material and the ancestor; errors against the first of these."""
    from matplotlib.colors import PowerNorm

    names = list(curves)
    shown = [*names[: min(n_measured, 1)], *names[n_measured:]]
    errors = shown[1:]
    used = len(shown) + len(errors)
    axes = figure.subplots(1, _PANELS, sharey=True, squeeze=False)[0]
    first = (_PANELS - used) // 2
    for ax in (*axes[:first], *axes[first + used :]):
        ax.set_axis_off()
    axes = axes[first : first + used]
    top = max(float(np.percentile(luminance(curves[name].slice), _PERCENTILE)) for name in shown)
    for ax, name in zip(axes, shown, strict=False):
        image = np.sqrt(curves[name].slice / max(top, 1e-6))  # the root shows the dark, too; 1e-6: black
        _show(ax, encode_srgb(image), f"{name}, phi_d = 90°")
    truth = curves[shown[0]].slice
    maps = {name: np.abs(curves[name].slice - truth).mean(-1) for name in errors}
    scale = max((float(np.percentile(e, _PERCENTILE)) for e in maps.values()), default=1.0)
    norm = PowerNorm(0.5, 0, max(scale, 1e-6))
    for ax, (name, error) in zip(axes[len(shown) :], maps.items(), strict=True):
        drawn = _show(ax, error, f"error of {name}, mean {error.mean():.4f}", cmap="inferno", norm=norm)
    if maps:
        bar = figure.colorbar(drawn, ax=list(axes), fraction=0.012, pad=0.01)
        bar.set_label("difference of log(1 + f cos)", fontsize=8)
        bar.ax.tick_params(labelsize=7)
    axes[0].set_ylabel("theta_d, degrees", fontsize=8)
    axes[0].tick_params(
        labelleft=True
    )  # of axes that share, only the first in the row has labels, and it may be hidden


def _show(axes: Any, image: np.ndarray, title: str, **how: Any) -> Any:
    drawn = axes.imshow(image, origin="lower", extent=(0, 1, 0, 89), aspect="auto", interpolation="bilinear", **how)
    axes.set_title(title, fontsize=8)
    axes.set_xticks(np.sqrt(np.array(_TICKS) / 90), [str(t) for t in _TICKS])
    axes.set_xlabel("theta_h, degrees", fontsize=8)
    axes.tick_params(labelsize=7)
    return drawn
