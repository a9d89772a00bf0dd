"""``mi-enhance specialize``"""

from __future__ import annotations

import argparse

from .arguments import _measurements, _output, _set_variant
from .progress_bar import progress_bar


def specialize(args: argparse.Namespace) -> dict:
    output = _output(args.output, (".bsdf",))
    _set_variant(args.variant)
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
        measurements = _measurements(args) if args.data else None
        with progress_bar("specialize", quiet=args.json) as tell:
            material = specialize(
                material,
                measurements,
                max_error=args.max_error,
                textured=args.textured,
                seed=args.seed,
                progress=tell,
            )
    material.save(output)
    print(f"{material.show()}\n{output}")
    return {**material.report, "output": str(output)}
