"""Train the network of the 2026 hybrid's form on our training materials: ``mi_enhance/bundled/rivals/hybrid.npz``.

NumPy on one thread or two; a run that was interrupted goes on from the checkpoint in the folder of ``-o``. Sources are
those of ``networks/materials.json`` unless another list is named. For the shipped network RGL is never among them; a
list of RGL files says what the form can do when it is trained on what it is judged by. The last table is of samples
that were kept aside.
"""

from __future__ import annotations

import time
from pathlib import Path

import mi_enhance  # noqa: F401  (first: it finds the LLVM that Dr.Jit then loads)

import mitsuba as mi  # isort: skip
import common
import numpy as np

from mi_enhance import Material, models
from mi_enhance.analytic import parameters
from mi_enhance.benchmark import hybrid
from mi_enhance.benchmark.timing import machine
from mi_enhance.fitting.losses import log_l1
from mi_enhance.neural.enhanced_brdf import EnhancedBRDF
from mi_enhance.training.analytic_start import analytic_start
from mi_enhance.training.sources import build, sources_of

_COLUMNS = {
    "kind": ("kind", ""),
    "n": ("materials", "d"),
    "log_l1": ("log-L1", ".5f"),
    "ggx": ("GGX", ".5f"),
    "ratio": ("ratio", ".2f"),
}


def main() -> None:
    """Run the training of the command line."""
    parser = common.parser(__doc__)
    parser.add_argument("--sources", default="mi_enhance/networks/materials.json")
    parser.add_argument("--steps", type=int, default=20_000, help="(default: %(default)s)")
    parser.add_argument("--per-material", type=int, default=16, help="samples of a step (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("-o", "--output", default="out/hybrid", help="folder (default: %(default)s)")
    args = parser.parse_args()
    mi.set_variant("llvm_ad_rgb")
    folder = Path(args.output)
    common.keep_settings(args)
    everything = build(sources_of(args.sources), n_samples=8192, seed=args.seed, cache=folder / "cache")
    samples, aside = everything.split(4096)
    brdf = EnhancedBRDF(models.get("ggx"), {})
    vectors = analytic_start(brdf, samples, folder / "analytic.npz")
    v = parameters.unflatten(brdf.parameters, vectors.T)
    alpha = np.concatenate([v["alpha_x"], v["alpha_y"]]).T
    start = hybrid.start_from_ggx(v["rho_d"].T, v["rho_s"].T, v["F0"].T, alpha)
    begun, losses = time.process_time(), []

    def tell(progress) -> None:
        losses.append(progress.values["loss"])
        if progress.step % 500 == 0:
            seconds = time.process_time() - begun
            print(f"{progress.step}  {np.mean(losses[-500:]):.5f}  {seconds:.0f} s of processor time", flush=True)

    network, u = hybrid.train_hybrid(
        samples,
        start,
        folder / "checkpoint.npz",
        steps=args.steps,
        per_material=args.per_material,
        seed=args.seed,
        progress=tell,
    )
    np.savez(folder / "hybrid.npz", **network, u=u)
    print(folder / "hybrid.npz")
    rows = [_row(kind, network, u, aside, vectors, brdf) for kind in dict.fromkeys(aside.kinds)]
    common.finish(rows, _COLUMNS, title=f"{args.steps} steps", about=machine(), as_json=args.json)


def _row(kind: str, network: dict, u: np.ndarray, aside, vectors: np.ndarray, brdf) -> dict:
    """Mean errors of the materials of a kind, and of their GGX."""
    errors = []
    for k in np.flatnonzero(np.array(aside.kinds) == kind):
        m = aside.material(k)
        lobe = Material(brdf, parameters.unflatten(brdf.parameters, vectors[k]))
        f = hybrid.evaluate(network, hybrid.Batch.of(m.wi, m.wo), u[k : k + 1])
        errors.append([log_l1(v, m.f, m.wo[:, 2]) for v in (f, lobe.evaluate(m.wi, m.wo))])
    own, ggx = np.mean(errors, 0)
    return {"kind": kind, "n": len(errors), "log_l1": own, "ggx": ggx, "ratio": own / ggx}


if __name__ == "__main__":
    main()
