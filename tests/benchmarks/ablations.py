"""The paper's ablations (section 7.2), one row each, all by the search itself: same materials, samples, seed and steps.

``search``: the hypercube search. A state that is given (the paper's, all slots neural, other module sizes) is a search
whose slots are all fixed, trained for as many epochs as the search spent on the way to its result. ``--only`` picks
rows. With ``--rgl`` every network is fitted to measured files that nothing here was trained or tuned on. Each run
has a folder below ``-o`` and goes on where it stopped. Writes ``ablations.csv``, ``.json``, ``.md`` and ``.png``.
"""

from __future__ import annotations

import dataclasses
import json
import multiprocessing
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import mi_enhance  # noqa: F401  (first: it finds the LLVM that Dr.Jit then loads)

import mitsuba as mi  # isort: skip
import common
import numpy as np

from mi_enhance import data, models
from mi_enhance.benchmark.residual_model import LARGE, SMALL, with_residual
from mi_enhance.benchmark.timing import machine
from mi_enhance.fitting.fit import fit
from mi_enhance.hypercube import candidate, judging, setup
from mi_enhance.hypercube.search import search
from mi_enhance.material.material import Material
from mi_enhance.output.figure import sheet
from mi_enhance.output.table import write_table
from mi_enhance.system.files import replacing
from mi_enhance.training.analytic_start import analytic_start, representative, validate
from mi_enhance.training.sources import sources_of
from mi_enhance.training.trainer import Trainer
from mi_enhance.training.training_set import TrainingSet

PAPER = ("F", "F*G", "G", "1/E")
RESIDUALS = {"residual 32-64-64-16": SMALL, "residual 32-64-128-128-64": LARGE}
RAW = {"inputs": "directions", "modulated": False}  # the paper's networks
SEARCHED = {"modules": [[16, 32, 16], [32, 32, 32]]}  # what the shipped networks were chosen from
SIZES = ([8, 16, 8], [16, 16, 16], [16, 32, 16], [32, 32, 32])
_COLUMNS = {
    "row": ("variant", ""),
    "equation": ("state", ""),
    "n_weights": ("weights", ",d"),
    "cost": ("1,000 multiply-adds", ".2f"),
    "epochs": ("epochs", ".0f"),
    "loss": ("samples aside", ".5f"),
    "validation": ("materials aside", ".5f"),
    "rgl": ("RGL", ".5f"),
    "seconds": ("s", ".0f"),
}


def rows(model: str, found: list[str]) -> dict[str, dict]:
    """Settings of every variant by name; `found` are the slots that the search replaced."""
    slots = models.get(model).graph.slots
    state = lambda neural: {slot: "neural" if slot in neural else "analytic" for slot in slots}  # noqa: E731
    return {
        "search": SEARCHED,
        "paper's state": {"fixed": state(PAPER)},
        "paper's state, paper's inputs": {"fixed": state(PAPER), **RAW},
        "all slots neural": {"fixed": state(slots)},
        **{name: {} for name in RESIDUALS},
        **{f"modules {'x'.join(map(str, s))}": {"fixed": state(found), "modules": [s]} for s in SIZES},
        **{f"{n} latent numbers": {"fixed": state(found), "n_latent": n} for n in (8, 27, 48)},
        "search, nodes only": {**SEARCHED, "nodes_only": True},
        "search, a third of the epochs": {**SEARCHED, "epochs_factor": 1 / 3},
        "search, 5/3 of the epochs": {**SEARCHED, "epochs_factor": 5 / 3},
        "search, paper's inputs": RAW,
        "search, own inputs": {**SEARCHED, "inputs": "own"},
        "search, Hamming distance 2": {"distance": 2},
    }


def main() -> None:
    """Run the benchmark of the command line."""
    parser = common.parser(__doc__)
    parser.add_argument("--model", default="ggx", help="analytic model (default: %(default)s)")
    parser.add_argument("--only", action="append", help="a variant; repeatable (default: all but distance 2)")
    parser.add_argument(
        "--epochs", type=float, default=10, help="between changes; the paper: 30 (default: %(default)s)"
    )
    parser.add_argument("--scale", type=float, default=1, help="of the number of materials (default: %(default)s)")
    parser.add_argument("--rgl", nargs="*", default=[], help="measured files to fit")
    parser.add_argument("--samples", type=int, default=20_000, help="per RGL file (default: %(default)s)")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("-o", "--output", default="out/ablations", help="folder (default: %(default)s)")
    args = parser.parse_args()
    mi.set_variant("llvm_ad_rgb")
    about = machine()
    Path(args.output).mkdir(parents=True, exist_ok=True)
    sources, unseen = (sources_of(f"mi_enhance/networks/{name}.json") for name in ("materials", "unseen"))
    sources = [{**s, "count": round(s["count"] * args.scale)} if "count" in s else s for s in sources]
    with ProcessPoolExecutor(args.workers, mp_context=multiprocessing.get_context("spawn")) as pool:
        run = Run(args, sources, unseen, pool)
        results = [run.row("search", SEARCHED)]
        variants = rows(args.model, run.found)
        names = args.only or [n for n in variants if n != "search, Hamming distance 2"]
        print(results[0], flush=True)
        for name in names:
            if name == "search":
                continue
            results.append(run.residual(name) if name in RESIDUALS else run.row(name, variants[name]))
            print(results[-1], flush=True)
            write_table(results, Path(args.output) / "ablations", _COLUMNS)
    _plot(results, Path(args.output) / "ablations.png")
    common.finish(
        results, _COLUMNS, title=f"{args.model}, {args.epochs:g} epochs between changes", about=about, as_json=args.json
    )


class Run:
    """What all variants share, and the outcome of the first: the search, whose budget the others get."""

    def __init__(self, args, sources: list[dict], unseen: list[dict], pool):
        self.args, self.sources, self.unseen, self.pool = args, sources, unseen, pool
        self.found, self.epochs = [], None

    def row(self, name: str, settings: dict) -> dict:
        """One variant: what it found or was given, its errors, its cost."""
        settings = dict(settings)
        given = "fixed" in settings
        epochs = self.args.epochs * settings.pop("epochs_factor", 1)
        settings = {"batch": 32, **settings, "epochs": self.epochs if given else epochs}
        pool = None if given else self.pool  # a single candidate has the whole machine
        folder = self._folder(name)
        found = search(self.args.model, self.sources, folder, validation=self.unseen, executor=pool, **settings)
        if name == "search":
            self.found = list(found.material.brdf.modules)
            self.epochs = epochs * len(found.stages)
        last = found.stages[-1]
        row = {
            "row": name,
            "equation": last["equation"],
            "order": ", ".join(s["change"] for s in found.stages),
            "n_weights": found.material.brdf.n_weights,
            "cost": last["cost"],
            "epochs": settings["epochs"] * len(found.stages),
            "loss": last["loss"],
            "validation": last["validation"],
            "seconds": sum(s["seconds"] for s in found.stages),
        }
        return row | self._rgl(found.material, folder)

    def residual(self, name: str) -> dict:
        """The analytic model with a residual network, trained with the same samples and number of steps."""
        folder = self._folder(name)
        shared = setup.Setup.of(self._folder("search"))
        steps = round(self.epochs * shared.steps / self.args.epochs)
        settings = dataclasses.replace(shared.training(0), batch=32, steps=steps)
        samples, aside = shared.samples
        brdf = with_residual(self.args.model, RESIDUALS[name], n_latent=shared.settings.n_latent)
        start = analytic_start(brdf, samples, folder.with_suffix(".npz"))
        folder.mkdir(exist_ok=True)
        trainer = Trainer(brdf, samples, settings, start)
        candidate.run(trainer, folder / "checkpoint.npz", lambda losses: print(name, len(losses), flush=True))
        brdf, values = trainer.result(), trainer.parameters()
        unseen = TrainingSet.read(self._folder("search") / "validation.npz")
        row = {
            "row": name,
            "equation": f"{models.get(self.args.model)} + [R]",
            "n_weights": brdf.n_weights,
            "cost": brdf.multiply_adds / 1000,
            "epochs": self.epochs,
            "loss": judging.judge(brdf, values, aside),
            "validation": float(validate(brdf, unseen, analytic_start(brdf, unseen, folder / "unseen.npz")).mean()),
        }
        return row | self._rgl(Material(brdf, {}, library=values[representative(samples.kinds)]), folder)

    def _folder(self, name: str) -> Path:
        return Path(self.args.output) / common.folder_name(f"{self.args.model} {name}")

    def _rgl(self, network: Material, folder: Path) -> dict:
        """Mean error of fits to measured files, kept beside the run."""
        file = folder / "rgl.json"
        errors = json.loads(file.read_text()) if file.exists() else {}
        for path in self.args.rgl:
            key = f"{Path(path).stem} {self.args.samples}"
            if key not in errors:
                errors[key] = fit(network, data.load(path, n_samples=self.args.samples)).report["log_l1"]
                with replacing(file) as temporary:
                    Path(temporary).write_text(json.dumps(errors))
        keys = [f"{Path(path).stem} {self.args.samples}" for path in self.args.rgl]
        return {"rgl": float(np.mean([errors[k] for k in keys]))} if keys else {}


def _plot(results: list[dict], path: Path) -> None:
    """Error of unseen materials against the cost of one evaluation."""
    key = "rgl" if "rgl" in results[0] else "validation"
    with sheet(path, (9, 6), 100) as figure:
        axes = figure.add_subplot()
        for r in results:
            axes.plot(r["cost"], r[key], "o", color="tab:orange" if r["row"] == "search" else "tab:blue")
            axes.annotate(r["row"], (r["cost"], r[key]), fontsize=7, xytext=(4, 3), textcoords="offset points")
        axes.set(xlabel="1,000 multiply-adds of one evaluation", ylabel=f"log-L1, {_COLUMNS[key][0]}", yscale="log")
        axes.grid(alpha=0.3, which="both")


if __name__ == "__main__":
    main()
