"""``mi-enhance view``"""

from __future__ import annotations

import argparse
import tempfile
import webbrowser
from pathlib import Path

from . import arguments
from .outputs import made, output_file


def add(subparsers: arguments.Subparsers) -> None:
    text = "show a material in the browser beside its analytic model and a measurement: a ball, sliders, figures"
    p = arguments.command(subparsers, "view", text, run)
    p.add_argument("file", metavar="MAT.bsdf")
    p.add_argument("data", metavar="DATA", nargs="?", help=f"a measurement to be shown beside it: {arguments.MEASURED}")
    arguments.add_material(p)
    arguments.add_edits(p)
    arguments.add_variant(p)
    arguments.add_output_file(p, "PAGE.html", "write the page instead of opening it", required=False)


def run(args: argparse.Namespace) -> dict:
    output = output_file(args.output, (".html",), [args.file, args.data]) if args.output else None
    arguments.require_data(args)
    arguments.set_variant(args.variant)
    from ..export.viewer import page
    from ..material.material import Material
    from ..system.files import write_text

    material = Material.load(args.file).edit(**dict(args.edits))
    text = page(material, args.data, name=Path(args.file).stem, collected=args.material)
    path = made(output) if output else Path(tempfile.mkdtemp(prefix="mi-enhance-")) / f"{Path(args.file).stem}.html"
    write_text(path, text)
    opened = output is None and webbrowser.open(path.as_uri())
    print(f"{path}: {'opened in the browser' if opened else 'open it in a browser'}")
    return {"output": str(path), "bytes": path.stat().st_size, "opened": bool(opened)}
