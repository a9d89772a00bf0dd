"""Levenberg-Marquardt against the paper's RMSProp recipe: the same samples, in one run, cold and warm.

Cold: the first fit of a fresh process with an empty kernel cache (a temporary DRJIT_CACHE_DIR), so everything is
compiled. Warm: the same fit once more in a process that has compiled before. For each file both methods follow one
another; nothing else may run.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import common

import mi_enhance  # noqa: F401  (first: it finds the LLVM that Dr.Jit then loads)

import mitsuba as mi  # isort: skip

from mi_enhance.benchmark.timing import clock, machine

_COLUMNS = {
    "material": ("material", ""),
    "loss_lm": ("log-L1, LM", ".5f"),
    "loss_rmsprop": ("RMSProp", ".5f"),
    "loss_ratio": ("ratio", ".3f"),
    "cold_lm": ("cold s, LM", ".2f"),
    "cold_rmsprop": ("RMSProp", ".1f"),
    "warm_lm": ("warm s, LM", ".2f"),
    "warm_rmsprop": ("RMSProp", ".1f"),
    "speed_up": ("warm, LM is faster by", ".1f"),
}


def main() -> None:
    """Run the benchmark of the command line."""
    parser = common.parser(__doc__)
    parser.add_argument("data", nargs="*", help="measured files (default: mi_enhance/bundled/rgl/*.bsdf)")
    parser.add_argument("--network", help="network to fit (default: the shipped one)")
    parser.add_argument("--samples", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument(
        "--cold-of", type=int, default=1, help="files whose cold seconds are taken (default: %(default)s)"
    )
    parser.add_argument("--method", help=argparse.SUPPRESS)  # one cold fit, in the child process
    args = parser.parse_args()
    args.data = list(map(str, common.rgl_files(args.data)))
    mi.set_variant("llvm_ad_rgb")
    if args.method:
        print(json.dumps(_fit(args, args.data[0], args.method)))
        return
    about = machine()
    rows = [_row(args, path, cold=k < args.cold_of) for k, path in enumerate(args.data)]
    common.finish(
        [*rows, _mean(rows)], _COLUMNS, title=f"Fits of {args.samples:,} samples", about=about, as_json=args.json
    )


def _row(args, path: str, cold: bool) -> dict:
    row = {"material": Path(path).stem}
    first = {}
    for method in ("lm", "rmsprop"):
        if cold:
            first[method] = _cold(args, path, method)
            row[f"cold_{method}"] = first[method]["seconds"]
    for method in ("lm", "rmsprop"):
        _fit(args, path, method, only_compile=True)
        result = _fit(args, path, method)
        row[f"loss_{method}"], row[f"warm_{method}"] = result["log_l1"], result["seconds"]
    row["loss_ratio"] = row["loss_lm"] / row["loss_rmsprop"]
    row["speed_up"] = row["warm_rmsprop"] / row["warm_lm"]
    return row


_compiled = set()


def _fit(args, path: str, method: str, only_compile: bool = False) -> dict | None:
    """Loss and seconds of a fit; the file is read before the clock starts."""
    from mi_enhance import Material, data, fit

    if only_compile and (method in _compiled):
        return None
    _compiled.add(method)
    network = Material.load(args.network) if args.network else Material.pretrained("ggx2")
    measurements = data.load(path, n_samples=args.samples, seed=args.seed)
    seconds, material = clock(lambda: fit(network, measurements, method=method, seed=args.seed))
    return {"log_l1": material.report["log_l1"], "seconds": seconds}


def _cold(args, path: str, method: str) -> dict:
    """The same fit as the first thing a fresh process does."""
    with tempfile.TemporaryDirectory() as cache:
        command = [sys.executable, __file__, path, "--method", method]
        command += ["--samples", str(args.samples), "--seed", str(args.seed)]
        command += ["--network", args.network] if args.network else []
        environment = {**os.environ, "DRJIT_CACHE_DIR": cache}
        done = subprocess.run(command, capture_output=True, text=True, env=environment)
    if done.returncode:
        raise SystemExit(f"fit_methods.py: the cold fit of {path} failed:\n{done.stderr}")
    return json.loads(done.stdout.splitlines()[-1])


def _mean(rows: list[dict]) -> dict:
    """Means; the ratios are those of the means."""
    mean = {"material": f"mean of {len(rows)}"}
    for key in _COLUMNS:
        values = [row[key] for row in rows if key in row]
        if key != "material" and values:
            mean[key] = sum(values) / len(values)
    mean["loss_ratio"] = mean["loss_lm"] / mean["loss_rmsprop"]
    mean["speed_up"] = mean["warm_rmsprop"] / mean["warm_lm"]
    return mean


if __name__ == "__main__":
    main()
