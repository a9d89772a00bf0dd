"""``mi-enhance convert``"""

from __future__ import annotations

import argparse

from . import arguments
from .outputs import made, output_file


def add(subparsers: arguments.Subparsers) -> None:
    p = arguments.command(subparsers, "convert", "write measurements of any readable kind as a table", run)
    arguments.add_measurements(p)
    arguments.add_samples(p)
    arguments.add_variant(p)
    arguments.add_output_file(p, "TABLE", "the table, .csv or .npz")


def run(args: argparse.Namespace) -> dict:
    output = output_file(args.output, (".csv", ".npz"), [args.data])
    arguments.set_variant(args.variant)
    from ..data.loading import save_table

    measurements = arguments.measurements(args)
    save_table(measurements, made(output))
    print(f"{output}: {len(measurements.f)} samples of {measurements.name}")
    return {
        "output": str(output),
        "name": measurements.name,
        "n_samples": len(measurements.f),
        "clamped_fraction": measurements.clamped_fraction,
    }
