"""``mi-enhance bench``"""

from __future__ import annotations

import argparse
import dataclasses

from ..system.progress import silent
from .arguments import _set_variant


def bench(args: argparse.Namespace) -> dict:
    _set_variant(args.variant)
    from ..benchmark.benchmark import COLUMNS, bench
    from ..benchmark.growth import GROWTH_COLUMNS
    from ..output.table import print_table
    from ..system.bundled_files import demo_data

    result = bench(
        args.data or [demo_data("satin_rosaline_rgb.bsdf")],
        args.output,
        resolution=args.resolution,
        spp=args.spp,
        rounds=args.rounds,
        n_samples=args.samples,
        seed=args.seed,
        progress=silent if args.json else lambda progress: print(progress.stage),
    )
    print_table(result.rows, COLUMNS, title=", ".join(result.materials))
    print_table(result.growth, GROWTH_COLUMNS, title="how the time of a frame grows")
    print(f"{result.files['html']}\n" + ", ".join(f"{k} {v}" for k, v in result.machine.items()))
    return dataclasses.asdict(result)
