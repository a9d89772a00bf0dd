"""The pictures of docs/gallery.md: every bundled material as measured, enhanced, as plain GGX, and the two errors.

    python tests/benchmarks/gallery.py -o docs/images/gallery.png

A row for each file of mi_enhance/bundled/rgl (or those given), all models fitted to the same samples; all maps share
one scale. Seven files take two minutes on two cores.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import mi_enhance as me

import mitsuba as mi  # isort: skip
from mi_enhance.output.figure import sheet
from mi_enhance.output.srgb import encode_srgb
from mi_enhance.system.bundled_files import DEFAULT_NETWORK

BUNDLED = Path(me.__file__).parent / "bundled/rgl"
COLUMNS = ("measured", "enhanced", "GGX", "error of enhanced", "error of GGX")


def row(path: Path, network: str, resolution: int, spp: int, n_samples: int) -> dict:
    """Renders of one material, and the errors of each pixel."""
    samples = me.data.load(path, n_samples=n_samples)
    fits = {"enhanced": me.Material.pretrained(network), "GGX": me.Material.analytic("ggx")}
    bsdfs: dict = {"measured": {"type": "measured", "filename": str(path)}}
    bsdfs |= {name: me.fit(start, samples).bsdf() for name, start in fits.items()}
    images = {
        name: np.array(mi.render(me.shader_ball(bsdf, resolution=resolution, spp=spp)))[..., :3]
        for name, bsdf in bsdfs.items()
    }
    errors = {f"error of {name}": me.metrics.delta_E_ITP_map(images[name], images["measured"]) for name in fits}
    return {"name": samples.name, **images, **errors}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="*", type=Path)
    parser.add_argument("-m", "--model", default=DEFAULT_NETWORK, help="the shipped network to fit")
    parser.add_argument("-o", "--output", default="out/gallery.png")
    parser.add_argument("--resolution", type=int, default=128)
    parser.add_argument("--spp", type=int, default=64)
    parser.add_argument("--samples", type=int, default=20_000)
    args = parser.parse_args()
    mi.set_variant("llvm_ad_rgb")
    rows = []
    for path in args.files or sorted(BUNDLED.glob("*.bsdf")):
        rows.append(row(path, args.model, args.resolution, args.spp, args.samples))
        errors = [1000 * float(rows[-1][name].mean()) for name in COLUMNS[3:]]
        print(f"{rows[-1]['name']}: 1000 x Delta E ITP {errors[0]:.2f} enhanced, {errors[1]:.2f} GGX", flush=True)
    top = float(np.percentile([r[name] for r in rows for name in COLUMNS[3:]], 99.5))
    with sheet(args.output, (2 * len(COLUMNS), 2.05 * len(rows)), 72) as figure:
        axes = figure.subplots(len(rows), len(COLUMNS), squeeze=False)
        for r, line in zip(rows, axes, strict=True):
            for name, ax in zip(COLUMNS, line, strict=True):
                ax.imshow(r[name] if "error" in name else encode_srgb(r[name]), cmap="inferno", vmin=0, vmax=top)
                ax.set(xticks=[], yticks=[])
                if ax in axes[0]:
                    ax.set_title(name, fontsize=9)
            line[0].set_ylabel(r["name"], fontsize=9)


if __name__ == "__main__":
    main()
