"""``mi-enhance check``"""

from __future__ import annotations

import argparse
import dataclasses

from .arguments import _set_variant
from .progress_bar import progress_bar


def check(args: argparse.Namespace) -> dict:
    _set_variant(args.variant)
    from ..evaluation.check import COLUMNS, check
    from ..material.material import Material
    from ..output.table import print_table

    material = Material.load(args.file)
    with progress_bar("check", quiet=args.json) as tell:
        report = check(material, args.output, seed=args.seed, progress=tell)
    print_table(report.rows, COLUMNS, title=args.file)
    print("\n".join([*report.files.values(), "all as it should be" if report.ok else "something is off"]))
    return dataclasses.asdict(report)
