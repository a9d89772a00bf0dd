"""Fits of many files: one process against two workers of this machine, and two of a Dask cluster.

Twenty materials that were never seen, each a file of measurements, through the command line as a user would. The
materials of all runs must be the same to the last digit. Writes ``many_files.csv``, ``.json`` and ``.md``.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import time
from pathlib import Path

import common
import numpy as np

import mi_enhance as me  # (before mitsuba)

import mitsuba as mi  # isort: skip
from mi_enhance.benchmark.timing import machine
from mi_enhance.data.random_terms import assorted
from mi_enhance.output.table import write_table

COLUMNS = {
    "run": ("run", ""),
    "files": ("files", "d"),
    "seconds": ("s", ".0f"),
    "cpu_seconds": ("CPU s", ".0f"),
    "load": ("load of the machine", ".1f"),
    "ratio": ("times one process", ".2f"),
}
CLUSTER = """if __name__ == "__main__":
    import sys
    from distributed import LocalCluster
    with LocalCluster(int(sys.argv[1]), threads_per_worker=1, processes=True, dashboard_address=None) as cluster:
        print(cluster.scheduler_address, flush=True)
        sys.stdin.read()
"""


def fit(files: list[Path], folder: Path, *more: str) -> dict:
    """Return what a run of the command took."""
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    command = [sys.executable, "-m", "mi_enhance", "fit", *map(str, files), "-o", str(folder)]
    subprocess.run([*command, *more], check=True, stdout=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return {"files": len(files), "seconds": time.perf_counter() - start, "cpu_seconds": cpu, "load": os.getloadavg()[0]}


def main() -> None:
    """Run the benchmark of the command line."""
    parser = common.parser(__doc__)
    parser.add_argument("-n", "--count", type=int, default=20, help="files (default: %(default)s)")
    parser.add_argument("--workers", type=int, default=2, help="(default: %(default)s)")
    parser.add_argument("--samples", type=int, default=10_000, help="pairs of each (default: %(default)s)")
    parser.add_argument("-m", "--model", default="ggx2", help="(default: %(default)s)")
    parser.add_argument("-o", "--output", default="out/many_files", help="new folder (default: %(default)s)")
    args = parser.parse_args()
    output = Path(args.output)
    output.mkdir(parents=True)
    mi.set_variant("llvm_ad_rgb")
    files = [output / f"made_up_{k:02}.npz" for k in range(args.count)]
    for k, file in enumerate(files):
        me.data.save_table(assorted(k, args.samples), file)
    rows = []

    how = ["--samples", str(args.samples), "--variant", "llvm_ad_rgb", "-m", args.model, "--own-network", "never"]

    def run(name: str, folder: str, *more: str) -> None:
        rows.append({"run": name, **fit(files, output / folder, *how, *more)})
        rows[-1]["ratio"] = rows[-1]["seconds"] / rows[0]["seconds"]
        print(rows[-1], flush=True)

    n = str(args.workers)
    run("one process", "one")
    run(f"--workers {n}", "workers", "--workers", n)
    pipe = subprocess.PIPE
    with subprocess.Popen([sys.executable, "-c", CLUSTER, n], stdin=pipe, stdout=pipe, text=True) as cluster:
        run(f"--scheduler, {n} workers", "dask", "--scheduler", cluster.stdout.readline().strip())
        cluster.stdin.close()
    for folder in ("workers", "dask"):
        for file in files:
            one, other = (me.load_material(output / f / f"{file.stem}.bsdf").as_vector() for f in ("one", folder))
            np.testing.assert_array_equal(one, other, f"{folder}: {file.stem}")
    write_table(rows, output / "many_files", COLUMNS)
    common.finish(rows, COLUMNS, title="fits of many files", about=machine(), as_json=args.json)


if __name__ == "__main__":
    main()
