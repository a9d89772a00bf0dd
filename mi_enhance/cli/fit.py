"""``mi-enhance fit``"""

from __future__ import annotations

import argparse

from . import arguments
from .outputs import made, output_file
from .progress_bar import progress_bar


def add(subparsers: arguments.Subparsers) -> None:
    p = arguments.command(subparsers, "fit", "fit a material to measurements", run)
    arguments.add_measurements(p)
    arguments.add_model(p)
    arguments.add_method(p)
    arguments.add_samples(p)
    arguments.add_variant(p)
    arguments.add_output_file(p, "MAT.bsdf", "the material")
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


def run(args: argparse.Namespace) -> dict:
    output = output_file(args.output, (".bsdf",), [args.data, args.model])
    arguments.set_variant(args.variant)
    from ..fitting.fit import fit
    from ..specialization.fit_best import fit_best

    model, measurements = arguments.model(args.model), arguments.measurements(args)
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
