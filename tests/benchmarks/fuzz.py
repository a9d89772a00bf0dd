"""Damaged files for every reader, in processes of their own: inputs tried, how many were refused, crashes, memory.

A file that ends the process, or raises anything but a ValueError that names it, is kept in the folder that is printed.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import mi_enhance  # noqa: F401  (first: it finds the LLVM that Dr.Jit then loads)

import mitsuba as mi  # isort: skip
import common
import numpy as np

from mi_enhance.benchmark.timing import machine, peak_megabytes

sys.path.append(str(Path(__file__).resolve().parents[1]))  # the tests: readers and damage

import fuzzing  # noqa: E402

_COLUMNS = {
    "reader": ("reader", ""),
    "tried": ("inputs", ",d"),
    "read": ("read", ",d"),
    "refused": ("refused", ",d"),
    "wrong": ("other errors", ",d"),
    "crashes": ("crashes", ",d"),
    "megabytes_before": ("MB before", ".0f"),
    "megabytes": ("largest MB", ".0f"),
}


def main() -> None:
    """Run the benchmark of the command line."""
    parser = common.parser(__doc__)
    parser.add_argument("--inputs", type=int, default=1000, help="for each reader; MERL, 35 MB each, has a fiftieth")
    parser.add_argument("--readers", nargs="+", default=list(fuzzing.READERS), choices=list(fuzzing.READERS))
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--child", help=argparse.SUPPRESS)  # the folder of a process that tries one reader
    args = parser.parse_args()
    if args.child:
        print(json.dumps(_try(args.readers[0], Path(args.child), args.inputs, args.seed)))
        return
    from tqdm import tqdm

    about = machine()
    rows = [_row(reader, args) for reader in tqdm(args.readers, desc="readers")]
    total = {"reader": "all", **{k: sum(r[k] for r in rows) for k in ("tried", "read", "refused", "wrong", "crashes")}}
    total["megabytes"] = max(row["megabytes"] for row in rows)
    common.finish([*rows, total], _COLUMNS, title="Damaged files", about=about, as_json=args.json)
    raise SystemExit(bool(total["wrong"] or total["crashes"]))


def _row(reader: str, args) -> dict:
    inputs = max(1, args.inputs // 50) if reader == "MERL" else args.inputs
    row = dict.fromkeys(("tried", "read", "refused", "wrong", "crashes"), 0) | {"reader": reader}
    row |= {"megabytes": 0.0, "megabytes_before": 0.0}
    seed = args.seed
    while row["tried"] < inputs:
        folder = tempfile.mkdtemp(prefix="fuzz-")
        command = [sys.executable, __file__, "--child", folder, "--readers", reader, "--seed", str(seed)]
        command += ["--inputs", str(inputs - row["tried"])]
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode:  # goes on behind the input that ended the process
            print(f"{reader}: process ended with {done.returncode}, input in {folder}\n{done.stderr}", file=sys.stderr)
            row["crashes"] += 1
            row["tried"] += int((Path(folder) / "tried").read_text())
            seed += 1
            continue
        result = json.loads(done.stdout.splitlines()[-1])
        for key, value in result.items():
            row[key] = max(row[key], value) if key.startswith("megabytes") else row[key] + value
    return row


def _try(reader: str, folder: Path, inputs: int, seed: int) -> dict:
    mi.set_variant("llvm_ad_rgb")
    path, content = fuzzing.intact(reader, folder)
    path.write_bytes(content)
    assert fuzzing.attempt(reader, path) == "read", reader  # what is damaged below was whole
    rng = np.random.default_rng(seed)
    result = {"tried": 0, "read": 0, "refused": 0, "wrong": 0, "megabytes_before": peak_megabytes()}
    for _ in range(inputs):
        damaged = fuzzing.damage(content, rng)
        path.write_bytes(damaged)
        result["tried"] += 1
        (folder / "tried").write_text(str(result["tried"]))
        outcome = fuzzing.attempt(reader, path)
        result[outcome if outcome in ("read", "refused") else "wrong"] += 1
        if outcome not in ("read", "refused"):
            kept = folder / f"wrong-{result['tried']}-{path.name}"
            kept.write_bytes(damaged)
            print(f"{reader}: {outcome[:300]} ({kept})", file=sys.stderr, flush=True)
    return result | {"megabytes": peak_megabytes()}


if __name__ == "__main__":
    main()
