"""Log-L1 of all models on measured RGL files, fitted to the same samples; ``--render``: SSIM and Delta E_ITP, too.

Four errors of each fit, all eq. (1) of the paper as a mean, over the samples of the fit:

- *as rendered*: against the file, light = Mitsuba's ``wo``;
- *reciprocal*: against the average of both orders of each pair, the truth that NPs was made from. With
  e(a, b) = f cos_b as Mitsuba's ``measured`` gives it for a viewer a and a light b:
  f = (max(e(wi, wo), 0) + max(e(wo, wi), 0)) / (cos_i + cos_o). The files are not reciprocal, most models are;
- both *below 80 degrees*: only samples with both directions less than 80 degrees from the normal; beyond, the files are
  extrapolated.

``--render`` holds renders of the Standard Shader Ball and of a sphere under an environment map against the file's own
(``image_metrics.py``; *brightness*: mean luminance of the object's pixels to that of the file): for every material
``comparison.png`` (all models) and ``short.png``; ``best.png``, ``worst.png`` with three materials each. What is no
BSDF of ours is rendered from a table (``tabulated.py``).

Writes into the folder of ``-o``: ``accuracy.csv``, ``.json``, ``.md`` (one row per model: means, ratios of the means to
GGX, the worst material), ``materials.*`` (one row per material and model), and a folder for every material with its
fits and renders, from which an interrupted run goes on.
"""

from __future__ import annotations

import functools
from pathlib import Path

import mi_enhance  # noqa: F401  (first: it finds the LLVM that Dr.Jit then loads)

import mitsuba as mi  # isort: skip
import common
import numpy as np
import rivals
import tabulated

from mi_enhance import data
from mi_enhance.benchmark.timing import machine
from mi_enhance.evaluation import comparison_picture, image_metrics, scenes
from mi_enhance.fitting.losses import log_l1
from mi_enhance.output.table import print_table, write_table
from mi_enhance.system.files import material_name, replacing

_MAX_ANGLE = 80  # degrees
_ERRORS = {
    "log_l1": "as rendered",
    "log_l1_reciprocal": "reciprocal",
    "log_l1_80": "rendered < 80°",
    "log_l1_reciprocal_80": "reciprocal < 80°",
}
_JUDGED = "log_l1_80"  # the error that ratios of single materials are about
_SCENES = {"ball": "shader_ball", "sphere": "sphere_envmap"}
_RENDERED = {
    f"{key}_{name}": (f"{name}: {text}", form)
    for name in _SCENES
    for key, text, form in (
        ("ssim", "SSIM", ".4f"),
        ("delta_E_ITP_1000", "ΔE ITP x1000", ".2f"),
        ("brightness", "brightness", ".4f"),
    )
}
_COSTS = {
    "n_parameters": ("parameters", ",.0f"),
    "bytes": ("bytes", ",.0f"),
    "shared_bytes": ("shared bytes", ",.0f"),
    "multiply_adds": ("multiply-adds", ",.0f"),
    "fit_seconds": ("fit s", ".1f"),
}
_SUMMARY = {
    "label": ("model", ""),
    "n_materials": ("of", "d"),
    **{k: v for e, text in _ERRORS.items() for k, v in {e: (text, ".5f"), f"{e}_ratio": ("ratio", ".3f")}.items()},
    "worst_ratio": ("worst", ".3f"),
    "worst": ("at", ""),
    **_RENDERED,
    **_COSTS,
}
_MATERIALS = {
    "material": ("material", ""),
    "label": ("model", ""),
    **{k: v for e, text in _ERRORS.items() for k, v in {e: (text, ".5f"), f"{e}_ratio": ("ratio", ".3f")}.items()},
    **_RENDERED,
}


def main() -> None:
    """Run the benchmark of the command line."""
    parser = common.parser(__doc__)
    parser.add_argument("data", nargs="*", help="RGL .bsdf (default: mi_enhance/bundled/rgl/*.bsdf)")
    rivals.add_options(parser)
    parser.add_argument("--nbrdf", metavar="NPZ", help="the authors' NBRDF networks of RGL materials")
    parser.add_argument("--nps", metavar="NPZ", help="NPs latents of RGL materials, decoder.npz beside them")
    parser.add_argument("--render", action="store_true", help="SSIM and Delta E_ITP on the shader ball, too")
    parser.add_argument("--resolution", type=int, default=256)
    parser.add_argument("--spp", type=int, default=256)
    parser.add_argument("-o", "--output", default="out/accuracy", help="folder (default: %(default)s)")
    args = parser.parse_args()
    mi.set_variant("llvm_ad_rgb")
    about = machine()
    contenders = [*rivals.ours(args), rivals.nbrdf_trained(args.seed)]
    contenders += [rivals.nbrdf_authors(args.nbrdf)] if args.nbrdf else []
    contenders += [rivals.nps_authors(args.nps)] if args.nps else []
    rows = []
    for path in common.rgl_files(args.data):
        print(material_name(path), flush=True)
        rows += _material(args, path, contenders)
    write_table(rows, Path(args.output) / "materials", _MATERIALS)
    if args.render:
        _extremes(args, rows)
    summary = [_summary(rows, rival.label) for rival in contenders]
    write_table(summary, Path(args.output) / "accuracy", _SUMMARY)
    title = f"log-L1, {args.samples:,} samples, {args.method}, mean of {len(rows) // len(contenders)} materials"
    print_table(*_ratios(rows), title=f"Ratio to GGX, {_ERRORS[_JUDGED]}")
    common.finish(summary, _SUMMARY, title=title, about=about, as_json=args.json)


def _material(args, path, contenders: list[rivals.Rival]) -> list[dict]:
    """One row per model."""
    folder = Path(args.output) / material_name(path)
    folder.mkdir(parents=True, exist_ok=True)
    measurements = data.load(path, n_samples=args.samples, seed=args.seed, kind="rgl")
    rows = []
    for rival in contenders:
        file = rival.stem(measurements, folder).with_suffix(".json")
        rows.append(rivals.kept(file, lambda rival=rival: _row(rival, measurements, path, folder)))
    if args.render:
        _render(args, path, measurements, folder, contenders, rows)
    for row in rows:
        for error in _ERRORS:
            row[f"{error}_ratio"] = row[error] / rows[0][error] if error in row else None
    return rows


def _row(rival: rivals.Rival, measurements: data.Measurements, path, folder: Path) -> dict:
    """Errors and costs of one fit."""
    row = {"material": measurements.name, "label": rival.label}
    fitted = rival.fit(measurements, folder)
    if fitted:
        row |= errors(fitted.evaluate, measurements, path)
        row |= {"n_parameters": fitted.n_parameters, "bytes": 4 * fitted.n_parameters, "fit_seconds": fitted.seconds}
        row |= {"shared_bytes": fitted.shared_bytes, "multiply_adds": fitted.multiply_adds}
    return row


def _render(args, path, measurements, folder: Path, contenders: list[rivals.Rival], rows: list[dict]) -> None:
    """Add the image errors to the rows, and draw truth and models side by side."""
    lobe = contenders[0].fit(measurements, folder).material
    tiles, stem = [], folder / f"measured-{args.seed}"
    measured = functools.partial(mi.load_dict, {"type": "measured", "filename": str(path)})
    truths = {name: _image(args, name, stem, measured) for name in _SCENES}
    for name, truth in truths.items():
        mask = _object(name, args.resolution)
        for rival, row in zip(contenders, rows, strict=True):
            fitted = rival.fit(measurements, folder)
            if fitted:
                image = _image(args, name, rival.stem(measurements, folder), lambda fitted=fitted: _bsdf(fitted, lobe))
                error = image_metrics.delta_E_ITP_map(image, truth)
                row[f"ssim_{name}"] = image_metrics.ssim(image, truth)
                row[f"delta_E_ITP_1000_{name}"] = 1000 * float(np.mean(error))
                row[f"brightness_{name}"] = _luminance(image[mask]) / _luminance(truth[mask])
                if name == "ball":
                    shown = {"ssim": row["ssim_ball"], "delta_E_ITP_1000": row["delta_E_ITP_1000_ball"]}
                    tiles.append({**row, **shown, "image": image, "error": error})
    truth = truths["ball"]
    comparison_picture.draw(("measured", truth), tiles, folder / "comparison.png", title=measurements.name)
    # the reference, the network named first, and the rival that is trained for each material: what a page has room for
    network = next((row["label"] for row in rows if row["label"].startswith("enhanced")), None)
    short = [tile for tile in tiles if tile["label"] in (rivals.REFERENCE, network, "NBRDF trained")]
    comparison_picture.draw(("measured", truth), short, folder / "short.png", title=measurements.name)


def _extremes(args, rows: list[dict]) -> None:
    """``best.png`` and ``worst.png``: the three materials with the lowest and highest ratio of the first network."""
    network = next((row["label"] for row in rows if row["label"].startswith("enhanced")), rivals.REFERENCE)
    ranked = sorted((row for row in rows if row["label"] == network), key=lambda row: row[f"{_JUDGED}_ratio"])
    for name, three in (("best", ranked[:3]), ("worst", ranked[:-4:-1])):
        tiles = [np.array(mi.Bitmap(str(Path(args.output) / row["material"] / "short.png"))) for row in three]
        with replacing(Path(args.output) / f"{name}.png") as temporary:
            mi.Bitmap(np.concatenate(tiles)).write(temporary)


def _bsdf(fitted: rivals.Fitted, lobe: rivals.Material):
    return fitted.material.bsdf() if fitted.material else tabulated.bsdf(tabulated.tabulate(fitted.evaluate), lobe)


def _image(args, scene: str, stem: Path, make_bsdf) -> np.ndarray:
    """A render of one of the scenes, from the file that an earlier run has left or anew."""
    suffix = "" if scene == "ball" else f".{scene}"
    file = stem.with_suffix(f"{suffix}.{args.resolution}-{args.spp}.exr")
    if not file.exists():
        loaded = scenes.load(_SCENES[scene], make_bsdf(), resolution=args.resolution, spp=args.spp)
        image = mi.Bitmap(np.array(mi.render(loaded, spp=args.spp, seed=args.seed)))
        with replacing(file) as temporary:
            image.write(temporary)
    return np.array(mi.Bitmap(str(file)), np.float32)


@functools.cache
def _object(scene: str, resolution: int) -> np.ndarray:
    """Return the pixels whose centre shows the material, (H, W)."""
    bsdf = mi.load_dict({"type": "diffuse"})
    loaded = scenes.load(_SCENES[scene], bsdf, resolution=resolution, spp=1)
    y, x = (mi.Float(v.ravel().astype(np.float32)) for v in np.mgrid[:resolution, :resolution])
    at = mi.Point2f(x + 0.5, y + 0.5) / resolution
    ray, _ = loaded.sensors()[0].sample_ray_differential(0, 0.5, at, 0.5)
    si = loaded.ray_intersect(ray)
    return np.array(si.is_valid() & (si.bsdf() == mi.BSDFPtr(bsdf))).reshape(resolution, -1)


def _luminance(pixels: np.ndarray) -> float:
    return float(pixels.mean(0, dtype=np.float64) @ (0.2126, 0.7152, 0.0722))


def errors(evaluate, measurements: data.Measurements, path) -> dict:
    """The four errors of a model on the samples of an RGL file."""
    wi, wo = measurements.wi, measurements.wo
    cos_i, cos_o = wi[:, 2:], wo[:, 2:]
    reciprocal = common.averaged(measurements, path)
    f = evaluate(wi, wo)
    below = np.minimum(cos_i, cos_o)[:, 0] > np.cos(np.deg2rad(_MAX_ANGLE))
    return {
        name + suffix: log_l1(f[keep], truth[keep], wo[keep, 2])
        for name, truth in (("log_l1", measurements.f), ("log_l1_reciprocal", reciprocal))
        for suffix, keep in (("", slice(None)), ("_80", below))
    }


def _summary(rows: list[dict], label: str) -> dict:
    """Means of one model over the materials it has; the ratios are those of the means over these materials."""
    own = [row for row in rows if row["label"] == label and _JUDGED in row]
    if not own:
        return {"label": label}
    there = {row["material"] for row in own}
    reference = [row for row in rows if row["label"] == rivals.REFERENCE and row["material"] in there]
    mean = lambda some, key: float(np.mean([row[key] for row in some]))  # noqa: E731
    summary = {"label": label, "n_materials": len(own)}
    for error in _ERRORS:
        summary[error] = mean(own, error)
        summary[f"{error}_ratio"] = mean(own, error) / mean(reference, error)
    worst = max(own, key=lambda row: row[f"{_JUDGED}_ratio"])
    summary |= {"worst_ratio": worst[f"{_JUDGED}_ratio"], "worst": worst["material"]}
    for key in (*_RENDERED, *_COSTS):
        summary[key] = mean(own, key) if own[0].get(key) is not None else None
    return summary


def _ratios(rows: list[dict]) -> tuple[list[dict], dict]:
    """One row per material, one column per model."""
    columns = {"material": ("material", "")}
    table = {}
    for row in rows:
        columns[row["label"]] = (row["label"], ".3f")
        table.setdefault(row["material"], {"material": row["material"]})[row["label"]] = row[f"{_JUDGED}_ratio"]
    return list(table.values()), columns


if __name__ == "__main__":
    main()
