"""Do samples follow their density? Mitsuba's chi-square test of all shipped models and networks, and of fits of files.

Every model and network with and without a refitted mixture, roughnesses from 0.01 to 1, isotropic and not, normals
tilted and not, views from above to 89 degrees; fits of RGL files with the mixture that they keep. All tests together
are held to 1 % (Sidak's correction): a run without a mistake fails once in a hundred times.
"""

from __future__ import annotations

import dataclasses

import mi_enhance  # noqa: F401  (first: it finds the LLVM that Dr.Jit then loads)

import mitsuba as mi  # isort: skip
import common
import numpy as np

from mi_enhance import data, fit
from mi_enhance.benchmark.timing import machine
from mi_enhance.evaluation.chi_square import chi_square
from mi_enhance.material.material import Material
from mi_enhance.sampling.mixture_fit import fit_mixture
from mi_enhance.system.files import material_name

_DEGREES = (0, 30, 60, 75, 85, 89)
_AZIMUTH = 0.7  # tilted normals lean this way: no view is below their horizon
_ROUGHNESS = ((0.01, 0.01), (0.03, 0.03), (0.1, 0.1), (0.3, 0.3), (1.0, 1.0), (0.01, 0.3), (0.5, 0.02))
_TILT = {"n_x": 0.1, "n_y": -0.05, "t_theta": 0.6}
_COLUMNS = {
    "material": ("material", ""),
    "configurations": ("configurations", ",d"),
    "failed": ("failed", ",d"),
    "p_value": ("least p-value", ".1e"),
    "normalization": ("integral of the density, furthest from 1", ".4f"),
}


def main() -> None:
    """Run the benchmark of the command line."""
    parser = common.parser(__doc__)
    parser.add_argument("files", nargs="*", help="RGL .bsdf, fitted and tested, too")
    parser.add_argument("--samples", type=int, default=200_000, help="of each test (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    from tqdm import tqdm

    mi.set_variant("llvm_ad_rgb")
    about = machine()
    materials = {name: variations(shipped) for name, shipped in common.shipped().items()}
    for file in args.files:
        materials[material_name(file)] = [fit(Material.pretrained("ggx2"), data.load(file))]
    count = len(_DEGREES) * sum(len(group) for group in materials.values())
    rows = []
    for name, group in tqdm(materials.items(), desc="materials"):
        found = [chi_square_at(m, degrees, count, args) for m in tqdm(group, desc=name) for degrees in _DEGREES]
        rows.append(
            {
                "material": name,
                "configurations": len(found),
                "failed": sum(not f["passed"] for f in found),
                "p_value": min(f["p_value"] for f in found),
                "normalization": max((f["normalization"] for f in found), key=lambda v: abs(v - 1)),
            }
        )
        print(rows[-1], flush=True)
    total = {key: sum(row[key] for row in rows) for key in ("configurations", "failed")}
    rows.append({"material": "all", **total, "p_value": min(row["p_value"] for row in rows)})
    about["least p-value allowed"] = f"{1 - 0.99 ** (1 / count):.1e}"
    common.finish(rows, _COLUMNS, title="Chi-square", about=about, as_json=args.json)
    raise SystemExit(total["failed"] > 0)


def variations(material: Material) -> list[Material]:
    """Every roughness; each second one with a tilted normal; each as it is and with a mixture of its own."""
    own = {p.name for p in material.brdf.parameters}
    result = []
    for k, (alpha_x, alpha_y) in enumerate(_ROUGHNESS):
        values = {"rho_d": 0.2, "rho_s": 0.6, "F0": 0.3, "rho_s2": 0.3}
        values |= {"alpha_x": alpha_x, "alpha_y": alpha_y, "alpha_x2": min(1, 2 * alpha_x), "alpha_y2": alpha_y}
        # exponents and B of lobes about as wide
        values |= {"n_u": 2 / alpha_x**2, "n_v": 2 / alpha_y**2, "B": 1 / alpha_x**2}
        values |= _TILT if k % 2 else {}
        edited = material.edit(**{name: v for name, v in values.items() if name in own})
        result += [edited, dataclasses.replace(edited, mixture=fit_mixture(edited.brdf, edited.as_drjit()))]
    return result


def chi_square_at(material: Material, degrees: float, count: int, args) -> dict:
    """The test at one angle of the view."""
    theta = np.deg2rad(degrees)
    wi = [np.sin(theta) * np.cos(_AZIMUTH), np.sin(theta) * np.sin(_AZIMUTH), np.cos(theta)]
    how = {"test_count": count, "n": args.samples, "seed": args.seed}
    return chi_square(material.bsdf(), wi, material.as_drjit(), material.brdf.model, **how)


if __name__ == "__main__":
    main()
