"""``mi-enhance train``"""

from __future__ import annotations

import argparse
import json

from .arguments import _json_or_text, _set_variant
from .progress_bar import progress_bar


def train(args: argparse.Namespace) -> dict:
    from ..system.files import require_file

    where = f'train "{args.config}"'
    try:
        config = json.loads(require_file(args.config, where).read_text())
        if not isinstance(config, dict):
            raise ValueError("no object { ... }")
    except ValueError as error:
        raise ValueError(f"{where}: no JSON settings ({error}). Write it like the config.json of a run.") from None
    config.update((key, _json_or_text(value)) for key, value in args.define)
    _set_variant(args.variant)
    from ..training.train import train

    with progress_bar("train", quiet=args.json) as tell:
        trainer = train(config, args.output, progress=tell)
    print(f"{args.output}: {trainer.step} steps, {trainer.n_materials} materials")
    return {"output": args.output, "steps": trainer.step, "n_materials": trainer.n_materials}
