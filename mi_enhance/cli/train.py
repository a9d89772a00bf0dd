"""``mi-enhance train``"""

from __future__ import annotations

import argparse
import json

from . import arguments
from .outputs import output_folder
from .progress_bar import progress_bar


def add(subparsers: arguments.Subparsers) -> None:
    text = "train the networks of an enhanced model on many materials, or go on where a run stopped"
    p = arguments.command(subparsers, "train", text, run)
    p.add_argument("config", metavar="CONFIG.json", help="settings that differ from the defaults, the data among them")
    arguments.add_define(p, "settings")
    arguments.add_variant(p)
    arguments.add_output_folder(p, "train", "folder of the run: checkpoint and curve")
    p.add_argument(
        "--low-rank",
        type=arguments.positive,
        metavar="R",
        help="then find, for the read-outs of a trunk, a basis of R numbers for each slot: for texels and photographs",
    )


def run(args: argparse.Namespace) -> dict:
    from ..system.files import require_file

    where = f'train "{args.config}"'
    try:
        config = json.loads(require_file(args.config, where).read_text(encoding="utf-8-sig"))
        if not isinstance(config, dict):
            raise ValueError("no object { ... }")
    except ValueError as error:
        raise ValueError(f"{where}: no JSON settings ({error}). Write it like the config.json of a run.") from None
    config |= arguments.settings(args.define)
    folder = output_folder(args.output)
    arguments.set_variant(args.variant)
    from ..training.train import train

    with progress_bar("train", quiet=args.json) as progress:
        trainer = train(config, folder, progress=progress)
    if args.low_rank:
        from ..training.basis_trainer import train_basis

        with progress_bar("basis", quiet=args.json) as progress:
            train_basis(trainer, folder, rank=args.low_rank, progress=progress)
    print(f"{args.output}: {trainer.step} steps, {trainer.n_materials} materials")
    return {"output": args.output, "steps": trainer.step, "n_materials": trainer.n_materials}
