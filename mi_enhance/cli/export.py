"""``mi-enhance export``"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from typing import Any

from . import arguments
from .outputs import made, output_file
from .progress_bar import progress_bar


def add(subparsers: arguments.Subparsers) -> None:
    text = "write a material as a file that other programs read: shaders, NumPy, measurements, other models"
    p = arguments.command(subparsers, "export", text, run)
    p.formatter_class, p.epilog = _WithKinds, _KINDS
    p.add_argument("file", metavar="MAT", help="a material .bsdf; for some kinds also a measured file, see below")
    arguments.add_material(p)
    arguments.add_edits(p)
    arguments.add_define(p, "kind of file")
    arguments.add_variant(p)
    arguments.add_output_file(p, "FILE", "the file to be written; its suffix says which kind")


_KINDS = "kinds of FILE"


class _WithKinds(argparse.RawDescriptionHelpFormatter):
    """Lists the kinds of files when the help is printed, and not before: their modules have to be imported for it."""

    def add_text(self, text: str | None) -> None:
        super().add_text(_kinds() if text == _KINDS else text)


def _kinds() -> str:
    from ..export.registry import exporters

    lines = [f"{_KINDS}, and what -D can set for each:"]
    for kind in exporters().values():
        lines.append(f"  {kind.suffix:<9} {kind.about}{' (also of a measured file)' if kind.measured else ''}")
        lines += [f"{'':<12}-D {name}={value}" for name, value in kind.options.items()]
    return "\n".join(lines)


def run(args: argparse.Namespace) -> dict:
    from ..export.registry import export_material, exporters, read_source

    kinds = exporters()
    output = output_file(args.output, tuple(kinds), [args.file])
    takes_progress = kinds[output.suffix.lower()].takes_progress
    arguments.set_variant(args.variant)
    source = read_source(args.file)
    if args.edits:
        if not hasattr(source, "edit"):
            raise ValueError(f'--set: "{args.file}" is a measured file, which has no parameters to edit.')
        source = source.edit(**dict(args.edits))
    with progress_bar("export", quiet=args.json or not takes_progress) as progress:
        options = arguments.settings(args.define) | ({"material": args.material} if args.material else {})
        facts = export_material(source, made(output), progress=progress, **options)
    print(f"{output}: {said(facts)}")
    return {"output": str(output), **facts}


def said(facts: Mapping[str, Any]) -> str:
    """Return what an exporter says of its file as one line."""
    return ", ".join(f"{name} {_shown(value)}" for name, value in facts.items())


def _shown(value: object) -> str:
    if isinstance(value, list):
        return " ".join(map(_shown, value))
    return f"{value:,}" if isinstance(value, int) else f"{value:.4g}" if isinstance(value, float) else str(value)
