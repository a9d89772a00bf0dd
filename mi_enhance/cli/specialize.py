"""``mi-enhance specialize``"""

from __future__ import annotations

import argparse

from . import arguments
from .outputs import made, output_file
from .progress_bar import progress_bar


def add(subparsers: arguments.Subparsers) -> None:
    text = "make a material several times cheaper to render, with a stated error"
    p = arguments.command(subparsers, "specialize", text, run)
    p.add_argument("file", metavar="MAT.bsdf")
    p.add_argument("data", metavar="DATA", nargs="?", help="what it was fitted to: the small network then follows that")
    p.add_argument("--material", help="which material, in a data file that holds several")
    arguments.add_samples(p)
    arguments.add_variant(p)
    arguments.add_output_file(p, "FAST.bsdf", "the cheaper material")
    p.add_argument(
        "--max-error",
        type=float,
        default=1e-3,
        help="mean absolute difference of log(1 + f cos) to the exact material, which the file keeps (default: 0.001)",
    )
    p.add_argument(
        "--textured",
        action="store_true",
        help="take the smaller network that all materials share: for maps and textures; best with DATA",
    )
    p.add_argument("--undo", action="store_true", help="go back to the exact material of a specialized one")


def run(args: argparse.Namespace) -> dict:
    output = output_file(args.output, (".bsdf",), [args.file, args.data])
    arguments.set_variant(args.variant)
    from ..material.material import Material
    from ..specialization.specialize import specialize

    material = Material.load(args.file)
    if args.undo:
        if not material.brdf.distilled:
            raise ValueError(
                f'specialize --undo: "{args.file}" keeps no exact material to go back to. Nothing was written.'
            )
        material = material.unspecialized
    else:
        measurements = arguments.measurements(args) if args.data else None
        with progress_bar("specialize", quiet=args.json) as progress:
            material = specialize(
                material,
                measurements,
                max_error=args.max_error,
                textured=args.textured,
                seed=args.seed,
                progress=progress,
            )
    material.save(made(output))
    print(f"{material.show()}\n{output}")
    return {**material.report, "output": str(output)}
