"""Error against run time of specialised materials: a row for each material and form.

Every material is fitted with the shipped network; then: as it is, without its linear units, distilled at several
``--max-error``, and distilled and refined on the measurements. Log-L1 against the measurements over all of them,
difference to the exact material, multiply-adds, seconds of specialising, and Mpaths/s in one interleaved run, as ratios
to GGX in Python. MERL as NPs' decoder gives it: RGL stays out of what sizes and settings are chosen on.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import mi_enhance  # noqa: F401  (first: it finds the LLVM that Dr.Jit then loads)

import mitsuba as mi  # isort: skip
import numpy as np
from common import finish
from mi_enhance.bsdfs.function import reflectance

from mi_enhance import Material, data, fit, scene, specialize
from mi_enhance.losses import log_l1
from mi_enhance.table import write_table
from mi_enhance.timing import interleaved, machine, spread

_ROOT = Path(__file__).resolve().parents[2]
_MATERIALS = ("gold-metallic-paint", "blue-metallic-paint", "red-fabric", "pink-plastic", "nickel", "alum-bronze")
_ERRORS = (2e-3, 1e-3, 5e-4, 1e-9)  # the last is met by no network: the exact ones without linear units
_COLUMNS = {
    "material": ("material", ""),
    "label": ("form", ""),
    "network": ("network", ""),
    "log_l1": ("log-L1", ".5f"),
    "log_l1_ratio": ("to exact", ".3f"),
    "difference": ("difference to exact", ".5f"),
    "multiply_adds": ("multiply-adds", ",d"),
    "specialize_seconds": ("s", ".1f"),
    "mpaths_per_s": ("Mpaths/s", ".2f"),
    "ratio": ("to GGX in Python", ".3f"),
}


def main() -> None:
    """Run the benchmark of the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", default=_MATERIALS, help="MERL materials (default: six)")
    parser.add_argument("--scene", default="sphere_envmap")
    parser.add_argument("--resolution", type=int, default=256)
    parser.add_argument("--spp", type=int, default=64)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("-o", "--output", default="out/specialised", help="folder (default: %(default)s)")
    parser.add_argument("--json", action="store_true", help="print one JSON object last")
    args = parser.parse_args()
    mi.set_variant("llvm_ad_rgb")
    about = machine()
    rows = [row for name in args.names for row in _material(args, name)]
    Path(args.output).mkdir(parents=True, exist_ok=True)
    write_table(rows, Path(args.output) / "specialised", _COLUMNS)
    finish(rows, _COLUMNS, title=f"{args.scene}, {args.resolution}², {args.spp} spp", about=about, as_json=args.json)


def _material(args, name: str) -> list[dict]:
    measurements = data.load(_ROOT / "data/nps/merl.npz", material=name)
    exact = fit(Material.network(), measurements)
    forms = {"exact": exact, **{f"max error {e:g}": specialize(exact, max_error=e) for e in _ERRORS}}
    forms["refined on the measurements"] = specialize(exact, measurements)
    bsdfs = {"GGX": Material.analytic("ggx").bsdf(), **{label: m.bsdf() for label, m in forms.items()}}
    loaded = {k: scene.load(args.scene, b, resolution=args.resolution, spp=args.spp) for k, b in bsdfs.items()}
    jobs = {label: lambda s=s: np.array(mi.render(s, spp=args.spp)) for label, s in loaded.items()}
    seconds = {k: spread(v)["seconds"] for k, v in interleaved(jobs, args.rounds, warm_up=1).items()}
    errors = {
        k: log_l1(reflectance(bsdfs[k], measurements.wi, measurements.wo), measurements.f, measurements.wo[:, 2])
        for k in forms
    }
    rows = []
    for label, m in forms.items():
        paths = args.resolution**2 * loaded[label].sensors()[0].sampler().sample_count()
        rows.append({
            "material": name,
            "label": label,
            "network": m.report.get("specialize_network"),
            "log_l1": errors[label],
            "log_l1_ratio": errors[label] / errors["exact"],
            "difference": m.report.get("specialize_error"),
            "multiply_adds": m.brdf.multiply_adds,
            "specialize_seconds": m.report.get("specialize_seconds"),
            "mpaths_per_s": paths / seconds[label] / 1e6,
            "ratio": seconds["GGX"] / seconds[label],
        })  # fmt: skip
    return rows


if __name__ == "__main__":
    main()
