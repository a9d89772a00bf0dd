"""A frame of 20 spheres, each of a material of its own, as a ratio to plain GGX, and the tracing that a frame repeats.

Every model in a process of its own, in turn. Tracing: what Python and Dr.Jit need to write down ``eval_pdf`` and
``sample`` of the 20 materials, before any kernel; a frame does so twice.

    python tests/benchmarks/many_materials.py own.bsdf shared.bsdf
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import mi_enhance  # noqa: F401  (first: it finds the LLVM that Dr.Jit then loads)

import drjit as dr  # isort: skip
import common
import mitsuba as mi
import numpy as np

from mi_enhance import Material
from mi_enhance.benchmark.jobs import MANY
from mi_enhance.benchmark.processes import Workers
from mi_enhance.benchmark.timing import machine
from mi_enhance.evaluation import scenes

_COLUMNS = {
    "material": ("material", ""),
    "frame": ("frame, ms", ".0f"),
    "ratio": ("GGX's to it", ".2f"),
    "tracing": ("tracing, ms", ".0f"),
}


def main() -> None:
    """Run the benchmark of the command line."""
    parser = common.parser(__doc__)
    parser.add_argument("materials", nargs="*", help="fitted materials, .bsdf")
    parser.add_argument("--rounds", type=int, default=15)
    args = parser.parse_args()
    mi.set_variant("llvm_ad_rgb")
    paths = {"GGX": None, **{Path(p).stem: p for p in args.materials}}
    seconds = {}
    for job in (_frame, _tracing):
        with Workers(paths) as workers:
            seconds[job] = workers.seconds({name: (job, path) for name, path in paths.items()}, args.rounds)
    rows = [
        {
            "material": name,
            "frame": 1000 * seconds[_frame][name],
            "ratio": seconds[_frame]["GGX"] / seconds[_frame][name],
            "tracing": 1000 * seconds[_tracing][name],
        }
        for name in paths
    ]
    common.finish(rows, _COLUMNS, title=f"{MANY} materials", about=machine(), as_json=args.json)


def _bsdfs(path: str | None) -> list[mi.BSDF]:
    # a tilted normal: fits of GGX have one
    material = Material.load(path) if path else Material.analytic("ggx").edit(alpha_x=0.2, rho_s=0.5, n_x=0.01)
    colours = np.random.default_rng(0).random((MANY, 3)) / 2
    return [material.edit(rho_d=colour).bsdf() for colour in colours]


def _frame(path: str | None) -> Callable:
    scene = scenes.spheres(_bsdfs(path), resolution=256, spp=16)
    return lambda: np.array(mi.render(scene))  # the copy waits for the kernels


def _tracing(path: str | None) -> Callable:
    bsdfs = _bsdfs(path)
    chosen = dr.arange(mi.UInt32, MANY)
    pointers = mi.BSDFPtr(bsdfs[0])
    for k, bsdf in enumerate(bsdfs):
        pointers = dr.select(chosen == k, mi.BSDFPtr(bsdf), pointers)
    si = dr.zeros(mi.SurfaceInteraction3f, MANY)
    si.wi = mi.Vector3f(0, 0.6, 0.8)
    wo, u = mi.Vector3f(0, 0.6, dr.opaque(mi.Float, 0.8, MANY)), dr.opaque(mi.Float, 0.3, MANY)
    dr.make_opaque(si, pointers, wo, u)

    def job(keep: object = bsdfs) -> None:  # pointers do not own what they point to
        pointers.eval_pdf(mi.BSDFContext(), si, wo, True)
        pointers.sample(mi.BSDFContext(), si, u, mi.Point2f(u, u), True)

    return job


if __name__ == "__main__":
    main()
