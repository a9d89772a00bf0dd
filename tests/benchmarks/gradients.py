"""Time of an iteration of differentiable rendering, as a ratio to plain GGX, and of the first one.

A sphere above a plane under even light, through ``prb`` (depth 3): render, mean square, backward, with gradients of all
parameters of the material that its user moves. Every material in a process of its own: Dr.Jit traces whatever BSDF is
alive in a process into each of its renders.

    python tests/benchmarks/gradients.py own.bsdf shared.bsdf
"""

from __future__ import annotations

import multiprocessing
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import mi_enhance  # noqa: F401  (first: it finds the LLVM that Dr.Jit then loads)

import drjit as dr  # isort: skip
import common
import mitsuba as mi
import numpy as np

from mi_enhance import Material
from mi_enhance.benchmark.timing import machine

_COLUMNS = {
    "material": ("material", ""),
    "unknowns": ("unknowns", "d"),
    "first": ("first, s", ".1f"),
    "ms": ("iteration, ms", ".0f"),
    "ratio": ("to GGX", ".2f"),
}
_FIXED = ("n_x", "n_y", "t_theta", "asymmetry", "norm_")  # of no interest to who moves colours and roughnesses
_SPP = 8


def main() -> None:
    """Run the benchmark of the command line."""
    parser = common.parser(__doc__)
    parser.add_argument("materials", nargs="*", help="fitted materials, .bsdf")
    parser.add_argument("--resolution", type=int, default=128)
    parser.add_argument("--rounds", type=int, default=5)
    args = parser.parse_args()
    rows = [_apart(path, args) for path in (None, *args.materials)]
    for row in rows:
        row["ratio"] = row["ms"] / rows[0]["ms"]
    mi.set_variant("llvm_ad_rgb")
    common.finish(rows, _COLUMNS, title="Gradients through prb", about=machine(), as_json=args.json)


def _apart(path: str | None, args) -> dict:
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        return pool.submit(_measure, path, args.resolution, args.rounds).result()


def _measure(path: str | None, resolution: int, rounds: int) -> dict:
    mi.set_variant("llvm_ad_rgb")
    material = Material.load(path) if path else Material.analytic("ggx")
    scene = _scene(material, resolution)
    params = mi.traverse(scene)
    known = {p.name for p in material.brdf.parameters if not p.name.startswith(_FIXED)}
    keys = [k for k in params.keys() if k.rpartition(".")[2] in known]
    times = [_step(scene, params, keys, seed) for seed in range(rounds + 1)]
    name = Path(path).stem if path else "GGX"
    return {"material": name, "unknowns": len(keys), "first": times[0], "ms": 1000 * float(np.median(times[1:]))}


def _scene(material: Material, resolution: int) -> mi.Scene:
    t = mi.ScalarTransform4f
    film = {"type": "hdrfilm", "width": resolution, "height": resolution, "rfilter": {"type": "box"}}
    to_world = t().look_at([0, -4, 1.5], [0, 0, 0], [0, 0, 1])
    return mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "prb", "max_depth": 3},
            "sensor": {"type": "perspective", "fov": 30, "to_world": to_world, "film": film},
            "sphere": {"type": "sphere", "bsdf": material.to_dict()},
            "floor": {"type": "rectangle", "to_world": t().translate([0, 0, -1]).scale(4), "bsdf": {"type": "diffuse"}},
            "light": {"type": "constant"},
        },
        optimize=False,
    )


def _step(scene: mi.Scene, params: mi.SceneParameters, keys: list[str], seed: int) -> float:
    """Return the seconds of one iteration."""
    for key in keys:
        dr.enable_grad(params[key])
    params.update()
    start = time.perf_counter()
    image = mi.render(scene, params, spp=_SPP, seed=seed)
    dr.backward(dr.mean(dr.square(image - 0.5), axis=None))
    dr.eval([dr.grad(params[key]) for key in keys])
    dr.sync_thread()
    return time.perf_counter() - start


if __name__ == "__main__":
    main()
