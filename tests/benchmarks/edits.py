"""Edits of roughness, F0 and rotation: does a term still reflect what the analytic one of the same numbers does?

For fits of measured files: the albedo at 10 and 60 degrees to that of the analytic model with the same parameters,
relative to before the edit. 1 is an edit that means what it says.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import common
import numpy as np

import mi_enhance as me
from mi_enhance.material.material import Material

import mitsuba as mi  # isort: skip

_ANGLES, _DRAWS = (10, 60), 1 << 14
_FACTORS, _VALUES = (0.25, 0.5, 2.0, 4.0), (0.05, 0.2, 0.5)
_GOOD = (0.6, 1.6)


def edits_of(material: Material) -> dict[str, dict]:
    """The edits, by name; both lobes by the same factor, the first to a value."""
    p = material.params
    alphas = [name for name in p if name.startswith("alpha_")]
    result = {f"alpha x {s:g}": {name: np.clip(s * p[name], 1e-4, 1) for name in alphas} for s in _FACTORS}
    first = [name for name in alphas if not name.endswith("2")]
    result |= {f"alpha = {v:g}": dict.fromkeys(first, v) for v in _VALUES}
    result |= {f"F0 = {v:g}": {"F0": v} for v in (0.04, 0.2, 0.8)}
    return result | {"t_theta + 0.7": {"t_theta": p["t_theta"] + 0.7 - np.pi * (p["t_theta"] > 1)}}


def albedos(material: Material) -> np.ndarray:
    """Directional albedo at the angles, mean of the channels, by the plugin's own samples."""
    bsdf, result = material.bsdf(), []
    u = np.random.default_rng(0).random((3, _DRAWS)).astype(np.float32)
    for angle in np.radians(_ANGLES):
        si = mi.SurfaceInteraction3f()
        si.wi = mi.Vector3f(float(np.sin(angle)), 0, float(np.cos(angle)))
        _, weight = bsdf.sample(mi.BSDFContext(), si, mi.Float(u[0]), mi.Point2f(mi.Float(u[1]), mi.Float(u[2])))
        result.append(np.array(weight).mean())
    return np.array(result)


def to_analytic(material: Material) -> np.ndarray:
    """Albedos to those of the analytic model with the same parameters."""
    model = material.brdf.model
    plain = Material.analytic(model.name).edit(**{p.name: material.params[p.name] for p in model.parameters})
    return albedos(material) / albedos(plain)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", nargs="*", help="measured files (default: the fifth of MERL kept aside)")
    parser.add_argument("--count", type=int, help="only so many of them (default: all)")
    parser.add_argument("--samples", type=int, default=20_000)
    parser.add_argument("-o", "--output", default="out/edits", help="folder of the fits (default: %(default)s)")
    args = parser.parse_args()
    mi.set_variant("llvm_ad_rgb")
    folder = Path(args.output)
    folder.mkdir(parents=True, exist_ok=True)
    outside, n = [], 0
    for measured in common.measurements(args.data, args.count, args.samples):
        kept = folder / f"{measured.name}-{args.samples}.bsdf"
        if not kept.exists():
            me.fit_best(Material.pretrained(), measured).save(kept)
        fitted = Material.load(kept)
        kinds = {"own": fitted, "shared": fitted.unspecialized} if fitted.brdf.distilled else {"shared": fitted}
        for kind, material in kinds.items():
            before = to_analytic(material)
            found = {name: to_analytic(material.edit(**e)) / before for name, e in edits_of(material).items()}
            text = "  ".join(f"{name}: {r[0]:.2f} {r[1]:.2f}" for name, r in found.items())
            print(f"{measured.name} {kind}\n  {text}", flush=True)
            n += len(found)
            for name, ratios in found.items():
                r = max(ratios, key=lambda v: abs(np.log(v)))
                if not _GOOD[0] <= r <= _GOOD[1]:
                    outside.append(f"{measured.name} {kind}, {name}: {r:.2f}")
    print(f"{len(outside)} of {n} edits outside {_GOOD[0]} to {_GOOD[1]}", *outside, sep="\n  ")


if __name__ == "__main__":
    main()
