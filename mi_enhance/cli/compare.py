"""``mi-enhance compare``"""

from __future__ import annotations

import argparse
import dataclasses

from .arguments import _network, _set_variant


def compare(args: argparse.Namespace) -> dict:
    _set_variant(args.variant)
    from ..evaluation.compare import compare_files, default_models
    from ..output.table import print_table

    result = compare_files(
        args.data,
        args.output,
        models=default_models(_network(args.network)),
        method=args.method,
        n_samples=args.samples,
        seed=args.seed,
        scene=args.scene,
        resolution=args.resolution,
        spp=args.spp,
        progress=lambda progress: print(progress.stage),
    )
    print_table(result.rows + result.mean)
    return dataclasses.asdict(result)
