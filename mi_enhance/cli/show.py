"""``mi-enhance show``"""

from __future__ import annotations

import argparse

from . import arguments
from .outputs import made, output_file


def add(subparsers: arguments.Subparsers) -> None:
    p = arguments.command(subparsers, "show", "print a material", run)
    p.add_argument("file", metavar="MAT.bsdf")
    arguments.add_edits(p)
    arguments.add_variant(p)
    arguments.add_output_file(p, "NEW.bsdf", "write the edited material (default: print only)", required=False)


def run(args: argparse.Namespace) -> dict:
    output = output_file(args.output, (".bsdf",), [args.file]) if args.output else None
    arguments.set_variant(args.variant)
    from ..material.material import Material

    material = Material.load(args.file)
    if args.edits:
        material = material.edit(**dict(args.edits))
    if output:
        material.save(made(output))
    text = material.show()
    print(text)
    return {"text": text, "output": str(output) if output else None}
