"""``mi-enhance search``"""

from __future__ import annotations

import argparse
import contextlib
import time
from collections.abc import Iterator
from pathlib import Path

from ..system.progress import Callback, silent
from . import arguments
from .executors import add_workers, check, executor
from .outputs import made, output_file, output_folder


def add(subparsers: arguments.Subparsers) -> None:
    text = "find which terms of an analytic model to replace by networks, or go on where a run stopped"
    p = arguments.command(subparsers, "search", text, run)
    # how version 0.1 took the model, and the documentation still does
    p.add_argument("base", nargs="?", metavar="MODEL", help="the model, as with -m")
    arguments.add_model(p, help="analytic model: ggx, ward, ..., or a text file .toml", default=None)
    p.add_argument(
        "--data", action="append", default=[], required=True, metavar="FILES", help="to train on; *, ? and .json lists"
    )
    p.add_argument("--validation", action="append", default=[], metavar="FILES", help="materials to watch only")
    arguments.add_define(p, "settings (mi_enhance.hypercube.settings lists them)")
    arguments.add_variant(p)
    arguments.add_output_file(p, "NET.bsdf", "the network; its run lies in NET.search/")
    add_workers(p, "trains candidates")


def run(args: argparse.Namespace) -> dict:
    model = args.model or args.base
    if model is None or (args.model and args.base):
        raise ValueError("search: needs one model to start from. Give it as -m ggx.")
    check(args)
    settings = arguments.settings(args.define)
    if "model" in settings:
        raise ValueError("-D model: the model is given as -m.")
    files = arguments.files([*args.data, *args.validation], "search")
    output = output_file(args.output, (".bsdf",), files)
    folder = output_folder(output.with_suffix(".search"))
    data, validation = (_sources(names) for names in (args.data, args.validation))
    arguments.set_variant(args.variant)
    from ..hypercube.search import search

    start = time.perf_counter()
    with executor(args) as pool, _table(folder, args.json) as progress:
        found = search(model, data, folder, validation=validation, executor=pool, progress=progress, **settings)
    found.material.save(made(output))
    print(f"{found.material.brdf}\n{output}\n{folder / 'search.png'}")
    return {
        "output": str(output),
        "model": str(found.material.brdf),
        "seconds": time.perf_counter() - start,
        "stages": [{k: v for k, v in s.items() if k != "candidates"} for s in found.stages],
        "pareto": [{k: row[k] for k in ("equation", "loss", "cost")} for row in found.pareto],
    }


def _sources(names: list[str]) -> list[dict]:
    """Return the sources of all materials in the files that `names` stand for."""
    from ..training.sources import sources_of

    return [source for file in arguments.files(names, "search") for source in sources_of(file)]


@contextlib.contextmanager
def _table(folder: Path, quiet: bool) -> Iterator[Callback]:
    """Draw the live table of a search, or nothing."""
    from .live_table import LiveTable

    with contextlib.nullcontext(silent) if quiet else LiveTable(folder) as progress:
        yield progress
