"""Renders beside their truth, with error maps."""

from __future__ import annotations

import numpy as np

from ..output.figure import sheet
from ..output.srgb import encode_srgb

_TILE_INCHES = 2.2
_DPI = 160  # 352 pixels for a tile: three of them fill the width of a README
_LINE = 0.28  # inches for a line of text above and below the renders
_GAP = 0.04
_PERCENTILE = 99.5  # top of the colour scale: a few fireflies must not make every map black


def draw(truth, candidates, path, *, title=None):
    """Draw ground truth and candidates, each candidate with its error map, and write the picture.

    Parameters
    ----------
    truth : (str, array (H, W, 3)), optional
        Label and render of the ground truth, linear RGB. Without one the candidates stand alone, without error maps.
    candidates : list of dict
        Each with ``label``, ``image`` (H, W, 3) and, beside a ground truth, ``error`` (H, W; Delta E_ITP of each
        pixel), ``ssim`` and ``delta_E_ITP_1000``.
    path : str or Path
        ``.png`` or another format matplotlib writes.
    title : str, optional
        Name of the material, shown with the colour scale.

    Examples
    --------
    >>> image, error = np.full((16, 16, 3), 0.5), np.zeros((16, 16))
    >>> row = {"label": "GGX", "image": image, "error": error, "ssim": 1.0, "delta_E_ITP_1000": 0.0}
    >>> draw(("measured", image), [row], "out/comparison.png")  # doctest: +SKIP
    """
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    height, width = candidates[0]["image"].shape[:2]
    tile = _TILE_INCHES * height / width  # height of a tile
    columns, below = (len(candidates) + 1, tile) if truth else (len(candidates), 0)
    size = columns * (_TILE_INCHES + _GAP) - _GAP, tile + below + 2 * _LINE + _GAP
    with sheet(path, size, _DPI, layout=None) as figure:

        def axes(column, bottom):
            left = column * (_TILE_INCHES + _GAP)
            ax = figure.add_axes((left / size[0], bottom / size[1], _TILE_INCHES / size[0], tile / size[1]))
            ax.set_axis_off()
            return ax

        def render(column, image, label, text):
            ax = axes(column, below + _LINE)
            ax.imshow(encode_srgb(image))
            ax.set_title(label, fontsize=10, pad=4)
            ax.text(0.5, -0.02, text, transform=ax.transAxes, ha="center", va="top", fontsize=9)

        if not truth:
            for column, candidate in enumerate(candidates):
                render(column, candidate["image"], candidate["label"], title or "")
            return
        errors = [1000 * candidate["error"] for candidate in candidates]
        # 1e-3 keeps the scale from being empty where every candidate equals the truth
        scale = Normalize(0, max(1e-3, float(np.percentile(errors, _PERCENTILE))))
        render(0, truth[1], truth[0], "ground truth")
        for column, (candidate, error) in enumerate(zip(candidates, errors, strict=True), start=1):
            text = f"SSIM {candidate['ssim']:.4f}   $10^3\\,\\Delta E_{{ITP}}$ {candidate['delta_E_ITP_1000']:.2f}"
            render(column, candidate["image"], candidate["label"], text)
            axes(column, 0).imshow(error, cmap="inferno", norm=scale)

        # the place under the ground truth has no error map to show: name and colour scale go there
        legend = axes(0, 0)
        legend.text(0.5, 0.75, title or "", ha="center", fontsize=11, fontweight="bold")
        bar = legend.inset_axes((0.08, 0.42, 0.84, 0.07))
        figure.colorbar(ScalarMappable(scale, "inferno"), cax=bar, orientation="horizontal", extend="max")
        bar.tick_params(labelsize=8)
        bar.set_title("error: $10^3\\,\\Delta E_{ITP}$ of each pixel", fontsize=9)
