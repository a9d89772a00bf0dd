"""What reciprocity and bounded energy hold, and what they cost: shipped models and networks, random edits, RGL files.

Three tables in one: every analytic model and network of the package at parameters that reflect too much; training
materials of the network with random edits (colours, F0 and rotation anywhere in their ranges, roughnesses from 0.006 to
1, each for itself); and fits of RGL files with both options on, their log-L1 relative to that of fits with `reciprocal`
alone and with neither.
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
from mi_enhance.analytic import parameters
from mi_enhance.benchmark.timing import clock, interleaved, machine, spread
from mi_enhance.evaluation.check import albedo
from mi_enhance.material.material import Material
from mi_enhance.output.figure import sheet
from mi_enhance.system.bundled_files import DEFAULT_NETWORK
from mi_enhance.system.files import replacing

_COLUMNS = {
    "material": ("material", ""),
    "albedo_unbounded": ("albedo, free", ".3f"),
    "albedo": ("bounded", ".4f"),
    "reciprocity": ("reciprocity", ".1e"),
    "log_l1_free": ("log-L1, free", ".4f"),
    "log_l1_reciprocal": ("reciprocal", ".4f"),
    "log_l1": ("both", ".4f"),
    "ratio": ("both / reciprocal", ".3f"),
    "ratio_free": ("both / free", ".3f"),
    "eval_ns_free": ("eval ns, free", ".1f"),
    "eval_ns_reciprocal": ("reciprocal", ".1f"),
    "eval_ns": ("both", ".1f"),
    "update_ms": ("update, ms", ".0f"),
}
# Denser than the table of sampling.energy_bound, and between its nodes; cosines to the normal of the surface.
_COSINES = np.linspace(0.03, 1, 40) ** 4
_AZIMUTHS, _SAMPLES, _PAIRS = 4, 1 << 11, 1 << 15
_LANES = 1 << 21  # of a timed evaluation
_SMOOTHEST = 0.006  # of the roughnesses of OpenSVBRDF


def main() -> None:
    """Run the benchmark of the command line."""
    parser = common.parser(__doc__)
    parser.add_argument("files", nargs="*", help="RGL .bsdf")
    parser.add_argument("-o", "--output", default="out/physics", help="folder (default: %(default)s)")
    parser.add_argument("--edits", type=int, default=1000, help="random materials (default: %(default)s)")
    parser.add_argument("--samples", type=int, default=100_000, help="of each file (default: %(default)s)")
    parser.add_argument("-m", "--network", default=DEFAULT_NETWORK, help="fitted to the files (default: %(default)s)")
    parser.add_argument("--averaged", action="store_true", help="fit to the average of both orders of each pair")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    from tqdm import tqdm

    mi.set_variant("llvm_ad_rgb")
    about, rows = machine(), []
    for name, material in tqdm(common.shipped().items(), desc="shipped"):
        bright = {p.name: 1.0 if p.name in ("F0", "rho_d") else p.high / 5 for p in material.brdf.model.parameters
                  if p.is_colour or p.name == "F0"}  # fmt: skip
        rows.append({"material": name, **_examine(material.edit(**bright, asymmetry=0.0)
                     if "asymmetry" in material.params else material.edit(**bright))})  # fmt: skip
    worst, albedos = _edited(args.edits, args.seed, tqdm)
    rows.append(worst)
    for file in args.files:
        rows.append(_fitted(file, args))
        print(rows[-1], flush=True)
    ratios = [row["ratio"] for row in rows if "ratio" in row]
    if ratios:
        mean = {
            k: float(np.mean([r[k] for r in rows if "ratio" in r]))
            for k in _COLUMNS
            if k.startswith(("log_l1", "eval_ns"))
        }
        mean |= {
            "ratio": mean["log_l1"] / mean["log_l1_reciprocal"],
            "ratio_free": mean["log_l1"] / mean["log_l1_free"],
        }
        rows.append({"material": f"mean of {len(ratios)} files", **mean})
    folder = Path(args.output)
    folder.mkdir(parents=True, exist_ok=True)
    with replacing(folder / "physics.json") as temporary:
        Path(temporary).write_text(json.dumps({"machine": about, "rows": rows}, indent=1) + "\n")
    _draw(albedos, folder / "physics.png")
    common.finish(rows, _COLUMNS, title="Reciprocity and energy", about=about, as_json=args.json)


def _examine(material: Material) -> dict:
    """Largest albedos without and with bound, the worst reciprocity with it, and the time of an update."""
    free, bound = material.bsdf(), material.bounded().bsdf()
    result = {"albedo_unbounded": float(_albedos(free).max()), "albedo": float(_albedos(bound).max())}
    if material.reciprocal:
        result["reciprocity"] = _reciprocity(bound)
    seconds = min(clock(lambda: (bound.parameters_changed(), dr.sync_thread()))[0] for _ in range(3))
    return {**result, "update_ms": 1000 * seconds}


def _hit(wi: np.ndarray) -> mi.SurfaceInteraction3f:
    si = dr.zeros(mi.SurfaceInteraction3f, len(wi))
    si.wi = mi.Vector3f(np.ascontiguousarray(wi.T.astype(np.float32)))
    return si


def _albedos(bsdf: mi.BSDF) -> np.ndarray:
    """Albedo (cosines, azimuths, 3), by other samples than those of the table."""
    phi = (np.arange(_AZIMUTHS) + 0.3) / _AZIMUTHS * 2 * np.pi
    return albedo(bsdf, _COSINES, phi, _SAMPLES, first=77_777)[0]


def _reciprocity(bsdf: mi.BSDF) -> float:
    """Largest relative difference of f for both orders of random pairs, polar angles even down to 89.9 degrees."""
    rng = np.random.default_rng(1)
    theta, phi = rng.uniform(0, np.deg2rad(89.9), (2, _PAIRS)), rng.uniform(0, 2 * np.pi, (2, _PAIRS))
    pair = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], -1).astype(np.float32)
    one, other = (_f(bsdf, *order) for order in (pair, pair[::-1]))
    return float((np.abs(one - other) / np.maximum(np.maximum(one, other), 1e-6)).max())  # 1e-6/sr is dark


def _f(bsdf: mi.BSDF, wi: np.ndarray, wo: np.ndarray) -> np.ndarray:
    value = bsdf.eval(mi.BSDFContext(), _hit(wi), mi.Vector3f(np.ascontiguousarray(wo.T)))
    return np.array(value, np.float64).T / wo[:, 2:]


def _edited(n: int, seed: int, tqdm) -> tuple[dict, np.ndarray]:
    """The worst of n random materials, and the largest albedo of each, free and bounded."""
    rng, network = np.random.default_rng(seed), Material.pretrained("ggx2")
    scenes = [m.bsdf() for m in (network, network.bounded())]
    held = [mi.traverse(b) for b in scenes]
    albedos, reciprocity = np.zeros((2, n)), 0.0
    for k in tqdm(range(n), desc="edited"):
        values = parameters.unflatten(network.brdf.parameters, network.library[rng.integers(len(network.library))])
        for p in network.brdf.model.parameters:
            u = rng.random(p.size)
            if p.log:
                values[p.name] = np.exp(np.log(_SMOOTHEST) * u)
            elif p.name not in ("n_x", "n_y"):
                values[p.name] = p.low + u * (p.high - p.low)
        values["asymmetry"] = np.zeros(1)
        for b, scene, row in zip(scenes, held, albedos, strict=True):
            for name, v in values.items():
                scene[name] = mi.Color3f(v) if name.startswith("rho") else mi.Float(np.float32(v))
            scene.update()
            row[k] = _albedos(b).max()
        reciprocity = max(reciprocity, _reciprocity(scenes[1]))
    worst = {"albedo_unbounded": float(albedos[0].max()), "albedo": float(albedos[1].max())}
    return {"material": f"{n} random edits of network ggx2", **worst, "reciprocity": reciprocity}, albedos


def _fitted(file: str, args) -> dict:
    """A file fitted freely, with `reciprocal`, and with both options."""
    measurements = data.load(file, n_samples=args.samples, seed=args.seed)
    if args.averaged:
        measurements = dataclasses.replace(measurements, f=common.averaged(measurements, file))
    free = fit(Material.pretrained(args.network), measurements, seed=args.seed)
    both = fit(Material.pretrained(args.network), measurements, reciprocal=True, bound_energy=True, seed=args.seed)
    row = {"material": Path(file).stem.removesuffix("_rgb"), **_examine(both)}
    row["albedo_unbounded"] = float(_albedos(mi.load_dict({**both.to_dict(), "energy": False})).max())
    figures = {
        "log_l1_free": free.report["log_l1"],
        "log_l1_reciprocal": both.report["log_l1_unbounded"],
        "log_l1": both.report["log_l1"],
    }
    bsdfs = {
        "eval_ns_free": free.bsdf(),
        "eval_ns_reciprocal": mi.load_dict({**both.to_dict(), "energy": False}),
        "eval_ns": both.bsdf(),
    }
    return {
        **row,
        **figures,
        **_nanoseconds(bsdfs),
        "ratio": figures["log_l1"] / figures["log_l1_reciprocal"],
        "ratio_free": figures["log_l1"] / figures["log_l1_free"],
    }


def _nanoseconds(bsdfs: dict[str, mi.BSDF]) -> dict[str, float]:
    """Of one evaluation, in turns."""
    pair = np.random.default_rng(0).normal(size=(2, _LANES, 3)).astype(np.float32)
    pair[..., 2] = np.abs(pair[..., 2])
    wi, wo = pair / np.linalg.norm(pair, axis=-1, keepdims=True)
    si, wo = _hit(wi), mi.Vector3f(np.ascontiguousarray(wo.T))
    dr.eval(si, wo)

    def job(bsdf):
        return lambda: (dr.eval(bsdf.eval(mi.BSDFContext(), si, wo)), dr.sync_thread())

    seconds = interleaved({name: job(bsdf) for name, bsdf in bsdfs.items()}, rounds=9)
    return {name: spread(s)["seconds"] / _LANES * 1e9 for name, s in seconds.items()}


def _draw(albedos: np.ndarray, path: Path) -> None:
    """Largest albedo of each random material, without and with the bound."""
    with sheet(path, (6, 4), 100) as figure:
        axes = figure.add_subplot()
        axes.loglog(*albedos, ".", ms=3)
        axes.axhline(1, color="black", lw=0.8, ls="--")
        axes.set(xlabel="largest albedo, free", ylabel="largest albedo, bounded")
        axes.grid(alpha=0.3, which="both")


if __name__ == "__main__":
    main()
