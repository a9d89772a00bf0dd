"""Fits from photographs against the truth: enhanced, plain GGX and `principled`, by the same loop and budget.

- Default: the truth is Mitsuba's ``measured`` on a real RGL file. Views around the Standard Shader Ball are fitted, then
  error is measured on unseen views in the same light, and in another one: a room with a sky instead of lamps. Iterations,
  samples, resolution, the number of starts that go down a way: the same for all three. `--noise S` adds Gaussian noise of
  S times the brightness; `--ldr` makes the photographs 8-bit PNG: clipped and rounded.
- `--round-trip`: the truth is a known enhanced material on a sphere; 8 views; PSNR on unseen views and in unseen light.
- `--restarts SECONDS`: fits of a few iterations from extreme and random parameters; NaN are counted, 0 is wanted.

Ratios are those of the mean absolute log difference. Writes ``images.csv``, ``.json``, ``.md``, and for each material and
model a picture and the curve of error against seconds, into the folder of `-o`.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import time
from pathlib import Path

import mi_enhance  # noqa: F401  (first: it finds the LLVM that Dr.Jit then loads)

import mitsuba as mi  # isort: skip
import numpy as np
from common import finish, folder_name

from mi_enhance import inverse, inverse_picture, metrics, parameters, rivals, unknowns
from mi_enhance import scene as scenes
from mi_enhance.data._io import material_name, replacing
from mi_enhance.material import Material
from mi_enhance.table import write_table
from mi_enhance.timing import machine
from mi_enhance.view_files import read_views, write_views
from mi_enhance.views import around, render_views

_ROOT = Path(__file__).resolve().parents[2]
_TARGET, _DISTANCE = (-2.0, 4.5, -3.5), 22.0  # of the shader ball: what cameras look at, centimetres
_KEYS = {"base_color": "base_color.value", "specular": "specular"}
_COLUMNS = {
    "material": ("material", ""),
    "label": ("model", ""),
    "mean_abs_log": ("log difference", ".4f"),
    "ratio": ("to GGX", ".2f"),
    "ssim": ("SSIM", ".4f"),
    "delta_E_ITP_1000": ("ΔE ITP x1000", ".2f"),
    "unseen_light": ("other light", ".4f"),
    "unseen_light_ratio": ("to GGX", ".2f"),
    "unseen_light_ssim": ("SSIM", ".4f"),
    "unseen_light_delta_E_ITP_1000": ("ΔE ITP x1000", ".2f"),
    "fit_seconds": ("fit s", ".0f"),
}


def main() -> None:
    """Run the benchmark of the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", nargs="*", help="RGL .bsdf (default: data/rgl/*.bsdf)")
    parser.add_argument("-m", "--network", default="ggx2", help="shipped network or .bsdf (default: %(default)s)")
    parser.add_argument("--scene", choices=("shader_ball", "sphere_envmap"), default="shader_ball")
    parser.add_argument("--light", metavar="ENVMAP", help="unseen light (default: a sky, Mitsuba's sunsky)")
    parser.add_argument("--views", type=int, default=12, help="photographs (default: %(default)s)")
    parser.add_argument("--resolution", type=int, default=64, help="pixels on a side (default: %(default)s)")
    parser.add_argument("--spp", type=int, default=512, help="samples per pixel of the photographs (default: %(default)s)")
    parser.add_argument("--stage", dest="stages", action="append", metavar="FACTOR,SPP,STEPS")
    parser.add_argument("--noise", type=float, default=0.0, help="of the photographs, relative (default: none)")
    parser.add_argument("--ldr", action="store_true", help="8-bit photographs")
    parser.add_argument("--round-trip", action="store_true")
    parser.add_argument("--restarts", type=float, metavar="SECONDS")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("-o", "--output", default="out/images", help="folder (default: %(default)s)")
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()
    args.stages = [tuple(int(n) for n in s.split(",")) for s in args.stages or ()] or inverse.STAGES
    mi.set_variant("llvm_ad_rgb")
    about = machine()
    folder = Path(args.output)
    folder.mkdir(parents=True, exist_ok=True)
    if args.round_trip or args.restarts:
        row = round_trip(args, folder) if args.round_trip else restarts(args)
        columns = {key: (key.replace("_", " "), ".4g" if isinstance(v, float) else "") for key, v in row.items()}
        finish([row], columns, title="Fits from photographs", about=about, as_json=args.json)
        return
    files = args.data or sorted((_ROOT / "data/rgl").glob("*.bsdf"))
    rows = []
    for file in files:
        rows += material_rows(args, Path(file), folder)
        write_table(rows + means(rows), folder / "images", _COLUMNS)
    title = f"{args.views} photographs of {args.resolution} x {args.resolution}, unseen views and light"
    finish(rows + means(rows), _COLUMNS, title=title, about=about, as_json=args.json)


# ---------------------------------------------------------------------- against measured materials


def material_rows(args, file: Path, folder: Path) -> list[dict]:
    """One row per model for one measured file; those that an earlier run has left are taken from its folder."""
    name = material_name(file)
    truth = {"type": "measured", "filename": str(file)}
    kept = {label: folder / f"{name}_{folder_name(label)}.json" for label in MODELS}
    rows = [json.loads(path.read_text()) for path in kept.values() if path.exists()]
    if len(rows) < len(kept):
        photos = photographs(args, truth, folder / f"{name}_photos")
        test, other = unseen(args, truth)
        rows = []
        for label, model in MODELS.items():
            print(f"{name}: {label}", flush=True)
            rows.append({"material": name, "label": label, **judge(args, model, photos, test, other, folder, name, label)})
            with replacing(kept[label]) as temporary:
                Path(temporary).write_text(json.dumps(rows[-1]))
    reference = rows[0]
    for row in rows:
        for key in ("mean_abs_log", "unseen_light"):
            row["ratio" if key == "mean_abs_log" else f"{key}_ratio"] = row[key] / reference[key]
    return rows


def photographs(args, truth: dict, folder: Path) -> list:
    """Views around the object, rendered with the truth, and through files: what a user would have."""
    scene = load(args, truth)
    views = render_views(scene, cameras(args, args.views), spp=args.spp, seed=args.seed)
    rng = np.random.default_rng(args.seed)
    if args.noise:
        noisy = lambda v: np.maximum(v.image * rng.normal(1, args.noise, v.image.shape), 0)  # noqa: E731
        views = [dataclasses.replace(v, image=noisy(v).astype(np.float32)) for v in views]
    return read_views(write_views(views, folder, suffix=".png" if args.ldr else ".exr"))


def unseen(args, truth: dict) -> tuple[list, list]:
    """Views between those that were fitted, in the light of the fit and in another."""
    between = cameras(args, 4, start=360 / args.views / 2, elevations=(27, 52))
    return tuple(
        render_views(scene, between, spp=args.spp, seed=args.seed + 100)
        for scene in (load(args, truth), other_light(args, truth))
    )


def cameras(args, n: int, *, start: float = 0.0, elevations=(15, 40, 65)) -> list:
    """Around the object, as far as the room's walls let."""
    if args.scene == "sphere_envmap":
        return around(n, target=(0, 1, 0), distance=4, elevations=elevations, resolution=args.resolution, start=start)
    target, distance = _TARGET, _DISTANCE
    return around(
        n, target=target, distance=distance, elevations=elevations, fov=30, resolution=args.resolution, start=start
    )


def load(args, bsdf) -> mi.Scene:
    """The scene of the fit."""
    return scenes.load(args.scene, bsdf, resolution=16, spp=1)


def other_light(args, bsdf) -> mi.Scene:
    """A sphere on a plane under a light that the fit has not seen."""
    sky = {"type": "sunsky", "hour": 15.0, "sun_scale": 0.2} if args.light is None else {"type": "envmap", "filename": args.light}
    up = mi.ScalarTransform4f().rotate([1, 0, 0], -90)  # the sky's z is up, the scene's y
    return mi.load_dict(
        {
            "type": "scene",
            "light": {**sky, "to_world": up} if args.light is None else sky,
            "ball": {"type": "sphere", "center": [0, 1, 0], "bsdf": bsdf},
            "ground": {
                "type": "disk",
                "to_world": mi.ScalarTransform4f().rotate([1, 0, 0], -90).scale(6),
                "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.3}},
            },
        }
    )
