"""``mi-enhance plot``"""

from __future__ import annotations

import argparse

from . import arguments
from .outputs import made, output_file
from .progress_bar import progress_bar


def add(subparsers: arguments.Subparsers) -> None:
    text = "draw lobes, slices and albedo of a material, of its analytic ancestor, and of measurements"
    p = arguments.command(subparsers, "plot", text, run)
    p.add_argument("file", metavar="MAT.bsdf")
    p.add_argument("data", metavar="DATA", nargs="*", help=f"measurements to draw beside it: {arguments.MEASURED}")
    arguments.add_material(p)
    arguments.add_edits(p)
    arguments.add_variant(p)
    arguments.add_output_file(p, "PLOT.png", "the picture")


def run(args: argparse.Namespace) -> dict:
    output = output_file(args.output, (".png",), [args.file, *args.data])
    arguments.require_data(args)
    arguments.set_variant(args.variant)
    from ..evaluation.plot import plot
    from ..material.material import Material

    material = Material.load(args.file)
    if args.edits:
        material = material.edit(**dict(args.edits))
    with progress_bar("plot", quiet=args.json) as progress:
        plot(material, *args.data, path=made(output), collected=args.material, progress=progress)
    print(output)
    return {"output": str(output)}
