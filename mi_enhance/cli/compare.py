"""``mi-enhance compare``"""

from __future__ import annotations

import argparse
import dataclasses

from . import arguments
from .outputs import output_folder
from .progress_bar import progress_bar


def add(subparsers: arguments.Subparsers) -> None:
    text = "SSIM, Delta E_ITP and log-L1 of the enhanced and the analytic model, fitted to measured files"
    p = arguments.command(subparsers, "compare", text, run)
    p.add_argument("data", metavar="DATA", nargs="+", help=f"{arguments.MEASURED}; RGL files are rendered as the truth")
    arguments.add_material(p)
    arguments.add_model(p)
    arguments.add_method(p)
    arguments.add_samples(p)
    arguments.add_variant(p)
    arguments.add_output_folder(p, "compare")
    p.add_argument("--scene", default="shader_ball", help="bundled scene or .xml file (default: %(default)s)")
    p.add_argument(
        "--resolution", type=arguments.picture_size, default=256, help="pixels on a side (default: %(default)s)"
    )
    p.add_argument("--spp", type=arguments.positive, default=256, help="samples per pixel (default: %(default)s)")


def run(args: argparse.Namespace) -> dict:
    folder = output_folder(args.output)
    arguments.set_variant(args.variant)
    from ..evaluation.compare import compare_files, default_models
    from ..output.table import print_table

    models = default_models(arguments.model(args.model))
    with progress_bar("compare", quiet=args.json) as progress:
        result = compare_files(
            args.data,
            folder,
            material=args.material,
            models=models,
            method=args.method,
            n_samples=args.samples,
            seed=args.seed,
            scene=args.scene,
            resolution=args.resolution,
            spp=args.spp,
            progress=progress,
        )
    print_table(result.rows + result.mean)
    return dataclasses.asdict(result)
