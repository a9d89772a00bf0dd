"""Errors of specialized materials: a row for each material and form. Run times: ``mi-enhance bench``.

Every material is fitted with the shipped network; then: as it is, without its linear units, distilled at several
``--max-error``, and distilled and refined on the measurements. Log-L1 against the measurements over all of them,
difference to the exact material, multiply-adds and seconds of specializing. MERL as NPs' decoder gives it: RGL stays
out of what sizes and settings are chosen on.
"""

from __future__ import annotations

from pathlib import Path

import common

import mi_enhance  # noqa: F401  (first: it finds the LLVM that Dr.Jit then loads)

import mitsuba as mi  # isort: skip

from mi_enhance import Material, data, fit, specialize
from mi_enhance.benchmark.timing import machine
from mi_enhance.evaluation.reflectance import reflectance
from mi_enhance.fitting.losses import log_l1
from mi_enhance.output.table import write_table

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
}


def main() -> None:
    """Run the benchmark of the command line."""
    parser = common.parser(__doc__)
    parser.add_argument("names", nargs="*", default=_MATERIALS, help="MERL materials (default: six)")
    parser.add_argument("-o", "--output", default="out/specialized", help="folder (default: %(default)s)")
    args = parser.parse_args()
    mi.set_variant("llvm_ad_rgb")
    about = machine()
    rows = [row for name in args.names for row in _material(name)]
    Path(args.output).mkdir(parents=True, exist_ok=True)
    write_table(rows, Path(args.output) / "specialized", _COLUMNS)
    common.finish(rows, _COLUMNS, title="Specialized materials", about=about, as_json=args.json)


def _material(name: str) -> list[dict]:
    measurements = data.load(common.BUNDLED / "nps/merl.npz", material=name)
    exact = fit(Material.pretrained("ggx2"), measurements)
    forms = {"exact": exact, **{f"max error {e:g}": specialize(exact, max_error=e) for e in _ERRORS}}
    forms["refined on the measurements"] = specialize(exact, measurements)
    forms["small shared network"] = specialize(exact, measurements, textured=True)
    errors = {
        k: log_l1(reflectance(m.bsdf(), measurements.wi, measurements.wo), measurements.f, measurements.wo[:, 2])
        for k, m in forms.items()
    }
    rows = []
    for label, m in forms.items():
        rows.append({
            "material": name,
            "label": label,
            "network": m.report.get("specialize_network"),
            "log_l1": errors[label],
            "log_l1_ratio": errors[label] / errors["exact"],
            "difference": m.report.get("specialize_error"),
            "multiply_adds": m.brdf.multiply_adds,
            "specialize_seconds": m.report.get("specialize_seconds"),
        })  # fmt: skip
    return rows


if __name__ == "__main__":
    main()
