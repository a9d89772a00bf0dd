"""A planted weakness: materials of a GGX with one altered slot. Does the search from plain GGX replace that slot first?

For each altered term or operator: the change that the first stage chooses, with several seeds, and what all other
candidates are worth. Writes ``planted.csv``, ``.json``, ``.md`` below ``-o``.
"""

from __future__ import annotations

from pathlib import Path

import mi_enhance  # noqa: F401  (first: it finds the LLVM that Dr.Jit then loads)

import drjit as dr  # isort: skip
import mitsuba as mi  # isort: skip
import common
import numpy as np

from mi_enhance import models
from mi_enhance.benchmark.timing import machine
from mi_enhance.data.directions import sample_pairs
from mi_enhance.data.measurements import Measurements
from mi_enhance.hypercube.search import search
from mi_enhance.material.material import Material
from mi_enhance.neural.enhance import enhance
from mi_enhance.output.table import write_table

_GRAPH = models.ggx().graph


def _slopes(q) -> mi.Float:
    """Sum of log(1 + squared slope over roughness) of both directions: what shadowing is made of, azimuth included."""
    slope = lambda w: (dr.square(q["alpha_x"] * w.x) + dr.square(q["alpha_y"] * w.y)) / (dr.square(w.z) + 1e-4)  # noqa: E731
    return dr.log(1 + slope(q["wi"])) + dr.log(1 + slope(q["wo"]))


# What each altered slot computes; a term sees all quantities, an operator its operands.
DEFECTS = {
    "F": lambda q: _GRAPH.find("F")(q) * (0.6 + 0.4 * dr.cos(9 * q["cos_theta_d"])),
    "G": lambda q: _GRAPH.find("G")(q) * (0.55 + 0.45 * dr.cos(3 * _slopes(q))),
    "D": lambda q: _GRAPH.find("D")(q) * (0.55 + 0.45 * dr.cos(14 * q["cos_theta_h"])),
    "F*G": lambda a, b: 0.5 * a * b / (0.05 + a * b),
}
# "own": a network that sees more than its term can make good what another term lacks, and the order says little.
SETTINGS = {"inputs": "own", "modules": [[16, 16]], "n_latent": 4, "imitation_steps": 300, "lr": 1e-2}
SETTINGS |= {"n_samples": 1024, "n_aside": 256, "batch": 128}
_COLUMNS = {
    "defect": ("altered", ""),
    "seed": ("seed", "d"),
    "first": ("replaced first", ""),
    "loss": ("loss", ".5f"),
    "unchanged": ("unchanged", ".5f"),
    "second": ("next best", ""),
    "second_loss": ("its loss", ".5f"),
}


def planted(slot: str, count: int, n_samples: int, seed: int = 0) -> list[Measurements]:
    """Samples of `count` random anisotropic GGX materials with an altered `slot`; dark, so that the lobe shows."""
    rng = np.random.default_rng(seed)
    brdf = enhance("ggx", ())
    graph = brdf.model.graph.replace({slot: DEFECTS[slot]})
    materials = []
    for k in range(count):
        alpha_x, alpha_y = np.exp(rng.uniform(np.log(0.15), np.log(0.7), 2))
        values = {"n_x": 0.0, "n_y": 0.0, "t_theta": 0.0, "rho_d": rng.uniform(0, 0.1, 3), "rho_s": rng.uniform(1, 6)}
        values |= {"alpha_x": alpha_x, "alpha_y": alpha_y, "F0": rng.uniform(0.05, 0.9)}
        params = Material(brdf, values).as_drjit()
        wi, wo = sample_pairs(n_samples, seed=rng)
        _, record, active = brdf.prepare(*(mi.Vector3f(w.T) for w in (wi, wo)), params)
        f = np.array(mi.Color3f(graph(record)) & active).T
        materials.append(Measurements(wi, wo, f, f"{slot}-{k}", "planted"))
    return materials


def first_change(slot: str, folder: Path, *, count: int, seed: int, **settings) -> dict:
    """The first stage of a search on planted materials, and what came second."""
    settings = {**SETTINGS, "max_modules": 1, "seed": seed, **settings}
    n = settings["n_samples"] + settings["n_aside"]
    found = search("ggx", planted(slot, count, n, seed), folder, **settings)
    stage = found.stages[0]
    second = sorted(stage["candidates"], key=lambda row: row["score"])[1]
    return {
        "defect": slot,
        "seed": seed,
        "first": stage["change"],
        "loss": stage["loss"],
        "unchanged": stage["unchanged"],
        "second": second["change"],
        "second_loss": second["loss"],
    }


def main() -> None:
    """Run the benchmark of the command line."""
    parser = common.parser(__doc__)
    parser.add_argument("--only", action="append", choices=DEFECTS, help="repeatable (default: all)")
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--count", type=int, default=8, help="materials (default: %(default)s)")
    parser.add_argument("--epochs", type=float, default=150, help="(default: %(default)s)")
    parser.add_argument("-o", "--output", default="out/planted", help="folder (default: %(default)s)")
    args = parser.parse_args()
    mi.set_variant("llvm_ad_rgb")
    about = machine()
    rows = []
    for slot in args.only or DEFECTS:
        for seed in range(args.seeds):
            name = common.folder_name(slot)
            folder = Path(args.output) / f"{name}-{args.epochs:g}-{seed}"
            rows.append(first_change(slot, folder, count=args.count, seed=seed, epochs=args.epochs))
            print(rows[-1], flush=True)
    write_table(rows, Path(args.output) / "planted", _COLUMNS)
    common.finish(rows, _COLUMNS, title="planted weaknesses", about=about, as_json=args.json)


if __name__ == "__main__":
    main()
