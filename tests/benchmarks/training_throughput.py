"""Samples/s of training against PyTorch: loss (eq. 1), gradients of all weights and of every material's parameters.

One step is forward and backward of all four networks of the paper's enhanced GGX; the optimizer is left out on both
sides. mi_enhance's step also draws and gathers its batch; PyTorch finds it ready and contiguous. Before the clock
starts, both must agree on loss and gradients. PyTorch runs in two forms, with one thread and with all: its best row
counts.
"""

from __future__ import annotations

import os

# PyTorch's idle OpenMP threads spin by default and take the cores from Dr.Jit's, and from each other on a busy machine:
# a step then takes up to 40 times as long. Read when PyTorch is imported.
os.environ.setdefault("OMP_WAIT_POLICY", "passive")

import mi_enhance  # noqa: E402, F401  (first: it finds the LLVM that Dr.Jit then loads)

import drjit as dr  # isort: skip
import common
import mitsuba as mi
import numpy as np
from torch_model import TorchModel, import_torch

from mi_enhance.analytic import parameter_space
from mi_enhance.benchmark.timing import interleaved, machine, spread
from mi_enhance.data.directions import sample_pairs
from mi_enhance.neural.enhance import enhance
from mi_enhance.training.settings import TrainingSettings
from mi_enhance.training.trainer import Trainer
from mi_enhance.training.training_set import TrainingSet

_TOLERANCE = 1e-4  # relative; float32 sums of 1e5 samples in another order differ by about 1e-6
_COLUMNS = {
    "samples": ("batch", ",d"),
    "label": ("", ""),
    "seconds": ("s per step", ".4f"),
    "seconds_min": ("min", ".4f"),
    "seconds_max": ("max", ".4f"),
    "samples_per_s": ("samples/s", ",.0f"),
    "ratio": ("mi_enhance is faster by", ".2f"),
    "loss_difference": ("loss differs by", ".1e"),
    "weights_difference": ("dW differs by", ".1e"),
    "parameters_difference": ("dp differs by", ".1e"),
}


def main() -> None:
    """Run the benchmark of the command line."""
    parser = common.parser(__doc__)
    parser.add_argument("--torch", metavar="DIR", help="folder PyTorch was installed into, if not this environment")
    parser.add_argument("--materials", type=int, default=500)
    parser.add_argument("--batch", type=int, nargs="+", default=[16, 64, 256], help="samples per material and step")
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--compile", action="store_true", help="also time torch.compile (needs a C++ compiler)")
    args = parser.parse_args()
    torch = import_torch(args.torch)
    mi.set_variant("llvm_ad_rgb")
    about = {**machine(), "torch": torch.__version__, "threads": dr.thread_count()}
    rows = [row for n in args.batch for row in _compare(torch, args.materials, n, args.rounds, args.compile)]
    common.finish(rows, _COLUMNS, title="Training, forward and backward", about=about, as_json=args.json)


def _compare(torch, m: int, n: int, rounds: int, with_compile: bool) -> list[dict]:
    """One row per implementation, for m materials with n samples each."""
    brdf, start, (wi, wo, f) = _problem(m, n)
    rows = np.concatenate([wi, wo, f], -1).reshape(m * n, 9).T.astype(np.float32)
    samples = TrainingSet([str(k) for k in range(m)], ["random"] * m, np.ascontiguousarray(rows), n)
    trainer = Trainer(brdf, samples, TrainingSettings(batch=n), start)
    ours = trainer.gradients()  # a batch of n of n samples is all of them, whatever the random start
    u = parameter_space.Space(brdf.parameters).to_free(start)
    jobs = {"mi_enhance": lambda: _step(trainer)}
    differences = {"mi_enhance": {}}
    for form, folded in (("folded", True), ("plain", False)):
        for compiled in (False, True)[: 1 + with_compile]:
            model = TorchModel(torch, brdf, u, wi, wo, f, folded)
            if compiled:
                model.compile()
            differing = _difference(ours, model, brdf)
            for threads in sorted({1, dr.thread_count()}):
                label = f"PyTorch, {form}{', compiled' * compiled}, {threads} thread{'s' * (threads > 1)}"
                jobs[label] = lambda model=model, threads=threads: _torch_step(torch, model, threads)
                differences[label] = differing
    times = interleaved(jobs, rounds)
    own = spread(times["mi_enhance"])["seconds"]
    result = []
    for label, seconds in times.items():
        row = {"samples": m * n, "label": label, **spread(seconds), **differences[label]}
        result.append({**row, "samples_per_s": m * n / row["seconds"], "ratio": row["seconds"] / own})
    return result


def _torch_step(torch, model: TorchModel, threads: int) -> None:
    torch.set_num_threads(threads)
    model.step()


def _step(trainer: Trainer) -> None:
    _, weights, params = trainer.gradients()
    dr.eval(weights, params)
    dr.sync_thread()


def _problem(m: int, n: int):
    """Random materials and reflectances; weights as imitation leaves them are not needed, any will do."""
    rng = np.random.default_rng(0)
    brdf = enhance("ggx")
    rows = []
    for p in brdf.parameters:
        low, high = (0.05, 0.6) if p.name != "latent" else (0, 1)
        spread_ = 0.1 if p.name in ("n_x", "n_y") else 1
        rows += [spread_ * rng.uniform(low, high, m) for _ in range(p.size)]
    wi, wo = sample_pairs(m * n, seed=0)
    f = rng.lognormal(-1, 1, (m * n, 3))
    return brdf, np.stack(rows, 1), [v.reshape(m, n, 3) for v in (wi, wo, f)]


def _difference(ours, model: TorchModel, brdf) -> dict:
    """Relative differences of loss and gradients; an error if they are not of the same function."""
    loss, gradients = model.step()
    weights, params = model.flat_gradients(gradients, brdf.modules)
    pairs = {"loss": (ours[0], loss.numpy()), "weights": (ours[1], weights), "parameters": (ours[2], params)}
    result = {}
    for name, (a, b) in pairs.items():
        a, b = np.asarray(a, np.float64), np.asarray(b, np.float64)
        result[f"{name}_difference"] = float(np.linalg.norm(a - b) / np.linalg.norm(b))
        if not result[f"{name}_difference"] < _TOLERANCE:
            raise SystemExit(f"training_throughput.py: {name} differ by {result[f'{name}_difference']:.1e}, relative; "
                             f"{_TOLERANCE:g} is allowed. One of the two models is wrong.")  # fmt: skip
    return result


if __name__ == "__main__":
    main()
