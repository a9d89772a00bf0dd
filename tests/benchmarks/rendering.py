"""Mpaths/s of an enhanced material, GGX in Python, Mitsuba's own GGX, principled and measured BRDF: one scene, one run.

Renders are interleaved (A B C A B C) and medians are compared, as ratios to GGX in Python, which is the same plugin
without networks. Besides: the seconds of the first frame with an empty kernel cache, in a fresh process each; and
``eval`` alone, in one kernel of 2^20 lanes, called directly and through a pointer, as the path tracer does.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile

import mi_enhance  # noqa: F401  (first: it finds the LLVM that Dr.Jit then loads)

import drjit as dr  # isort: skip
import mitsuba as mi
import numpy as np
from common import finish

from mi_enhance import Material
from mi_enhance import scene as scenes
from mi_enhance._files import demo_data
from mi_enhance.data.sampling import sample_pairs
from mi_enhance.timing import clock, interleaved, machine, spread

_LANES = 1 << 20
_REFERENCE = "GGX in Python"
_COLUMNS = {
    "scene": ("scene", ""),
    "label": ("BSDF", ""),
    "cold": ("first frame, cold s", ".2f"),
    "seconds": ("s", ".3f"),
    "seconds_min": ("min", ".3f"),
    "seconds_max": ("max", ".3f"),
    "mpaths_per_s": ("Mpaths/s", ".2f"),
    "ratio": (f"to {_REFERENCE}", ".2f"),
    "direct_ns": ("eval, direct ns", ".2f"),
    "pointer_ns": ("by pointer ns", ".2f"),
}


def main() -> None:
    """Run the benchmark of the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scene", nargs="+", default=["sphere_envmap", "shader_ball"])
    parser.add_argument(
        "--material", metavar="MAT.bsdf", help="enhanced material (default: the shipped network, unfitted)"
    )
    parser.add_argument("--fast", metavar="FAST.bsdf", help="specialised material, as one more")
    parser.add_argument("--measured", metavar="DATA.bsdf", default=str(demo_data("satin_rosaline_rgb.bsdf")))
    parser.add_argument("--resolution", type=int, default=256)
    parser.add_argument("--spp", type=int, default=64)
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--no-cold", action="store_true", help="leave the first frames out")
    parser.add_argument("--cold", help=argparse.SUPPRESS)  # one first frame, in the child process
    parser.add_argument("--json", action="store_true", help="print one JSON object last")
    args = parser.parse_args()
    mi.set_variant("llvm_ad_rgb")
    if args.cold:
        print(json.dumps(_first_frame(args)))
        return
    about = {**machine(), "threads": dr.thread_count()}
    rows = [row for scene in args.scene for row in _scene(args, scene)]
    finish(
        rows, _COLUMNS, title=f"{args.resolution} x {args.resolution}, {args.spp} spp", about=about, as_json=args.json
    )


def _bsdfs(args) -> dict[str, dict]:
    """The same look, roughly: alpha 0.2, rho_d 0.5."""
    enhanced = Material.load(args.material) if args.material else Material.network()
    return {
        "enhanced": enhanced.to_dict(),
        **({"specialised": Material.load(args.fast).to_dict()} if args.fast else {}),
        _REFERENCE: Material.analytic("ggx").to_dict(),
        "roughconductor": {"type": "roughconductor", "distribution": "ggx", "alpha": 0.2},
        "principled": {"type": "principled", "roughness": 0.45, "specular": 0.5},
        "measured": {"type": "measured", "filename": args.measured},
    }


def _scene(args, name: str) -> list[dict]:
    """One row per BSDF."""
    bsdfs = {label: mi.load_dict(bsdf) for label, bsdf in _bsdfs(args).items()}
    loaded = {label: scenes.load(name, b, resolution=args.resolution, spp=args.spp) for label, b in bsdfs.items()}
    jobs = {label: lambda s=s: _render(s, args.spp) for label, s in loaded.items()}
    frames = interleaved(jobs, args.rounds, warm_up=1)
    other = mi.load_dict({"type": "diffuse"})
    direct = interleaved({label: _kernel(b, other, pointer=False) for label, b in bsdfs.items()}, args.rounds)
    pointer = interleaved({label: _kernel(b, other, pointer=True) for label, b in bsdfs.items()}, args.rounds)
    reference = spread(frames[_REFERENCE])["seconds"]
    rows = []
    for label, seconds in frames.items():
        row = {"scene": name, "label": label, **spread(seconds)}
        # the sampler may round spp up: what was traced is counted
        paths = args.resolution**2 * loaded[label].sensors()[0].sampler().sample_count()
        row |= {"mpaths_per_s": paths / row["seconds"] / 1e6, "ratio": reference / row["seconds"]}
        row |= {
            f"{kind}_ns": spread(s[label])["seconds"] / _LANES * 1e9
            for kind, s in (("direct", direct), ("pointer", pointer))
        }
        if not args.no_cold:
            row["cold"] = _cold(args, name, label)
        rows.append(row)
    return rows


def _render(scene: mi.Scene, spp: int) -> None:
    np.array(mi.render(scene, spp=spp))  # the copy waits for the kernels


def _kernel(bsdf: mi.BSDF, other: mi.BSDF, pointer: bool):
    """A job that evaluates `bsdf` for 2^20 pairs of directions in one kernel.

    One of the pointers is to `other`: a single instance would be called without any dispatch. Pointers do not own what
    they point to, so the caller keeps both.
    """
    wi, wo = (mi.Vector3f(w.T) for w in sample_pairs(_LANES, seed=0))
    context = mi.BSDFContext()
    lanes = dr.arange(mi.UInt32, _LANES)
    target = dr.select(lanes < _LANES - 1, mi.BSDFPtr(bsdf), mi.BSDFPtr(other)) if pointer else bsdf
    dr.eval(wi, wo, target if pointer else [])

    def job():
        si = dr.zeros(mi.SurfaceInteraction3f, _LANES)
        si.wi = wi
        value = target.eval(context, si, wo, mi.Mask(True))
        dr.eval(value)
        dr.sync_thread()

    return job


def _first_frame(args) -> float:
    """Seconds of scene, tracing, compilation and one sample per pixel; the import of the packages is over."""
    bsdf = _bsdfs(args)[args.cold]

    def job():
        _render(scenes.load(args.scene[0], bsdf, resolution=args.resolution, spp=1), 1)

    return clock(job)[0]


def _cold(args, scene: str, label: str) -> float:
    with tempfile.TemporaryDirectory() as cache:
        command = [sys.executable, __file__, "--cold", label, "--scene", scene, "--measured", args.measured]
        command += ["--resolution", str(args.resolution)] + (["--material", args.material] if args.material else [])
        command += ["--fast", args.fast] if args.fast else []
        environment = {**os.environ, "DRJIT_CACHE_DIR": cache}
        done = subprocess.run(command, capture_output=True, text=True, env=environment)
    if done.returncode:
        raise SystemExit(f"rendering.py: the first frame of {label} failed:\n{done.stderr}")
    return json.loads(done.stdout.splitlines()[-1])


if __name__ == "__main__":
    main()
