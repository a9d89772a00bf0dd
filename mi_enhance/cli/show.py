"""``mi-enhance show``"""

from __future__ import annotations

import argparse

from .arguments import _output, _set_variant


def show(args: argparse.Namespace) -> dict:
    output = _output(args.output, (".bsdf",)) if args.output else None
    _set_variant(args.variant)
    from ..material.material import Material

    material = Material.load(args.file)
    if args.edits:
        material = material.edit(**dict(args.edits))
    if output:
        material.save(output)
    text = material.show()
    print(text)
    return {"text": text, "output": str(output) if output else None}
