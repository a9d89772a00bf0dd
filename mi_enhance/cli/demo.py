"""The main job on bundled real data: a measured material in; fits, pictures and a table of errors and times out."""

from __future__ import annotations

import argparse
import time
from pathlib import Path

from ..evaluation.compare import compare_file
from ..output.table import COLUMNS, print_table, write_table
from ..system.bundled_files import demo_data
from .arguments import _set_variant

_MATERIAL = "ilm_solo_m_68_rgb.bsdf"  # blue metallic paint: plain GGX misses the wide base of its highlight


def make_demo(folder, *, data=None, resolution=256, spp=144, seed=0):
    """Fit plain and enhanced GGX to a measured material, render both beside it, and print a table.

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
    start = time.perf_counter()
    path = Path(data) if data is not None else demo_data(_MATERIAL)
    folder = Path(folder)
    rows = compare_file(
        path, folder, resolution=resolution, spp=spp, seed=seed, progress=lambda progress: print(progress.stage)
    )
    tables = write_table(rows, folder / "table")
    seconds = time.perf_counter() - start
    columns = {key: value for key, value in COLUMNS.items() if key != "material"}  # one material: the title names it
    title = f"{rows[0]['material']}: {resolution} x {resolution}, {spp} spp, {seconds:.0f} s in all"
    print_table(rows, columns, title=title)
    result = {"picture": str(folder / "comparison.png"), "rows": rows, "seconds": seconds}
    print(f"{result['picture']}\nThe enhanced material is ready for a scene: {rows[-1]['file']}")
    return {**result, "tables": {suffix: str(path) for suffix, path in tables.items()}}


def demo(args: argparse.Namespace) -> dict:
    _set_variant(args.variant)
    return make_demo(args.output)
