"""NLBRDF's architecture, trained on our training materials and fitted to RGL files: log-L1 on unseen samples.

1.06 million weights: a minute of one core is some 400 steps of 2,048 rows. The result says what the budget buys, not
what the form can do with days on a GPU. A run that was interrupted goes on.
"""

from __future__ import annotations

import time
from pathlib import Path

import mi_enhance  # noqa: F401  (first: it finds the LLVM that Dr.Jit then loads)

import mitsuba as mi  # isort: skip
import common
import numpy as np

from mi_enhance import data
from mi_enhance.benchmark import nlbrdf
from mi_enhance.benchmark.nbrdf import nbrdf_features
from mi_enhance.benchmark.timing import machine
from mi_enhance.fitting.losses import log_l1
from mi_enhance.training.sources import build, sources_of

_COLUMNS = {
    "material": ("material", ""),
    "log_l1": ("log-L1", ".5f"),
    "seconds": ("fit s", ".0f"),
    "multiply_adds": ("multiply-adds", ",d"),
    "n_weights": ("weights", ",d"),
}


def main() -> None:
    """Run the benchmark of the command line."""
    parser = common.parser(__doc__)
    parser.add_argument("data", nargs="*", help="RGL .bsdf (default: mi_enhance/bundled/rgl/*.bsdf)")
    parser.add_argument("--sources", default="mi_enhance/networks/materials.json")
    parser.add_argument("--steps", type=int, default=4000, help="(default: %(default)s)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("-o", "--output", default="out/nlbrdf", help="folder (default: %(default)s)")
    args = parser.parse_args()
    mi.set_variant("llvm_ad_rgb")
    folder = Path(args.output)
    common.keep_settings(args)
    samples = build(sources_of(args.sources), n_samples=4096, seed=args.seed, cache=folder / "cache")
    begun, losses = time.process_time(), []

    def tell(progress) -> None:
        losses.append(progress.values["loss"])
        if progress.step % 100 == 0:
            seconds = time.process_time() - begun
            print(f"{progress.step}  {np.mean(losses[-100:]):.5f}  {seconds:.0f} s of processor time", flush=True)

    values = nlbrdf.train_nlbrdf(samples, folder / "checkpoint.npz", steps=args.steps, seed=args.seed, progress=tell)
    rows = [_row(values, path, args.seed) for path in common.rgl_files(args.data)]
    mean = {"material": "mean", **{k: float(np.mean([r[k] for r in rows])) for k in ("log_l1", "seconds")}}
    common.finish([*rows, mean], _COLUMNS, title=f"{args.steps} steps", about=machine(), as_json=args.json)


def _row(values: dict, path, seed: int) -> dict:
    begun = time.perf_counter()
    measured = data.load(path, n_samples=100_000, seed=seed)
    code = nlbrdf.fit_nlbrdf(values, measured, seed=seed)
    seconds = time.perf_counter() - begun
    unseen = data.load(path, n_samples=20_000, seed=seed + 1)
    x = nbrdf_features(unseen.wi, unseen.wo)
    f = np.stack([nlbrdf.evaluate(values, x, latent) for latent in code.latent], 1)
    return {
        "material": measured.name,
        "log_l1": log_l1(f, unseen.f, unseen.wo[:, 2]),
        "seconds": seconds,
        "multiply_adds": nlbrdf.MULTIPLY_ADDS,
        "n_weights": nlbrdf.N_WEIGHTS,
    }


if __name__ == "__main__":
    main()
