"""Extreme materials and directions: float32 kernels against the float64 twin, and a hunt for NaN among many more.

Figures for every case, worst of all materials of a kind: the error of values and gradients on a few thousand lanes
that the twin (tests/twin.py) also evaluates; the same error over what the rounding of float32 directions and parameters
changes by itself; what half precision, as on a GPU, changes in networks; and lanes with a value or derivative that is
not finite, or a value below 0, among all evaluations. Cases and materials are those of tests/extreme_cases.py.
"""

from __future__ import annotations

import functools
import sys
from pathlib import Path

import mi_enhance  # noqa: F401  (first: it finds the LLVM that Dr.Jit then loads)

import mitsuba as mi  # isort: skip
import common
import numpy as np

from mi_enhance.benchmark.timing import machine
from mi_enhance.neural import cooperative

sys.path.append(str(Path(__file__).resolve().parents[1]))  # the tests: cases and twin

import extreme_cases as cases  # noqa: E402
import lanes  # noqa: E402

_AT_ONCE = 1 << 20
_COLUMNS = {
    "case": ("case", ""),
    "kind": ("BRDFs", ""),
    "value": ("value, worst", ".1e"),
    "value_99": ("99 %", ".1e"),
    "over_rounding": ("over rounding", ".2f"),
    "half": ("half precision, median", ".1e"),
    "half_99": ("99 %", ".1e"),
    "gradient": ("gradient, worst", ".1e"),
    "gradient_99": ("99 %", ".1e"),
    "evaluations": ("evaluations", ",d"),
    "bad": ("NaN, inf, < 0", ",d"),
}


def main() -> None:
    """Run the benchmark of the command line."""
    parser = common.parser(__doc__)
    parser.add_argument("--evaluations", type=float, default=1e7, help="of the hunt, in all (default: %(default)g)")
    parser.add_argument("--samples", type=int, default=5000, help="compared with the twin, each case and material")
    parser.add_argument("--gradients", type=int, default=300, help="of these, with all derivatives")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    mi.set_variant("llvm_ad_rgb")
    about = {**machine(), "evaluations": 0, "compared": 0}
    materials = cases.materials()
    share = args.evaluations / len(cases.CASES) / len(materials)
    rows = {}
    from tqdm import tqdm

    for name, material in tqdm(materials.items(), desc="materials"):
        evaluators = lanes.fused(material.brdf.networks)
        for case in tqdm(cases.CASES, desc=name, leave=False):
            kind = "saturated" if name.endswith("saturated") else "networks" if material.brdf.networks else "analytic"
            row = rows.setdefault((case, kind), {"case": case, "kind": kind, "evaluations": 0, "bad": 0})
            if kind != "saturated":  # of exponents that are cut off, float32 and float64 agree; elsewhere they need not
                _compare(row, material, case, args)
                about["compared"] += args.samples
            for k in range(round(share / min(share, _AT_ONCE))):
                n = min(round(share), _AT_ONCE)
                wi, wo, params = cases.draw(cases.CASES[case], material.brdf, n, args.seed + 1 + k)
                row["bad"] += int(cases.n_bad(*cases.gradients(material.brdf, evaluators, wi, wo, params))[0])
                row["evaluations"] += n
                about["evaluations"] += n
    order = [rows[case, kind] for kind in ("analytic", "networks", "saturated") for case in cases.CASES]
    common.finish(order, _COLUMNS, title="Extremes: errors relative to the twin", about=about, as_json=args.json)
    raise SystemExit(any(row["bad"] for row in order))


def _compare(row: dict, material, case: str, args) -> None:
    """Keep the worst of this material and of those before it."""
    e = cases.errors(material, cases.CASES[case], args.samples, args.gradients, args.seed)
    figures = {
        "value": e.value.max(),
        "value_99": np.quantile(e.value, 0.99),
        "over_rounding": (e.value / (1e-4 + e.rounding)).max(),
        "gradient": e.gradient.max(),
        "gradient_99": np.quantile(e.gradient, 0.99),
    }
    if material.brdf.modules:
        half = _half_precision(material, case, args)
        figures |= {"half": np.median(half), "half_99": np.quantile(half, 0.99)}
    for key, v in figures.items():
        row[key] = max(row.get(key, 0.0), float(v))


def _half_precision(material, case: str, args) -> np.ndarray:
    """What networks in half precision change, relative as the other errors, (samples,)."""
    brdf = material.brdf
    drawn = cases.draw(cases.CASES[case], brdf, args.samples, args.seed)
    kinds = cooperative.Cooperative, functools.partial(cooperative.Cooperative, half=True)
    full, half = (np.array(brdf(*drawn, brdf.evaluators(kind)), np.float64) for kind in kinds)
    return np.abs(half - full).max(0) / np.maximum(np.abs(full).max(0), cases.DARK)


if __name__ == "__main__":
    main()
