"""``mi-enhance convert``"""

from __future__ import annotations

import argparse

from .arguments import _measurements, _output, _set_variant


def convert(args: argparse.Namespace) -> dict:
    output = _output(args.output, (".csv", ".npz"))
    _set_variant(args.variant)
    from ..data.loading import save_table

    measurements = _measurements(args)
    save_table(measurements, output)
    print(f"{output}: {len(measurements.f)} samples of {measurements.name}")
    return {
        "output": str(output),
        "name": measurements.name,
        "n_samples": len(measurements.f),
        "clamped_fraction": measurements.clamped_fraction,
    }
