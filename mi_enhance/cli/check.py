"""``mi-enhance check``"""

from __future__ import annotations

import argparse

from .arguments import _set_variant


def check(args: argparse.Namespace) -> dict:
    _set_variant(args.variant)
    from tqdm import tqdm

    from ..evaluation.check import COLUMNS, check
    from ..material.material import Material
    from ..output.table import print_table

    material = Material.load(args.file)
    with tqdm(desc="check", unit=" parts", disable=args.json, leave=False) as bar:

        def progress(part):
            bar.update()
            bar.set_postfix_str(part)

        result = check(material, args.output, seed=args.seed, callback=progress)
    print_table(result["rows"], COLUMNS, title=args.file)
    print("\n".join([*result["files"].values(), "all as it should be" if result["ok"] else "something is off"]))
    return result
