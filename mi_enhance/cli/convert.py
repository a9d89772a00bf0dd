"""``mi-enhance convert``"""

from __future__ import annotations

import argparse
from pathlib import Path

from . import arguments
from .export import said
from .outputs import made, output_file

_TABLES = (".csv", ".npz")


def add(subparsers: arguments.Subparsers) -> None:
    p = arguments.command(subparsers, "convert", "write measurements of any readable kind as another kind", run)
    arguments.add_measurements(p)
    help_ = "pairs of directions of a .csv or .npz (default: all of a table, 100,000 of another kind)"
    p.add_argument("--samples", type=arguments.positive, help=help_)
    arguments.add_seed(p)
    arguments.add_variant(p)
    arguments.add_output_file(p, "FILE", "RGL .bsdf, MERL .binary, or a table .csv or .npz")


def run(args: argparse.Namespace) -> dict:
    output = output_file(args.output, (*_TABLES, ".bsdf", ".binary"), [args.data])
    arguments.set_variant(args.variant)
    from ..export.registry import export_material

    options = {"samples": args.samples, "seed": args.seed} if output.suffix.lower() in _TABLES else {}
    facts = export_material(Path(args.data), made(output), material=args.material or "", **options)
    print(f"{output}: {said(facts)}")
    return {"output": str(output), **facts}
