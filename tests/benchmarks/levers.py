"""What each lever of the training is worth: short runs on the same materials, budget and seed, one change at a time.

Starts from the settings of the shipped network with fewer materials and steps. Never sees RGL: judged on MERL materials
kept aside, as they are and made bright and warped, and on assorted ones; a fit there is 20 steps of Levenberg-Marquardt
from the analytic fit. Each run has a folder of its own below ``-o`` and goes on where it stopped. Writes
``levers.csv``, ``.json``, ``.md`` and ``levers.png``: validation error against training time.
"""

from __future__ import annotations

import json
from pathlib import Path

import common

import mi_enhance  # noqa: F401  (first: it finds the LLVM that Dr.Jit then loads)

import mitsuba as mi  # isort: skip

from mi_enhance.benchmark.timing import machine
from mi_enhance.output.figure import sheet
from mi_enhance.output.table import write_table
from mi_enhance.training.train import train

_MERL = {
    "kind": "nps",
    "path": "mi_enhance/bundled/nps/merl.npz",
}  # from the root of the repository, as the shipped settings have it
_MIXED = {"kind": "nps-mixtures", "path": "mi_enhance/bundled/nps/merl.npz", "held_out": "without"}
_BRIGHT = {**_MIXED, "count": 120, "albedo": [0.2, 1]}
_WARPED = {**_MIXED, "count": 200, "albedo": [0.2, 1], "warp": True}
_MEASURED = [{**_MERL, "held_out": "without"}, {"kind": "nbrdf", "path": "mi_enhance/bundled/nbrdf/nielsen.npz"}]
_LOBES = [{"kind": "synthetic", "count": 50}, {"kind": "two-lobes", "count": 50}]
_ASSORTED = {"kind": "assorted", "count": 150}
_VALIDATION = [
    {**_MERL, "held_out": "only"},
    {"kind": "assorted", "count": 40},
    {**_WARPED, "held_out": "only", "count": 40},
]
_BASE = {
    "model": "ggx2",
    "replace": ["B", "G", "G2"],
    "inputs": "shape",
    "modulated": True,
    "n_latent": 48,
    "hidden": [24, 24, 24],
    "data": [*_MEASURED, _BRIGHT, _WARPED, *_LOBES, _ASSORTED],
    "validation": _VALIDATION,
    "batch": 40,
    "lr": 4e-3,
    "refits": 1,
}
_PAPER = {
    "model": "ggx",
    "replace": ["F", "F*G", "G", "1/E"],
    "modulated": False,
    "n_latent": 27,
    "hidden": [16, 32, 16],
}
LEVERS = {
    "as shipped": {},
    "paper: its structure, its inputs": {**_PAPER, "inputs": "directions"},
    "paper's structure, symmetric inputs": {**_PAPER, "inputs": "symmetric"},
    "last layers not modulated": {"modulated": False},
    "27 latent numbers": {"n_latent": 27},
    "modules 16-32-16": {"hidden": [16, 32, 16]},
    "no assorted, no warped materials": {"data": [*_MEASURED, {**_MIXED, "count": 240}, *_LOBES]},
    "learning rate 2e-3": {"lr": 2e-3},
}
_COLUMNS = {
    "lever": ("change", ""),
    "loss": ("training", ".5f"),
    "validation nps": ("MERL aside", ".5f"),
    "validation nps-mixtures": ("bright, warped", ".5f"),
    "validation assorted": ("assorted", ".5f"),
    "seconds": ("s", ".0f"),
}


def main() -> None:
    """Run the benchmark of the command line."""
    parser = common.parser(__doc__)
    parser.add_argument("--steps", type=int, default=2000)
    parser.add_argument("--only", action="append", choices=LEVERS, help="repeatable (default: all)")
    parser.add_argument("-o", "--output", default="out/levers", help="folder (default: %(default)s)")
    args = parser.parse_args()
    mi.set_variant("llvm_ad_rgb")
    about = machine()
    curves = {name: _curve(name, args) for name in args.only or LEVERS}
    rows = [{"lever": name, **curve[-1]} for name, curve in curves.items()]
    write_table(rows, Path(args.output) / "levers", _COLUMNS)
    _plot(curves, Path(args.output) / "levers.png")
    common.finish(rows, _COLUMNS, title=f"{args.steps} steps", about=about, as_json=args.json)


def _curve(name: str, args) -> list[dict]:
    """Records of one run, those that hold validation errors."""
    folder = Path(args.output) / common.folder_name(name)
    print(name, flush=True)
    train({**_BASE, "steps": args.steps, **LEVERS[name]}, folder, every=(args.steps // 4, 1))
    lines = (folder / "curve.jsonl").read_text().splitlines()
    return [record for record in map(json.loads, lines) if "validation nps" in record]


def _plot(curves: dict[str, list[dict]], path: Path) -> None:
    """Validation errors over training time, one panel for each set."""
    keys = [key for key in _COLUMNS if key.startswith("validation")]
    with sheet(path, (15, 5), 110) as figure:
        axes = figure.subplots(1, len(keys))
        for axis, key in zip(axes, keys, strict=True):
            for name, curve in curves.items():
                axis.plot([r["seconds"] for r in curve], [r[key] for r in curve], "o-", ms=3, label=name)
            axis.set(title=_COLUMNS[key][0], xlabel="training time, s", ylabel="log-L1", yscale="log")
            axis.grid(alpha=0.3, which="both")
        axes[-1].legend(fontsize=8)


if __name__ == "__main__":
    main()
