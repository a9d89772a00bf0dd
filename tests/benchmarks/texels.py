"""A surface mixed from measured materials: per-texel fits of GGX and of a network, errors on unseen samples, renders.

Three RGL files, mixed by smooth masks; every texel has the same pairs of directions. The ground truth of the renders is
Mitsuba's `blendbsdf` of `measured`, with the masks as textures.
"""

from __future__ import annotations

from pathlib import Path

import mi_enhance  # noqa: F401  (first: it finds the LLVM that Dr.Jit then loads)

import mitsuba as mi  # isort: skip
import common
import numpy as np

from mi_enhance import Material
from mi_enhance.analytic import parameter_space
from mi_enhance.benchmark.timing import machine
from mi_enhance.data import directions, rgl
from mi_enhance.data.measurements import clamp_negative
from mi_enhance.evaluation import image_metrics, scenes
from mi_enhance.evaluation.comparison_picture import draw
from mi_enhance.fitting.fit_texels import fit_texels, log_l1_of_texels
from mi_enhance.fitting.problems import stacked
from mi_enhance.material.material_maps import MaterialMaps
from mi_enhance.output import srgb
from mi_enhance.output.figure import sheet

_RGL = Path(__file__).resolve().parents[2] / "mi_enhance/bundled/rgl"
_FILES = [str(_RGL / f"{name}_rgb.bsdf") for name in ("satin_rosaline", "ilm_solo_m_68", "cc_ibiza_sunset")]
_UNSEEN = 512  # samples per texel
_MIN_COS = np.cos(np.deg2rad(80))  # beyond, the files are extrapolated, and no rig that measures a surface looks
_COLUMNS = {
    "label": ("model", ""),
    "log_l1": ("log-L1, fitted samples", ".5f"),
    "unseen": ("unseen", ".5f"),
    "ratio": ("to GGX", ".2f"),
    "worst": ("worst texel", ".4f"),
    "seams": ("seams", ".5f"),
    "better": ("texels better than GGX", ".1%"),
    "seconds_per_1000": ("s per 1,000 texels", ".2f"),
    "mean_abs_log": ("render: mean abs log", ".5f"),
    "delta_E_ITP_1000": ("ΔE ITP x1000", ".2f"),
    "ssim": ("SSIM", ".4f"),
}


def main() -> None:
    """Run the benchmark of the command line."""
    parser = common.parser(__doc__)
    parser.add_argument("files", nargs="*", default=_FILES, help="three RGL files")
    parser.add_argument("--size", type=int, default=128, help="texels along each side (default: %(default)s)")
    parser.add_argument("--samples", type=int, default=128, help="per texel (default: %(default)s)")
    parser.add_argument("--smoothness", type=float, default=0.0)
    parser.add_argument("-m", "--network", nargs="+", default=["ggx2_small", "ggx2"])
    parser.add_argument("--filter", default="nearest", choices=("nearest", "bilinear"), help="of the maps, in renders")
    parser.add_argument("--resolution", type=int, default=256)
    parser.add_argument("--spp", type=int, default=256)
    parser.add_argument("-o", "--output", default="out/texels", help="folder of the pictures and maps")
    args = parser.parse_args()
    mi.set_variant("llvm_ad_rgb")
    about, folder = machine(), Path(args.output)
    folder.mkdir(parents=True, exist_ok=True)
    weights = masks(args.size)
    samples, unseen = (mixture(args.files, weights, n, seed) for n, seed in ((args.samples, 0), (_UNSEEN, 1)))
    truth = render(blend(args.files, weights), args)
    rows, found, pictures = [], {}, []
    models = {"GGX": Material.analytic("ggx"), **{f"enhanced {n}": common.network(n) for n in args.network}}
    for label, material in models.items():
        maps = fit_texels(material, *samples, smoothness=args.smoothness).maps
        error = found[label] = log_l1_of_texels(maps, *unseen)
        image = render(maps.to_dict(args.filter), args)
        stem = folder / label.replace(" ", "_")
        maps.save(f"{stem}.exr")
        maps.material.save(f"{stem}.bsdf")
        draw_maps(maps, f"{stem}.png")
        delta = image_metrics.delta_E_ITP_map(image, truth)
        row = {
            "label": label,
            **{key: maps.material.report[key] for key in ("log_l1", "seconds", "seconds_per_1000")},
            "unseen": error.mean(),
            "ratio": error.mean() / found["GGX"].mean(),
            "worst": error.max(),
            "seams": seams(maps, *unseen[:2]),
            "better": (error < found["GGX"]).mean(),
            "mean_abs_log": image_metrics.mean_abs_log(image, truth),
            "delta_E_ITP_1000": 1000 * delta.mean(),
            "ssim": image_metrics.ssim(image, truth),
        }
        rows.append(row)
        pictures.append({**row, "image": image, "error": delta})
    draw_errors(found, folder / "errors.png")
    draw(("measured, mixed", truth), pictures, folder / "renders.png", title=f"{args.size} x {args.size} texels")
    title = f"{args.size} x {args.size} texels, {args.samples} samples each, smoothness {args.smoothness:g}"
    common.finish(rows, _COLUMNS, title=title, about=about, as_json=args.json)


def masks(size: int) -> np.ndarray:
    """Weights of three materials at every texel, (size, size, 3): smooth, of sum 1, periodic."""
    x = (np.arange(size) + 0.5) / size * 2 * np.pi
    x, y = np.meshgrid(x, x)
    w = np.exp(4 * np.stack([np.sin(x + y), np.sin(2 * x - y + 2), np.sin(x - 2 * y + 4)], axis=2))
    return w / w.sum(2, keepdims=True)


def mixture(files: list[str], weights: np.ndarray, n: int, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Directions wi, wo (n, 3), and what each texel reflects (H, W, n, 3)."""
    wi, wo = directions.sample_pairs(n, seed=seed, min_cos=_MIN_COS)
    values = np.stack([clamp_negative(rgl.evaluate(path, wi, wo))[0] for path in files])
    return wi, wo, np.einsum("hwk,knc->hwnc", weights, values).astype(np.float32)


def blend(files: list[str], weights: np.ndarray) -> dict:
    """The same mixture as a BSDF of Mitsuba: the last material over a blend of the first two."""
    first, second, third = ({"type": "measured", "filename": path} for path in files)
    a, b, c = np.moveaxis(weights, 2, 0)

    def texture(values):
        return {"type": "bitmap", "data": mi.TensorXf(values[..., None].astype(np.float32)), "raw": True}

    inner = {"type": "blendbsdf", "weight": texture(b / (a + b)), "first": first, "second": second}
    return {"type": "blendbsdf", "weight": texture(c), "first": inner, "second": third}


def seams(maps: MaterialMaps, wi: np.ndarray, wo: np.ndarray) -> float:
    """Log-L1 between what bilinear maps are in the middle of four texels, and the mean of what these reflect."""
    brdf, black = maps.material.brdf, np.zeros((maps.shape[1], len(wi), 3))
    rows = parameter_space.Space(brdf.parameters).to_free(maps.as_vectors().astype(np.float64))
    # a row at a time; residuals are differences of log(1 + f cos)
    logs = np.array([[np.array(c) for c in stacked(brdf, wi, wo, black).residuals(u)] for u in rows])
    f = np.expm1(-logs).reshape(len(rows), 3, -1, len(wi)).transpose(0, 2, 3, 1) / wo[:, 2:]
    between = MaterialMaps(maps.material, {name: middle(values) for name, values in maps.maps.items()})
    return float(log_l1_of_texels(between, wi, wo, np.maximum(middle(f), 0)).mean())


def middle(a: np.ndarray) -> np.ndarray:
    """Means of four neighbours, (H - 1, W - 1, ...)."""
    return (a[:-1, :-1] + a[1:, :-1] + a[:-1, 1:] + a[1:, 1:]) / 4


def render(bsdf: dict, args) -> np.ndarray:
    """On the sphere under the environment map."""
    loaded = scenes.load("sphere_envmap", bsdf, resolution=args.resolution, spp=args.spp)
    return np.array(mi.render(loaded, seed=0))


def draw_maps(maps, path) -> None:
    """Colours, and the first channel of everything else."""
    shown = {name: values for name, values in maps.maps.items() if name not in ("n_x", "n_y", "t_theta")}
    with sheet(path, (3 * len(shown), 3.2), 90) as figure:
        for axes, (name, values) in zip(np.ravel(figure.subplots(1, len(shown))), shown.items(), strict=True):
            colour = values.shape[2] == 3
            image = srgb.encode_srgb(values / max(1, values.max())) if colour else values[..., 0]
            axes.imshow(image, cmap=None if colour else "viridis")
            axes.set_title(name if values.shape[2] in (1, 3) else f"{name}.00")
            axes.set_axis_off()


def draw_errors(errors: dict, path) -> None:
    """Log-L1 of each texel on unseen samples, one scale for all models."""
    top = max(np.percentile(e, 99) for e in errors.values())
    with sheet(path, (3.6 * len(errors), 3.4), 110) as figure:
        for axes, (label, error) in zip(figure.subplots(1, len(errors)), errors.items(), strict=True):
            shown = axes.imshow(error, cmap="inferno", vmin=0, vmax=top)
            axes.set_title(f"{label}: {error.mean():.4f}")
            axes.set_axis_off()
        figure.colorbar(shown, ax=figure.axes, shrink=0.8, label="log-L1, unseen samples")


if __name__ == "__main__":
    main()
