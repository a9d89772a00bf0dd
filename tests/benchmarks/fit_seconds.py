"""Seconds of a fit of 1e5 samples: the shared network alone, and with a network of the material's own.

The first file is fitted once before the clock starts, so that everything is compiled. Nothing else may run.
"""

from __future__ import annotations

from pathlib import Path

import mi_enhance as me  # first: it finds the LLVM that Dr.Jit then loads

import mitsuba as mi  # isort: skip
import common
import numpy as np

from mi_enhance.benchmark.timing import clock, machine

_SIZES = (8, 12)
_COLUMNS = {
    "material": ("material", ""),
    "shared": ("shared, s", ".1f"),
    **{f"own{n}": (f"with own {n}-{n}, s", ".1f") for n in _SIZES},
    "loss": ("log-L1, shared", ".5f"),
    **{f"loss{n}": (f"own {n}-{n}", ".5f") for n in _SIZES},
}


def main() -> None:
    """Run the benchmark of the command line."""
    parser = common.parser(__doc__)
    parser.add_argument("data", nargs="*", help="RGL .bsdf (default: mi_enhance/bundled/rgl/*.bsdf)")
    parser.add_argument("--samples", type=int, default=100_000)
    args = parser.parse_args()
    mi.set_variant("llvm_ad_rgb")
    rows = [_row(path, args.samples, is_first=k == 0) for k, path in enumerate(common.rgl_files(args.data))]
    mean = {key: float(np.mean([row[key] for row in rows])) for key in _COLUMNS if key != "material"}
    rows.append({"material": "mean", **mean})
    common.finish(rows, _COLUMNS, title=f"Fits of {args.samples:,} samples", about=machine(), as_json=args.json)


def _row(path: str | Path, n_samples: int, is_first: bool) -> dict:
    measured, network = me.data.load(path, n_samples=n_samples), me.Material.pretrained()
    row = {"material": measured.name}
    fits = {"": ("shared", {"own": "never"})}
    fits |= {str(n): (f"own{n}", {"own": "always", "size": n}) for n in _SIZES}
    for suffix, (key, options) in fits.items():
        for _ in range(1 + is_first):  # the first one of all compiles
            row[key], material = clock(lambda options=options: me.fit_best(network, measured, **options))
        row[f"loss{suffix}"] = material.report["log_l1"]
    return row


if __name__ == "__main__":
    main()
