"""``mi-enhance demo``: the main job on bundled real data; a measured material in; fits, pictures and a table out."""

from __future__ import annotations

import argparse
import time
from pathlib import Path

from ..system.progress import Callback, silent
from . import arguments
from .outputs import output_folder
from .progress_bar import progress_bar

_MATERIAL = "ilm_solo_m_68_rgb.bsdf"  # blue metallic paint: plain GGX misses the wide base of its highlight


def add(subparsers: arguments.Subparsers) -> None:
    text = "fit a real measured material and render it beside ground truth and plain GGX"
    p = arguments.command(subparsers, "demo", text, run)
    arguments.add_variant(p)
    arguments.add_output_folder(p, "demo")


def run(args: argparse.Namespace) -> dict:
    from ..output.table import COLUMNS, print_table

    folder = output_folder(args.output)
    arguments.set_variant(args.variant)
    with progress_bar("demo", quiet=args.json) as progress:
        result = make_demo(folder, progress=progress)
    columns = {key: value for key, value in COLUMNS.items() if key != "material"}  # one material: the title names it
    print_table(result["rows"], columns, title=f"{result['rows'][0]['material']}: {result['seconds']:.0f} s in all")
    print(f"{result['picture']}\nThe enhanced material is ready for a scene: {result['rows'][-1]['file']}")
    return result


def make_demo(
    folder: str | Path,
    *,
    data: str | Path | None = None,
    resolution: int = 256,
    spp: int = 144,
    seed: int = 0,
    progress: Callback = silent,
) -> dict:
    """Fit plain and enhanced GGX to a measured material, and render both beside it.

    Parameters
    ----------
    folder : str or Path
        Folder for ``comparison.png``, the renders (``.exr``), the fitted materials (``.bsdf``) and ``table.csv``,
        ``.json``, ``.md``.
    data : str or Path, optional
        RGL ``.bsdf``; a bundled one if left out.
    resolution, spp : int
        Pixels on a side and samples per pixel of each of the three renders. By default they take about half a minute
        on 2 cores.
    seed : int
    progress : callable, optional
        Called with a `Progress` before each step.

    Returns
    -------
    dict
        ``picture`` and ``tables`` (paths), ``rows`` as of `compare_file`, ``seconds`` in all.

    Raises
    ------
    RuntimeError
        If no variant is active.

    Examples
    --------
    >>> make_demo("out/demo")  # doctest: +SKIP
    """
    from ..evaluation.compare import compare_file
    from ..output.table import write_table
    from ..system.bundled_files import demo_data

    start = time.perf_counter()
    path = Path(data) if data is not None else demo_data(_MATERIAL)
    folder = Path(folder)
    rows = compare_file(path, folder, resolution=resolution, spp=spp, seed=seed, progress=progress)
    tables = write_table(rows, folder / "table")
    return {
        "picture": str(folder / "comparison.png"),
        "rows": rows,
        "seconds": time.perf_counter() - start,
        "tables": {suffix: str(path) for suffix, path in tables.items()},
    }
