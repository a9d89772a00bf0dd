"""Fits from photographs against the truth: enhanced, plain GGX and `principled`, by the same loop and budget.

- Default: the truth is Mitsuba's ``measured`` on a real RGL file. Views around the Standard Shader Ball are fitted,
  then error is measured on unseen views in the same light, and on a sphere in an environment map that no fit saw.
  Iterations, samples, resolution, the number of starts that go down a way: the same for all three. `--noise S` adds
  Gaussian noise of S times the brightness; `--ldr` makes the photographs 8-bit PNG: clipped and rounded.
- `--round-trip`: the truth is a known enhanced material; PSNR on unseen views and in unseen light, rendered with the
  same random numbers, so that what is equal shows equal noise.
- `--restarts SECONDS`: a few steps each from extreme and random parameters; what is not finite is counted, 0 is wanted.

Ratios are those of the mean absolute log difference. *noise* is what is left of it in the truth: half of what two
halves of its samples differ by. Random numbers are the same for all: where the material plays no part nothing differs.
Writes ``images.csv``, ``.json``, ``.md``, for each material and model a picture of photographs, re-renders and errors,
and for each material the loss against seconds of all models, into the folder of `-o`.
"""

from __future__ import annotations

import dataclasses
import json
import time
from pathlib import Path

import mi_enhance  # noqa: F401  (first: it finds the LLVM that Dr.Jit then loads)

import mitsuba as mi  # isort: skip
import common
import numpy as np

from mi_enhance.analytic import parameters
from mi_enhance.benchmark import mitsuba_bsdfs
from mi_enhance.benchmark.timing import machine
from mi_enhance.evaluation import image_metrics, scenes
from mi_enhance.images import fit_images, image_loss, pictures, targets, unknowns
from mi_enhance.images.cameras import around, render_views
from mi_enhance.images.starts import library_shapes, spread
from mi_enhance.images.view_files import read_views, write_views
from mi_enhance.material.material import Material
from mi_enhance.output.table import write_table
from mi_enhance.system.files import material_name, replacing

# What cameras look at, from how far.
_CAMERAS = {"shader_ball": ((0.0, 4.3, 0.0), 24.0), "sphere_envmap": ((0.0, 1.0, 0.0), 4.0)}
_COLUMNS = {
    "material": ("material", ""),
    "label": ("model", ""),
    "mean_abs_log": ("log difference", ".4f"),
    "ratio": ("to GGX", ".2f"),
    "ssim": ("SSIM", ".4f"),
    "delta_E_ITP_1000": ("ΔE ITP x1000", ".2f"),
    "unseen_light_mean_abs_log": ("other light", ".4f"),
    "unseen_light_ratio": ("to GGX", ".2f"),
    "unseen_light_ssim": ("SSIM", ".4f"),
    "unseen_light_delta_E_ITP_1000": ("ΔE ITP x1000", ".2f"),
    "noise": ("noise", ".4f"),
    "unseen_light_noise": ("noise", ".4f"),
    "fit_seconds": ("fit s", ".0f"),
}


def main() -> None:
    """Run the benchmark of the command line."""
    parser = common.parser(__doc__)
    parser.add_argument("data", nargs="*", help="RGL .bsdf (default: mi_enhance/bundled/rgl/*.bsdf)")
    parser.add_argument("-m", "--network", default="ggx2", help="shipped network or .bsdf (default: %(default)s)")
    parser.add_argument("--scene", choices=_CAMERAS, default="shader_ball", help="of the fit; the other one is unseen")
    parser.add_argument("--views", type=int, default=12, help="photographs (default: %(default)s)")
    parser.add_argument("--resolution", type=int, default=64, help="pixels on a side (default: %(default)s)")
    parser.add_argument("--spp", type=int, default=2048, help="of the photographs (default: %(default)s)")
    parser.add_argument("--judge-resolution", type=int, help="of what is judged (default: that of the photographs)")
    parser.add_argument("--judge-spp", type=int, default=4096, help="of what is judged (default: %(default)s)")
    parser.add_argument("--stage", dest="stages", action="append", metavar="FACTOR,SPP,STEPS")
    parser.add_argument("--noise", type=float, default=0.0, help="of the photographs, relative (default: none)")
    parser.add_argument("--ldr", action="store_true", help="8-bit photographs")
    parser.add_argument("--round-trip", action="store_true")
    parser.add_argument("--restarts", type=float, metavar="SECONDS")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("-o", "--output", default="out/images", help="folder (default: %(default)s)")
    args = parser.parse_args()
    args.judge_resolution = args.judge_resolution or args.resolution
    args.stages = [tuple(int(n) for n in s.split(",")) for s in args.stages or ()] or None
    mi.set_variant("llvm_ad_rgb")
    about = machine()
    folder = Path(args.output)
    common.keep_settings(args)
    if args.round_trip or args.restarts:
        row = round_trip(args, folder) if args.round_trip else restarts(args)
        columns = {key: (key.replace("_", " "), ".4g" if isinstance(v, float) else "") for key, v in row.items()}
        common.finish([row], columns, title="Fits from photographs", about=about, as_json=args.json)
        return
    files = common.rgl_files(args.data)
    rows = []
    for file in files:
        rows += material_rows(args, Path(file), folder)
        write_table(rows + means(rows), folder / "images", _COLUMNS)
    title = f"{args.views} photographs of {args.resolution} x {args.resolution}, unseen views and light"
    common.finish(rows + means(rows), _COLUMNS, title=title, about=about, as_json=args.json)


# ---------------------------------------------------------------------- against measured materials


def material_rows(args, file: Path, folder: Path) -> list[dict]:
    """One row per model for one measured file; those that an earlier run has left are taken from its folder."""
    name, truth, rows, photos = material_name(file), {"type": "measured", "filename": str(file)}, [], None
    for label, model in MODELS.items():
        kept = folder / f"{name}_{common.folder_name(label)}.json"
        if not kept.exists():
            print(f"{name}: {label}", flush=True)
            if photos is None:
                photos = photographs_of(args, truth, folder / f"{name}_photos")
                exact = [renders(args, where, views, truth) for where, views in unseen(args)]
            row = {"material": name, "label": label, **judge(args, model, photos, exact, folder, name, label)}
            with replacing(kept) as temporary:
                Path(temporary).write_text(json.dumps(row))
        rows.append(json.loads(kept.read_text()))
    curves = {label: folder / f"{name}_{common.folder_name(label)}_curve.json" for label in MODELS}
    curves = {label: json.loads(path.read_text()) for label, path in curves.items()}
    pictures.draw_convergence(curves, folder / f"{name}_convergence.png")
    return with_ratios(rows)


def photographs_of(args, truth: dict, folder: Path) -> list:
    """Views around the object, rendered with the truth, and through files: what a user would have."""
    scene = scenes.load(args.scene, truth, resolution=16, spp=1)
    views = render_views(scene, cameras(args.views, args.scene, args.resolution), spp=args.spp, seed=args.seed)
    if args.noise:
        rng = np.random.default_rng(args.seed)
        noise = [rng.normal(1, args.noise, v.image.shape) for v in views]
        views = [
            dataclasses.replace(v, image=np.maximum(v.image * n, 0).astype(np.float32))
            for v, n in zip(views, noise, strict=True)
        ]
    return read_views(write_views(views, folder, suffix=".png" if args.ldr else ".exr"))


def unseen(args) -> list[tuple[str, list]]:
    """Scene and cameras between those of the fit, and of another light."""
    other = next(name for name in _CAMERAS if name != args.scene)
    between = {"start": 180 / args.views, "elevations": (27, 52)}
    return [(name, cameras(4, name, args.judge_resolution, **between)) for name in (args.scene, other)]


def cameras(n: int, scene: str, resolution: int, **how) -> list:
    """Around the object."""
    target, distance = _CAMERAS[scene]
    return around(n, target=target, distance=distance, resolution=resolution, **how)


def renders(args, scene: str, views: list, bsdf: dict) -> np.ndarray:
    """What cameras see, in two halves of the samples (2, views, H, W, 3); the same random numbers for every BSDF."""
    loaded = scenes.load(scene, bsdf, resolution=16, spp=1)
    halves = [render_views(loaded, views, spp=args.judge_spp // 2, seed=args.seed + s) for s in (100, 200)]
    return np.array([[v.image for v in half] for half in halves])


def judge(args, model, photos: list, exact: list[np.ndarray], folder: Path, name: str, label: str) -> dict:
    """Fit, and measure on what the fit has not seen: renders of the truth, for each of `unseen`."""
    start, sought, starts, bsdf_of = model(args)
    scene = scenes.load(args.scene, start, resolution=16, spp=1)
    settings = {"stages": args.stages, "seed": args.seed, "unknowns": sought(scene), "starts": starts}
    materials = {"ball.bsdf": common.network(args.network)} if label == "enhanced" else None
    found = fit_images.fit_images(scene, photos, materials=materials, **settings)
    bsdf = bsdf_of(found)
    row = {"fit_seconds": found.report["seconds"], "nonfinite_gradients": found.report["nonfinite_gradients"]}
    for (where, views), truth, prefix in zip(unseen(args), exact, ("", "unseen_light_"), strict=True):
        pairs = list(zip(renders(args, where, views, bsdf).mean(0), truth.mean(0), strict=True))
        row[f"{prefix}noise"] = mean(image_metrics.mean_abs_log, list(zip(*truth, strict=True))) / 2
        row[f"{prefix}mean_abs_log"] = mean(image_metrics.mean_abs_log, pairs)
        row[f"{prefix}ssim"] = mean(image_metrics.ssim, pairs)
        row[f"{prefix}delta_E_ITP_1000"] = 1000 * mean(image_metrics.delta_E_ITP, pairs)
        row[f"{prefix}psnr"] = mean(image_metrics.psnr, pairs)
    stem = folder / f"{name}_{common.folder_name(label)}"
    pictures.draw_views(photos, found.renders, f"{stem}_views.png")
    with replacing(f"{stem}_curve.json") as temporary:
        Path(temporary).write_text(json.dumps(found.curve))
    for material in found.materials.values():
        material.save(f"{stem}.bsdf")
    return row


def mean(metric, pairs: list) -> float:
    return float(np.mean([metric(image, truth) for image, truth in pairs]))


def means(rows: list[dict]) -> list[dict]:
    """Means over materials, one row per model; ratios of the means."""
    result = []
    for label in MODELS:
        own = [row for row in rows if row["label"] == label]
        keys = [key for key, value in own[0].items() if isinstance(value, (int, float)) and not key.endswith("ratio")]
        result.append({"material": f"mean of {len(own)}", "label": label})
        result[-1] |= {key: float(np.mean([row[key] for row in own])) for key in keys}
    return with_ratios(result)


def with_ratios(rows: list[dict]) -> list[dict]:
    """Errors as ratios to the first row, plain GGX."""
    for row in rows:
        row["ratio"] = row["mean_abs_log"] / rows[0]["mean_abs_log"]
        row["unseen_light_ratio"] = row["unseen_light_mean_abs_log"] / rows[0]["unseen_light_mean_abs_log"]
    return rows


# ---------------------------------------------------------------------- models: start, unknowns, starts, BSDF of a fit


def ggx(args) -> tuple:
    return (
        Material.analytic("ggx").to_dict(),
        unknowns.enhanced,
        (),
        lambda found: found.materials["ball.bsdf"].to_dict(),
    )


def enhanced(args) -> tuple:
    network = common.network(args.network)
    return network.to_dict(), unknowns.enhanced, (), lambda found: found.materials["ball.bsdf"].to_dict()


def principled(args) -> tuple:
    """Every parameter that ``mi-enhance bench`` fits, too; roughness as its logarithm, starts in all corners."""
    ranges = mitsuba_bsdfs.MITSUBA["principled"]
    keys = {name: name if name == "specular" else f"{name}.value" for name in ranges}

    def bsdf(values: dict) -> dict:
        colour = {"type": "rgb", "value": [float(v) for v in np.broadcast_to(values["base_color"], 3)]}
        return {"type": "principled", **{n: float(np.ravel(v)[0]) for n, v in values.items()}, "base_color": colour}

    def sought(scene) -> list:
        bounds = {keys[name]: (low, high) for name, (low, high, _) in ranges.items()}
        return unknowns.of_plugin("ball.bsdf", bounds, log=["roughness.value"])

    starts = [
        {f"ball.bsdf.{keys[n]}": np.array([v]) for n, v in (("base_color", c), ("roughness", r), ("metallic", m))}
        for c in (0.1, 0.4)
        for r in (0.1, 0.3, 0.6)
        for m in (0.1, 0.9)
    ]
    middle = bsdf({name: 0.5 * (low + high) for name, (low, high, _) in ranges.items()})
    return middle, sought, starts, lambda found: bsdf({n: found.values[f"ball.bsdf.{k}"] for n, k in keys.items()})


MODELS = {"GGX": ggx, "principled": principled, "enhanced": enhanced}


# ---------------------------------------------------------------------- against ourselves


def round_trip(args, folder: Path) -> dict:
    """The enhanced model fitted to photographs of one of its own materials."""
    network = common.network(args.network)
    k = spread(library_shapes(network.brdf, network.library), 60)[48 + (args.seed - 2) % 12]
    row = parameters.unflatten(network.brdf.parameters, np.asarray(network.library[k], np.float64))
    # one that is no start: those are the first 48
    truth = Material(
        network.brdf, {n: v for n, v in row.items() if n not in parameters.FRAME}, lobe_albedo=network.lobe_albedo
    )
    photos = photographs_of(args, truth.to_dict(), folder / "round_trip_photos")
    exact = [renders(args, where, views, truth.to_dict()) for where, views in unseen(args)]
    return judge(args, enhanced, photos, exact, folder, "round_trip", "enhanced")


def restarts(args) -> dict:
    """Steps from parameters at the ends of their ranges, and from random ones."""
    network = common.network(args.network)
    scene = scenes.load("sphere_envmap", network.to_dict(), resolution=16, spp=1)
    photos = render_views(
        scenes.load("sphere_envmap", {"type": "diffuse"}, resolution=16, spp=1),
        around(2, target=(0, 1, 0), distance=4, resolution=16),
        spp=64,
    )
    (target,) = targets.targets(photos)
    measure = image_loss.Measure("log", image_loss.brightness(np.concatenate([v.image[v.mask] for v in photos])))
    descent = fit_images.Descent(scene, unknowns.enhanced(scene), None, measure, 4, args.seed)
    rng, start = np.random.default_rng(args.seed), time.perf_counter()
    n, bad_values, bad_pixels = 0, 0, 0
    while time.perf_counter() - start < args.restarts:
        values = {}
        for u in descent.unknowns:
            low, high = u.space.bounds
            # a third at the lower end, a third at the upper, a third in between
            place = rng.choice([0, 1, rng.random()], size=descent.values()[u.key].size)
            values[u.key] = u.space.to_physical(low + place * (high - low))
        descent.put(values)
        for _ in range(4):
            image = descent.step(target, 4, 0.1)
            bad_pixels += int((~np.isfinite(image)).sum())
        bad_values += sum(int((~np.isfinite(v)).sum()) for v in descent.values().values())
        n += 1
    return {
        "restarts": n,
        "steps": len(descent.curve),
        "seconds": time.perf_counter() - start,
        "nan_parameters": bad_values,
        "nan_pixels": bad_pixels,
        "nonfinite_gradients": descent.nonfinite,
    }


if __name__ == "__main__":
    main()
