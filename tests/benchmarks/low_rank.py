"""Error against numbers per material: read-outs of low rank, fitted to few samples of materials kept aside.

20 MERL materials that training keeps aside, 20 mixtures of them times a smooth factor, 20 assorted ones of another
seed; a texel each, errors on samples that no fit saw. Networks are shipped ones by name, or files of
``mi-enhance train CONFIG.json -o DIR --low-rank R`` (``DIR/network.bsdf``), for R of several values.
"""

from __future__ import annotations

from pathlib import Path

import mi_enhance  # noqa: F401  (first: it finds the LLVM that Dr.Jit then loads)

import mitsuba as mi  # isort: skip
import common
import numpy as np

from mi_enhance import Material
from mi_enhance.benchmark.timing import machine
from mi_enhance.fitting.fit_texels import fit_texels, log_l1_of_texels
from mi_enhance.output.figure import sheet
from mi_enhance.training.sources import build

_MERL = {"path": "mi_enhance/bundled/nps/merl.npz", "held_out": "only"}
_SOURCES = [
    {"kind": "nps", **_MERL},
    {"kind": "assorted", "count": 20},
    {"kind": "nps-mixtures", **_MERL, "count": 20, "albedo": [0.2, 1], "warp": True},
]
_SEED, _UNSEEN = 77, 1024  # of the materials; samples that errors are taken of
_COLUMNS = {
    "label": ("model", ""),
    "numbers": ("numbers per material", ""),
    "samples": ("samples", ""),
    "unseen": ("log-L1, unseen", ".5f"),
    "nps": ("MERL aside", ".5f"),
    "assorted": ("assorted", ".5f"),
    "nps-mixtures": ("mixtures, warped", ".5f"),
    "seconds": ("s", ".1f"),
}


def main() -> None:
    """Run the benchmark of the command line."""
    parser = common.parser(__doc__)
    parser.add_argument("networks", nargs="*", default=["ggx2", "ggx2_rgb"], help="names, or .bsdf files")
    parser.add_argument("--samples", type=int, nargs="+", default=[128, 1024], help="per material (default: 128 1024)")
    parser.add_argument("-o", "--output", default="out/low_rank", help="folder of the figure and of decoded samples")
    args = parser.parse_args()
    mi.set_variant("llvm_ad_rgb")
    folder = Path(args.output)
    folder.mkdir(parents=True, exist_ok=True)
    aside = build(_SOURCES, n_samples=max(args.samples) + _UNSEEN, seed=_SEED, cache=folder)
    table = np.ascontiguousarray(aside.samples.reshape(9, len(aside.names), -1).transpose(1, 2, 0))
    kinds, rows = np.array(aside.kinds), []
    for label, material in {"GGX, two lobes": Material.analytic("ggx2"), **_networks(args.networks)}.items():
        for n in args.samples:
            seen, unseen = (
                [part[None, ..., k : k + 3] for k in (0, 3, 6)] for part in (table[:, :n], table[:, -_UNSEEN:])
            )
            found = fit_texels(material, *seen)
            error = log_l1_of_texels(found.maps, *unseen)[0]
            of_kinds = {kind: error[kinds == kind].mean() for kind in sorted(set(kinds))}
            numbers = sum(p.size for p in material.brdf.parameters if not p.fixed)
            row = {"label": label, "numbers": numbers, "samples": n, "unseen": error.mean(), **of_kinds}
            rows.append({**row, "seconds": found.report["seconds"]})
    _draw(rows, args.samples, folder / "low_rank.png")
    common.finish(rows, _COLUMNS, title=f"{len(kinds)} materials kept aside", about=machine(), as_json=args.json)


def _networks(names: list[str]) -> dict[str, Material]:
    """Return networks by label, those with free read-outs in their form of low rank."""
    result = {}
    for name in names:
        material = common.network(name)
        rank = material.brdf.trunk.rank if material.brdf.trunk else 0
        result[f"rank {rank}, {name}" if rank else name] = material
    return result


def _draw(rows: list[dict], counts: list[int], path: Path) -> None:
    """Unseen error over numbers per material, a line for each number of samples."""
    with sheet(path, (6, 4), 110) as figure:
        axes = figure.subplots()
        for n in counts:
            points = sorted((r["numbers"], r["unseen"]) for r in rows if r["samples"] == n and r["label"] != "ggx2")
            (line,) = axes.plot(*zip(*points, strict=True), "o-", label=f"low rank, {n} samples")
            old = [(r["numbers"], r["unseen"]) for r in rows if r["samples"] == n and r["label"] == "ggx2"]
            axes.plot(*zip(*old, strict=True), "x", color=line.get_color(), label=f"ggx2, {n} samples") if old else None
        axes.set(xlabel="numbers per material", ylabel="log-L1, unseen samples", yscale="log")
        axes.legend()


if __name__ == "__main__":
    main()
