"""``mi-enhance bench``"""

from __future__ import annotations

import argparse
import dataclasses

from . import arguments, executors
from .outputs import output_folder
from .progress_bar import progress_bar


def add(subparsers: arguments.Subparsers) -> None:
    text = "error against run time of every model on this machine, as table, plot and HTML page"
    p = arguments.command(subparsers, "bench", text, run)
    p.add_argument("data", metavar="DATA", nargs="*", help=f"{arguments.MEASURED} (default: the one of the demo)")
    arguments.add_material(p)
    arguments.add_model(p, default=None)
    arguments.add_samples(p)
    arguments.add_variant(p)
    arguments.add_output_folder(p, "bench")
    p.add_argument(
        "--resolution", type=arguments.picture_size, default=256, help="pixels on a side (default: %(default)s)"
    )
    p.add_argument("--spp", type=arguments.positive, default=64, help="samples per pixel (default: %(default)s)")
    p.add_argument("--rounds", type=arguments.positive, default=5, help="interleaved runs (default: %(default)s)")
    executors.add_workers(p, "fits the models of a file; run times are always those of this machine")


def run(args: argparse.Namespace) -> dict:
    executors.check(args)
    folder = output_folder(args.output)
    arguments.set_variant(args.variant)
    from ..benchmark.benchmark import COLUMNS, bench
    from ..benchmark.growth import GROWTH_COLUMNS
    from ..output.table import print_table
    from ..system.bundled_files import demo_data

    model = arguments.model(args.model) if args.model else None
    with executors.executor(args) as pool, progress_bar("bench", quiet=args.json) as progress:
        result = bench(
            arguments.files(args.data, "bench") or [demo_data("satin_rosaline_rgb.bsdf")],
            folder,
            resolution=args.resolution,
            spp=args.spp,
            rounds=args.rounds,
            n_samples=args.samples,
            seed=args.seed,
            model=model,
            material=args.material,
            executor=pool,
            progress=progress,
        )
    print_table(result.rows, COLUMNS, title=", ".join(result.materials))
    print_table(result.growth, GROWTH_COLUMNS, title="how the time of a frame grows")
    print(f"{result.files['html']}\n" + ", ".join(f"{k} {v}" for k, v in result.machine.items()))
    return dataclasses.asdict(result)
