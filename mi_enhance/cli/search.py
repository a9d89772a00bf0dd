"""``mi-enhance search``"""

from __future__ import annotations

import argparse
import contextlib
import time
from collections.abc import Iterator
from pathlib import Path

from ..system.progress import Callback, silent
from .arguments import _json_or_text, _output, _set_variant


def search(args: argparse.Namespace) -> dict:
    output = _output(args.output, (".bsdf",))
    if args.scheduler and args.workers > 1:
        raise ValueError("--workers and --scheduler exclude each other: a Dask cluster has its own workers.")
    if "model" in dict(args.define):
        raise ValueError("-D model: the model is the first argument of the command.")
    data, validation = (_sources(names) for names in (args.data, args.validation))
    _set_variant(args.variant)
    from ..hypercube.search import search

    folder = output.with_suffix(".search")
    start = time.perf_counter()
    with _executor(args) as executor, _table(folder, args.json) as tell:
        found = search(
            args.model,
            data,
            folder,
            validation=validation,
            executor=executor,
            progress=tell,
            **{key: _json_or_text(value) for key, value in args.define},
        )
    found.material.save(output)
    print(f"{found.material.brdf}\n{output}\n{folder / 'search.png'}")
    return {
        "output": str(output),
        "model": str(found.material.brdf),
        "seconds": time.perf_counter() - start,
        "stages": [{k: v for k, v in s.items() if k != "candidates"} for s in found.stages],
        "pareto": [{k: row[k] for k in ("equation", "loss", "cost")} for row in found.pareto],
    }


def _sources(names: list[str]) -> list[dict]:
    """Sources of all materials in the files that `names` stand for."""
    import glob

    from ..training.sources import sources_of

    sources = []
    for name in names:
        files = sorted(glob.glob(name)) if glob.has_magic(name) else [name]
        if not files:
            raise ValueError(f'search: no file matches "{name}". Check the pattern.')
        for file in files:
            sources += sources_of(file)
    return sources


@contextlib.contextmanager
def _table(folder: Path, quiet: bool) -> Iterator[Callback]:
    """Draw the live table of a search, or nothing."""
    from .live_table import LiveTable

    with contextlib.nullcontext(silent) if quiet else LiveTable(folder) as tell:
        yield tell


@contextlib.contextmanager
def _executor(args: argparse.Namespace):
    """What trains the candidates: this process (None), processes of this machine, or a Dask cluster."""
    if args.scheduler:
        try:
            from distributed import Client
        except ImportError:
            raise ImportError('--scheduler needs Dask. Install it: pip install "mi-enhance[cluster]"') from None
        with Client(args.scheduler) as client:
            yield client.get_executor(pure=False)
    elif args.workers > 1:
        import multiprocessing
        from concurrent.futures import ProcessPoolExecutor

        # spawn: Dr.Jit's threads do not survive a fork
        pool = ProcessPoolExecutor(args.workers, mp_context=multiprocessing.get_context("spawn"))
        try:
            yield pool
        finally:
            pool.shutdown(wait=True, cancel_futures=True)
    else:
        yield None
