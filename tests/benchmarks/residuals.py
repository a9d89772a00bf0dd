"""What a fitted model still gets wrong: signed log residuals over theta_h and theta_d, for each channel, as a picture.

Residual: log(1 + f cos) of the measurement minus that of the model, averaged over phi_h and phi_d: red where the model
is too dark, blue where it is too bright. One row for GGX, further analytic models only if asked for, and one for each
network, all with one scale. Right of the dashed line a direction can be beyond 80 degrees.
"""

from __future__ import annotations

from pathlib import Path

import mi_enhance  # noqa: F401  (first: it finds the LLVM that Dr.Jit then loads)

import mitsuba as mi  # isort: skip
import common
import numpy as np
import rivals

from mi_enhance import data
from mi_enhance.data.directions import directions_to_rusinkiewicz
from mi_enhance.fitting.losses import log_l1
from mi_enhance.output.figure import sheet

_BINS = 45  # of 2 degrees for theta_d; those of theta_h are finer near the highlight, as MERL's
_PERCENTILE = 98  # end of the colour scale


def main() -> None:
    """Draw the picture of the command line."""
    parser = common.parser(__doc__)
    parser.add_argument("data", help="measured file")
    parser.add_argument("--material", help="which one, for a file with several")
    rivals.add_options(parser)
    parser.set_defaults(analytic=[rivals.REFERENCE])
    parser.add_argument("-o", "--output", default="out/residuals", help="folder (default: %(default)s)")
    args = parser.parse_args()
    mi.set_variant("llvm_ad_rgb")
    measurements = data.load(args.data, n_samples=args.samples, seed=args.seed, material=args.material)
    folder = Path(args.output) / measurements.name
    folder.mkdir(parents=True, exist_ok=True)
    maps, titles = [], []
    for rival in rivals.ours(args):
        f = rival.fit(measurements, folder).evaluate(measurements.wi, measurements.wo)
        maps.append(residual_map(measurements, f))
        titles.append(f"{rival.label}, log-L1 {log_l1(f, measurements.f, measurements.wo[:, 2]):.4f}")
    path = folder / "residuals.png"
    draw(maps, titles, measurements.name, path)
    print(path)


def residual_map(measurements: data.Measurements, f: np.ndarray) -> np.ndarray:
    """Mean signed log residual in each cell of theta_h and theta_d, (45, 45, 3); NaN where there is no sample."""
    cos = measurements.wo[:, 2:]
    residual = np.log1p(measurements.f * cos) - np.log1p(f * cos)
    theta_h, _, theta_d, _ = directions_to_rusinkiewicz(measurements.wi, measurements.wo)
    places = np.sqrt(theta_h / (np.pi / 2)), theta_d / (np.pi / 2)
    cell = [np.minimum(t * _BINS, _BINS - 1).astype(int) for t in places]
    total, count = np.zeros((_BINS, _BINS, 3)), np.zeros((_BINS, _BINS, 1))
    np.add.at(total, tuple(cell), residual)
    np.add.at(count, tuple(cell), 1)
    with np.errstate(invalid="ignore"):  # 0 / 0: no sample
        return total / count


def draw(maps: list[np.ndarray], titles: list[str], name: str, path: Path) -> None:
    """One row per model, one column per channel."""
    limit = float(np.nanpercentile(np.abs(maps), _PERCENTILE))
    with sheet(path, (9, 3 * len(maps)), 110) as figure:
        axes = figure.subplots(len(maps), 3, squeeze=False, sharex=True, sharey=True)
        edges = np.linspace(0, 1, _BINS + 1)
        line = np.linspace(0, 80)
        for row, values, title in zip(axes, maps, titles, strict=True):
            for ax, channel, colour in zip(row, np.moveaxis(values, -1, 0), ("red", "green", "blue"), strict=True):
                shown = ax.pcolormesh(90 * edges, 90 * edges**2, channel, cmap="RdBu_r", vmin=-limit, vmax=limit)
                ax.set_yscale("function", functions=(lambda y: np.sqrt(np.maximum(y, 0)), np.square))
                ax.set_yticks((0, 1, 5, 10, 20, 40, 60, 90))
                ax.set_facecolor("0.85")
                ax.plot(line, 80 - line, "k--", lw=0.6)
                ax.set_title(colour, fontsize=9)
            row[0].set_ylabel(f"{title}\ntheta_h, degrees", fontsize=9)
        for ax in axes[-1]:
            ax.set_xlabel("theta_d, degrees")
        figure.colorbar(shown, ax=axes, label="log(1 + f cos): measured - model", extend="both", shrink=0.6)
        figure.suptitle(name)


if __name__ == "__main__":
    main()
