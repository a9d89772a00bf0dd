"""``mi-enhance fit``"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

from . import arguments, executors
from .outputs import made, output_file, output_folder
from .progress_bar import progress_bar

_COLUMNS = {
    "name": ("file", ""),
    "log_l1": ("log-L1", ".5f"),
    "log_l1_analytic": ("analytic", ".5f"),
    "seconds": ("s", ".1f"),
    "output": ("material", ""),
}


def add(subparsers: arguments.Subparsers) -> None:
    p = arguments.command(subparsers, "fit", "fit a material to measurements, or one to each of several files", run)
    p.add_argument("data", metavar="DATA", nargs="+", help=f"{arguments.MEASURED}; several, or a pattern with * and ?")
    arguments.add_material(p)
    arguments.add_model(p)
    arguments.add_method(p)
    arguments.add_samples(p)
    arguments.add_variant(p)
    arguments.add_output_file(p, "MAT.bsdf", "the material; of several files a folder, for NAME.bsdf of each")
    p.add_argument(
        "--own-network",
        choices=("auto", "always", "never"),
        default="auto",
        help="give the material a small network of its own, which renders almost as fast as GGX: if it is better on "
        "samples that it did not see, always, or never (default: auto)",
    )
    p.add_argument("--reciprocal", action="store_true", help="f(wi, wo) = f(wo, wi), even where the file is not")
    p.add_argument(
        "--bound-energy", action="store_true", help="reflect no more than is received, for every view and edit"
    )
    # its name in version 0.1
    p.add_argument("--energy", dest="bound_energy", action="store_true", help=argparse.SUPPRESS)
    executors.add_workers(p, "fits files")


def run(args: argparse.Namespace) -> dict:
    executors.check(args)
    files = arguments.files(args.data, "fit")
    if len(files) > 1 or not Path(args.output).suffix:
        return _run_several(args, files)
    if args.scheduler or args.workers > 1:
        raise ValueError("fit: --workers and --scheduler share out files. Give several, and a folder as -o.")
    output = output_file(args.output, (".bsdf",), [*files, args.model])
    arguments.set_variant(args.variant)
    from ..fitting.fit import fit
    from ..specialization.fit_best import fit_best

    model, measurements = arguments.model(args.model), arguments.measurements(args, files[0])
    with progress_bar(f"fit {measurements.name}", quiet=args.json) as progress:
        how = {
            "reciprocal": args.reciprocal,
            "bound_energy": args.bound_energy,
            "seed": args.seed,
            "progress": progress,
        }
        if args.method == "rmsprop":  # the paper's recipe, of the shared network
            material = fit(model, measurements, method=args.method, **how)
        else:
            material = fit_best(model, measurements, own=args.own_network, **how)
    material.save(made(output))
    print(f"{material.show()}\n{output}")
    return {**material.report, "output": str(output)}


def _run_several(args: argparse.Namespace, files: list[str]) -> dict:
    """Fit a material to each file, into a folder; what fails is said at the end, and loses nothing else."""
    if Path(args.output).suffix.lower() == ".bsdf":
        raise ValueError(
            f'-o: "{args.output}" is one file, and {len(files)} materials are to be written. Name a folder.'
        )
    folder = output_folder(args.output)
    arguments.set_variant(args.variant)
    from ..output.table import print_table
    from ..specialization.fit_files import fit_files

    start = time.perf_counter()
    with executors.executor(args) as pool, progress_bar("fit", quiet=args.json) as progress:
        fits = fit_files(
            arguments.model(args.model),
            files,
            folder,
            n_samples=args.samples,
            which=args.material,
            method=args.method,
            own=args.own_network,
            reciprocal=args.reciprocal,
            bound_energy=args.bound_energy,
            seed=args.seed,
            executor=pool,
            progress=progress,
        )
    rows = [{**f.report, "name": f.file, "output": f.output} for f in fits if not f.error]
    print_table(rows, _COLUMNS, title=f"{len(rows)} of {len(fits)} files")
    failed = {f.file: f.error for f in fits if f.error}
    for file, error in failed.items():
        print(f'mi-enhance: fit: "{file}" has no material: {error}', file=sys.stderr)
    return {"fits": rows, "failed": failed, "ok": not failed, "seconds": time.perf_counter() - start}
