"""Variance of one sample, relative to the squared albedo, of fits of RGL files: several ways to draw the light.

The cosine alone; the lobes of the fit as they are (what a material without `mixture` does); the mixture of the fit; the
sampler of Mitsuba's `measured`, of the file itself; and the ideal, a density in proportion to |f| cos. Averaged over
the angle of the view; summed over channels, for which the ideal is not 0.
"""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import mi_enhance  # noqa: F401  (first: it finds the LLVM that Dr.Jit then loads)

import drjit as dr  # isort: skip
import common
import mitsuba as mi
import numpy as np

from mi_enhance import data, fit
from mi_enhance.benchmark.timing import clock, machine
from mi_enhance.material.material import Material
from mi_enhance.sampling.lobe_mixture import NODES, Mixture
from mi_enhance.system.files import replacing

_ANGLES, _SAMPLES = (0, 15, 30, 45, 60, 70, 80), 1 << 18
_WAYS = ("cosine", "lobes", "mixture", "measured")
_COLUMNS = {"material": ("material", "")} | {
    key: (key.replace("_", " "), form)
    for way in (*_WAYS, "ideal")
    for key, form in ((way, ".3f"), (f"{way}_ns", ".0f"))
    if not (way == "ideal" and key.endswith("ns"))
}


def main() -> None:
    """Run the benchmark of the command line."""
    parser = common.parser(__doc__)
    parser.add_argument("files", nargs="+", help="RGL .bsdf")
    parser.add_argument("-o", "--output", default="out/variance.json", help="(default: %(default)s)")
    parser.add_argument("--samples", type=int, default=100_000, help="of each file (default: %(default)s)")
    args = parser.parse_args()
    mi.set_variant("llvm_ad_rgb")
    about, rows = machine(), []
    for file in args.files:
        material = fit(Material.pretrained("ggx2"), data.load(file, n_samples=args.samples))
        lobes = len(material.mixture.scales)
        # albedos of 0 leave the lobes their least share: as near to the cosine alone as the plugin goes
        cosine = Mixture((1.0,) * lobes, (*((0.0,) * NODES,) * lobes, (1.0,) * NODES))
        bsdfs = {
            "cosine": dataclasses.replace(material, mixture=cosine).bsdf(),
            "lobes": dataclasses.replace(material, mixture=None).bsdf(),
            "mixture": material.bsdf(),
            "measured": mi.load_dict({"type": "measured", "filename": file}),
        }
        row = {"material": Path(file).stem.removesuffix("_rgb")}
        for way, bsdf in bsdfs.items():
            found = [_variance(bsdf, degrees) for degrees in _ANGLES]
            row[way], row[f"{way}_ns"] = np.mean([v for v, *_ in found]), min(ns for *_, ns in found)
            if way == "mixture":
                row["ideal"] = np.mean([ideal for _, ideal, _ in found])
        rows.append({k: v if isinstance(v, str) else float(v) for k, v in row.items()})
        print(rows[-1], flush=True)
    Path(args.output).parent.mkdir(parents=True, exist_ok=True)
    with replacing(args.output) as temporary:
        Path(temporary).write_text(json.dumps({"machine": about, "rows": rows}, indent=1) + "\n")
    common.finish(rows, _COLUMNS, title="Relative variance of a sample, and ns", about=about, as_json=args.json)


def _variance(bsdf: mi.BSDF, degrees: float) -> tuple[float, float, float]:
    """Sum of the variances of the channels over the sum of the squared albedos; the ideal one; ns of a sample."""
    u = [mi.Float(v) for v in np.random.default_rng(0).random((3, _SAMPLES)).astype(np.float32)]
    si = dr.zeros(mi.SurfaceInteraction3f, _SAMPLES)
    theta = float(np.deg2rad(degrees))
    si.wi = mi.Vector3f(float(np.sin(theta)), 0, float(np.cos(theta)))
    dr.eval(u, si)

    def sample():
        _, weight = bsdf.sample(mi.BSDFContext(), si, u[0], mi.Point2f(u[1], u[2]))
        dr.eval(weight)
        dr.sync_thread()
        return weight

    w = np.array(sample(), np.float64)
    seconds = min(clock(sample)[0] for _ in range(3))
    albedo = np.square(w.mean(1)).sum()
    ideal = np.square(np.linalg.norm(w, axis=0).mean()) / albedo - 1
    return w.var(1).sum() / albedo, ideal, seconds / _SAMPLES * 1e9


if __name__ == "__main__":
    main()
