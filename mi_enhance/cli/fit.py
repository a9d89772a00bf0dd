"""``mi-enhance fit``"""

from __future__ import annotations

import argparse

from .arguments import _measurements, _network, _output, _set_variant


def fit(args: argparse.Namespace) -> dict:
    output = _output(args.output, (".bsdf",))
    _set_variant(args.variant)
    from tqdm import tqdm

    from ..fitting.fit import fit

    measurements = _measurements(args)
    with tqdm(desc=f"fit {measurements.name}", unit=" steps", disable=args.json, leave=False) as bar:

        def progress(p):
            bar.update()
            bar.set_postfix_str(f"{p.stage}, log-L1 {p.values['loss']:.5f}")

        material = fit(
            _network(args.network),
            measurements,
            method=args.method,
            reciprocal=args.reciprocal,
            bound_energy=args.bound_energy,
            seed=args.seed,
            progress=progress,
        )
    material.save(output)
    print(f"{material.show()}\n{output}")
    return {**material.report, "output": str(output)}
