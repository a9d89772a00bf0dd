"""``mi-enhance check``"""

from __future__ import annotations

import argparse
import dataclasses

from . import arguments
from .outputs import output_folder
from .progress_bar import progress_bar


def add(subparsers: arguments.Subparsers) -> None:
    text = "examine a material: NaN, negative values, reciprocity, albedo, chi-square; exit 1 if off"
    p = arguments.command(subparsers, "check", text, run)
    p.add_argument("file", metavar="MAT.bsdf")
    arguments.add_seed(p)
    arguments.add_variant(p)
    p.add_argument("-o", "--output", metavar="DIR", help="folder for the table and a picture (default: print only)")


def run(args: argparse.Namespace) -> dict:
    folder = output_folder(args.output) if args.output else None
    arguments.set_variant(args.variant)
    from ..evaluation.check import COLUMNS, check
    from ..material.material import Material
    from ..output.table import print_table

    material = Material.load(args.file)
    with progress_bar("check", quiet=args.json) as progress:
        result = check(material, folder, seed=args.seed, progress=progress)
    print_table(result.rows, COLUMNS, title=args.file)
    print("\n".join([*result.files.values(), "all as it should be" if result.ok else "something is off"]))
    return dataclasses.asdict(result)
