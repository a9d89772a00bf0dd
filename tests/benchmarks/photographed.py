"""Real photographs: GGX, networks and NBRDF fitted to most of them, judged on the others.

- ``--ball DIR``: "ball" of DiLiGenT, a sphere under lights one at a time. ``DIR`` holds ``NNN.png`` (16 bits, linear),
  ``lights.csv`` (direction, intensity per channel), ``normals.npy``, ``mask.png``. Every fourth light is kept aside.
  *Fast*: ``data.photometric`` and a fit. *Slow*: ``fit_images``, through the renderer, from the photographs.
- ``--cards DIR``: a flat print under a flash on the camera. ``DIR`` holds square photographs and ``frames.json``
  (``size_cm``, ``light_power``, and for each photograph ``file`` and ``camera``, in cm above the middle). Maps are
  fitted to all but the last, which is predicted.

Errors are mean abs(log(1 + f cos) - log(1 + f' cos)) over all pixels kept aside, and within 8 degrees of the highlight;
ratios are to GGX by the same road. The data sets state no licence: pictures go to the folder of `-o`, nowhere else.
"""

from __future__ import annotations

import csv
import json
import time
from collections.abc import Callable
from pathlib import Path

import mi_enhance as me

import mitsuba as mi  # isort: skip
import common
import numpy as np
import rivals

from mi_enhance.benchmark.timing import machine
from mi_enhance.data.measurements import Measurements
from mi_enhance.data.photometric_file import PhotometricFile
from mi_enhance.fitting.fit_texels import log_l1_of_texels
from mi_enhance.images.view_files import ViewFiles
from mi_enhance.output import srgb
from mi_enhance.output.figure import sheet

_KEPT_ASIDE = 4  # every fourth light
_FAR = 1000.0  # radii from the sphere to a pinhole that stands for an orthographic camera
_HIGHLIGHT = np.cos(np.deg2rad(4))  # of the half vector: a light within 8 degrees of the mirror direction
_COLUMNS = {
    "label": ("model", ""),
    "road": ("road", ""),
    "error": ("unseen photographs", ".5f"),
    "ratio": ("to GGX", ".2f"),
    "highlight": ("highlight", ".5f"),
    "highlight_ratio": ("to GGX", ".2f"),
    "seconds": ("s", ".0f"),
}


def main() -> None:
    """Run the benchmark of the command line."""
    parser = common.parser(__doc__)
    parser.add_argument("--ball", metavar="DIR")
    parser.add_argument("--cards", metavar="DIR")
    parser.add_argument("--samples", type=int, default=30_000, help="pixels of the fast road (default: %(default)s)")
    parser.add_argument("-m", "--network", nargs="+", default=["ggx2", "ggx2_rgb"])
    parser.add_argument("--slow", nargs="*", default=["ggx2"], help="networks of the slow road (default: ggx2)")
    parser.add_argument("--size", type=int, default=256, help="texels on a side (default: %(default)s)")
    parser.add_argument("-o", "--output", default="out/photographed")
    args = parser.parse_args()
    mi.set_variant("llvm_ad_rgb")
    about, folder = machine(), Path(args.output)
    folder.mkdir(parents=True, exist_ok=True)
    rows = []
    if args.ball:
        rows += ball(Path(args.ball), folder, args)
    if args.cards:
        rows += cards(Path(args.cards), folder, args)
    common.finish(rows, _COLUMNS, title="Real photographs", about=about, as_json=args.json)


def model(name: str) -> me.Material:
    """GGX, or a network."""
    return me.Material.analytic("ggx") if name == "GGX" else common.network(name)


# ---------------------------------------------------------------------- a sphere, one light at a time


def ball(source: Path, folder: Path, args) -> list[dict]:
    """Rows of both roads; the reference of each comes first."""
    lights = list(csv.DictReader((source / "lights.csv").open()))
    normals = np.load(source / "normals.npy")
    described = folder / "ball"
    described.mkdir(exist_ok=True)
    frames = [frame(source, k, row) for k, row in enumerate(lights)]
    content = {"normals": str(source / "normals.npy"), "mask_path": str(source / "mask.png"), "encoding": "linear"}
    (described / "photometric.json").write_text(json.dumps({**content, "frames": frames}))
    unseen = all_pixels(described)
    samples = me.data.photometric(described, n_samples=args.samples)
    rows = [fast(name, samples, unseen) for name in ("GGX", *args.network)]
    rows += [network_of_its_own(samples, unseen), nbrdf(samples, unseen, folder)]
    if args.slow:
        pinhole(described, frames, normals)
        views = ViewFiles(described / "transforms.json")
        rows += with_ratios([slow(name, views, unseen, folder) for name in ("GGX", *args.slow)])
    return with_ratios(rows[: len(args.network) + 3]) + rows[len(args.network) + 3 :]


def frame(source: Path, k: int, row: dict) -> dict:
    """A photograph and its light; what is kept aside is of split "test"."""
    direction = [float(row[a]) for a in "xyz"]
    intensity = [float(row[f"intensity_{c}"]) for c in "rgb"]
    return {
        "file_path": str(source / row["file"]),
        "split": "test" if k % _KEPT_ASIDE == 1 else "train",
        "light": {"type": "directional", "direction": direction, "intensity": intensity},
    }


def all_pixels(described: Path) -> Measurements:
    """Every pixel that counts of the photographs kept aside."""
    parts = [(f.wi[f.counts], f.wo[f.counts], f.f[f.counts]) for f in PhotometricFile(described).read("test")]
    wi, wo, f = (np.concatenate([p[k] for p in parts]) for k in range(3))
    return Measurements(wi, wo, np.maximum(f, 0), "ball", "photographs kept aside")


def errors(evaluate: Callable, unseen: Measurements) -> dict:
    """Error over all pixels, and near the highlight."""
    cos = unseen.wo[:, 2:]
    each = abs(np.log1p(evaluate(unseen.wi, unseen.wo) * cos) - np.log1p(unseen.f * cos)).mean(1)
    h = unseen.wi + unseen.wo
    near = h[:, 2] > _HIGHLIGHT * np.linalg.norm(h, axis=1)
    return {"error": float(each.mean()), "highlight": float(each[near].mean())}


def timed(label: str, road: str, fit: Callable, judged: Callable) -> dict:
    """A row of the table."""
    begun = time.perf_counter()
    found = fit()
    seconds = time.perf_counter() - begun
    row = {"label": label, "road": road, "seconds": seconds, **judged(found)}
    print(json.dumps(row), flush=True)
    return row


def fast(name: str, samples: Measurements, unseen: Measurements) -> dict:
    start = me.Material.analytic("ggx") if name == "GGX" else me.Material.pretrained(name)
    return timed(name, "fast", lambda: me.fit(start, samples), lambda m: errors(m.evaluate, unseen))


def network_of_its_own(samples: Measurements, unseen: Measurements) -> dict:
    fit = lambda: me.fit_best(me.Material.pretrained(), samples, own="always")  # noqa: E731
    return timed("network of its own", "fast", fit, lambda m: errors(m.evaluate, unseen))


def nbrdf(samples: Measurements, unseen: Measurements, folder: Path) -> dict:
    fit = lambda: rivals.nbrdf_trained(0).fit(samples, folder)  # noqa: E731
    return timed("NBRDF", "fast", fit, lambda fitted: errors(fitted.evaluate, unseen))


def pinhole(described: Path, frames: list[dict], normals: np.ndarray) -> None:
    """The same photographs for the renderer, by a camera far away; the middle is where the normal faces it."""
    mask = np.linalg.norm(normals, axis=2) > 0.5
    y, x = np.nonzero(mask)
    n = normals[mask]
    # n_x = (x + 0.5 - c_x) / R and n_y = (c_y - y - 0.5) / R, by least squares: the mask is cut by whole pixels
    one, none = np.ones(len(n)), np.zeros(len(n))
    columns = [np.r_[n[:, 0], -n[:, 1]], np.r_[one, none], np.r_[none, one]]
    (radius, cx, cy), *_ = np.linalg.lstsq(np.stack(columns, 1), np.r_[x, y] + 0.5, rcond=None)
    white = np.zeros((*mask.shape, 3), np.uint8)
    white[mask] = 255 * (n[:, 2:] > 0.2)  # the silhouette is not sharp in the photographs
    mi.Bitmap(white).write(str(described / "inside.png"))
    pose = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, _FAR], [0, 0, 0, 1]]
    camera = {"fl_x": _FAR * radius, "cx": cx, "cy": cy, "mask_path": "inside.png"}
    # the files say nothing of their encoding, and PNG without a word is sRGB: EXR says linear
    linear = []
    for f in frames:
        file = described / f"{Path(f['file_path']).stem}.exr"
        if not file.exists():
            values = np.array(mi.Bitmap(f["file_path"]), np.float32) / 65535
            mi.Bitmap(values).write(str(file))
        linear.append({**f, "file_path": file.name, "transform_matrix": pose, "ceiling": 1.0})
    (described / "transforms.json").write_text(json.dumps({**camera, "frames": linear}))


def slow(name: str, views: ViewFiles, unseen: Measurements, folder: Path) -> dict:
    material = model(name)
    scene = mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "path", "max_depth": 3},
            "sphere": {
                "type": "sphere",
                "to_world": mi.ScalarTransform4f().rotate([0, 1, 0], 90),  # its pole is the tangent of `unseen`
                "bsdf": {**material.to_dict(), "id": "ball"},
            },
        }
    )
    fit = lambda: me.fit_images(scene, views, max_depth=3)  # noqa: E731
    return timed(name, "slow", fit, lambda found: errors(along_latitude(found.materials["ball"]), unseen))


def along_latitude(material: me.Material) -> Callable:
    """The material in axes whose x leads to the pole: its own x follows a circle of latitude."""
    turned = lambda w: np.stack([w[:, 1], -w[:, 0], w[:, 2]], 1)  # noqa: E731
    return lambda wi, wo: material.evaluate(turned(wi), turned(wo))


def with_ratios(rows: list[dict]) -> list[dict]:
    """Errors as ratios to the first row."""
    for row in rows:
        row["ratio"] = row["error"] / rows[0]["error"]
        if "highlight" in row:
            row["highlight_ratio"] = row["highlight"] / rows[0]["highlight"]
    return rows


# ---------------------------------------------------------------------- a flat print under a flash


def cards(source: Path, folder: Path, args) -> list[dict]:
    """Maps of GGX and of networks; the last photograph is predicted."""
    given = json.loads((source / "frames.json").read_text())
    frames = [
        {
            "file_path": str(source / f["file"]),
            "camera": {"type": "rectified", "position": f["camera"]},
            "light": {"type": "flash", "intensity": given["light_power"]},
            "split": "test" if k == len(given["frames"]) - 1 else "train",
        }
        for k, f in enumerate(given["frames"])
    ]
    described = folder / "cards"
    described.mkdir(exist_ok=True)
    content = {"plane": {"width": given["size_cm"]}, "camera": frames[0]["camera"], "frames": frames}
    (described / "photometric.json").write_text(json.dumps(content))
    factor = mi.Bitmap(frames[0]["file_path"]).size()[0] // args.size
    wi, wo, f, _ = me.data.photometric_texels(described, factor=factor)
    unseen = me.data.photometric_texels(described, split="test", factor=factor)
    rows, renders = [], {}

    def judged(found) -> dict:
        maps = found.maps
        maps.save(str(folder / f"cards_{common.folder_name(name)}.exr"))
        renders[name] = predicted(maps, unseen)
        each = log_l1_of_texels(maps, *unseen[:3])
        return {"error": float(each[unseen.counts.any(2)].mean())}

    for name in ("GGX", *args.network):
        rows.append(timed(name, "cards", lambda: me.fit_texels(model(name), wi, wo, f), judged))  # noqa: B023
    draw_cards((unseen.f * unseen.wo[..., 2:])[:, :, 0], renders, folder / "cards.png")
    return with_ratios(rows)


def predicted(maps, unseen) -> np.ndarray:
    """f cos of every texel, (H, W, 3), as the plugin says it."""
    bsdf = mi.load_dict(maps.to_dict())
    height, width = maps.shape
    y, x = (v.ravel() for v in np.mgrid[:height, :width])
    si = mi.SurfaceInteraction3f()
    si.uv = mi.Point2f((x + 0.5) / width, (y + 0.5) / height)
    si.wi = mi.Vector3f(unseen.wi[:, :, 0].reshape(-1, 3).T)
    wo = mi.Vector3f(unseen.wo[:, :, 0].reshape(-1, 3).T)
    return np.array(bsdf.eval(mi.BSDFContext(), si, wo, True)).T.reshape(height, width, 3)


def draw_cards(truth: np.ndarray, renders: dict[str, np.ndarray], path: Path) -> None:
    """The photograph kept aside over what the maps predict, and the differences, five times."""
    top = np.percentile(truth, 99.5)
    with sheet(path, (4 * (1 + len(renders)), 8), 100) as figure:
        axes = figure.subplots(2, 1 + len(renders))
        for a, (label, image) in zip(axes.T, {"photograph": truth, **renders}.items(), strict=True):
            a[0].imshow(srgb.encode_srgb(np.clip(image / top, 0, 1)))
            a[1].imshow(np.clip(5 * abs(image - truth) / top, 0, 1))
            a[0].set_title(label)
        for a in axes.flat:
            a.set_axis_off()


if __name__ == "__main__":
    main()
