"""Several materials in one scene, held against the ground truth: pictures, SSIM, Delta E_ITP and run time.

A measurement that cannot be rendered (all but RGL files) is a truth for samples only: then there are renders of the
models and log-L1, and no errors of pictures.

All renders use the same scene, seed and number of samples. Each material is rendered once with few samples before the
clock starts, so the rate (Mpaths/s) holds no compilation; the time of that first frame is reported beside it.
"""

from __future__ import annotations

import dataclasses
import re
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import mitsuba as mi
import numpy as np

from ..data.loading import load
from ..fitting.fit import fit
from ..material.material import Material
from ..output.table import write_table
from ..system.files import material_name, replacing
from ..system.progress import Callback, Progress, silent
from . import comparison_picture, image_metrics, scenes
from .truth import rendered_truth

_WARM_UP_SPP = 1  # compiles the same kernels as any other number

if TYPE_CHECKING:  # mi.BSDF is there only once a variant is set
    BSDF = dict | mi.BSDF


def compare(
    truth: BSDF | None,
    candidates: Mapping[str, BSDF],
    folder: str | Path,
    *,
    scene: str | Path = "shader_ball",
    resolution: int = 256,
    spp: int = 256,
    seed: int = 0,
    truth_label: str = "measured",
    title: str | None = None,
    progress: Callback = silent,
) -> list[dict]:
    """Render ground truth and candidates in one scene, measure their difference, and write pictures.

    Parameters
    ----------
    truth : dict, mi.BSDF or None
        The ground truth; None if it cannot be rendered.
    candidates : dict of str to dict or mi.BSDF
        The models to compare, in order; the keys are the labels.
    folder : str or Path
        Folder for ``comparison.png`` and one ``<label>.exr`` each (linear RGB radiance); made if missing.
    scene : str or Path
        As for `mi_enhance.evaluation.scenes.load`.
    resolution, spp : int
        Pixels on a side, samples per pixel. Mitsuba may round `spp` up; the rate counts what was traced.
    seed : int
        Of the sampler, the same for all: equal materials then show equal noise.
    truth_label, title : str
        Label of the ground truth; name of the material in the picture.
    progress : callable
        Hears of every render before it begins, see :mod:`mi_enhance.system.progress`.

    Returns
    -------
    list of dict
        One row for the ground truth, if any, and each candidate: ``label``, ``ssim``, ``delta_E_ITP_1000`` (mean, times
        1000), ``psnr`` in dB (None where images are equal), ``mean_abs_log`` (these four only beside a ground truth),
        ``render_seconds_cold`` (scene, tracing, compilation, one sample), ``render_seconds``, ``mpaths_per_s``,
        ``image`` (path of the EXR).

    Raises
    ------
    ValueError
        If there is no candidate, two labels give the same file name, or a render holds NaN.

    Examples
    --------
    >>> compare({"type": "diffuse"}, {"GGX": {"type": "roughconductor"}}, "out")  # doctest: +SKIP
    """
    bsdfs = dict(candidates) if truth is None else {truth_label: truth, **candidates}
    files = {label: f"{_file_name(label)}.exr" for label in bsdfs}
    clash = truth is not None and truth_label in candidates
    if clash or len(set(files.values())) != len(bsdfs) or not candidates:
        raise ValueError(
            f"compare(): labels {[truth_label, *candidates]} must be at least two, and differ in letters or digits, "
            "because each names a file. Rename one."
        )
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)

    images: dict[str, np.ndarray] = {}
    errors: dict[str, np.ndarray] = {}
    rows: list[dict] = []
    for k, (label, bsdf) in enumerate(bsdfs.items()):
        progress(Progress(f"render {label}: {resolution} x {resolution}, {spp} spp", k, len(bsdfs)))
        images[label], seconds = _render(bsdf, scene, resolution, spp, seed)
        _write_exr(images[label], folder / files[label])
        row: dict[str, Any] = {"label": label}
        if truth is not None:
            pair = images[label], images[truth_label]
            errors[label] = image_metrics.delta_E_ITP_map(*pair)
            psnr = image_metrics.psnr(*pair)
            row |= {
                "ssim": image_metrics.ssim(*pair),
                "delta_E_ITP_1000": 1000 * float(np.mean(errors[label])),
                "psnr": psnr if np.isfinite(psnr) else None,  # JSON knows no infinity
                "mean_abs_log": image_metrics.mean_abs_log(*pair),
            }
        rows.append({**row, **seconds, "image": str(folder / files[label])})
    tiles = [{**row, "image": images[row["label"]], "error": errors.get(row["label"])} for row in rows]
    shown = None if truth is None else (truth_label, images[truth_label])
    comparison_picture.draw(shown, tiles[truth is not None :], folder / "comparison.png", title=title)
    return rows


def default_models(network: Material | None = None) -> dict[str, Material]:
    """Return the models that `compare_files` fits by default: plain GGX and the enhanced one, not yet fitted.

    Parameters
    ----------
    network : Material, optional
        The enhanced model; the shipped default if left out.

    Examples
    --------
    >>> list(default_models())
    ['GGX', 'enhanced GGX']
    """
    return {"GGX": Material.analytic("ggx"), "enhanced GGX": network or Material.pretrained()}


def compare_file(
    path: str | Path,
    folder: str | Path,
    *,
    material: str | None = None,
    models: Mapping[str, Material] | None = None,
    method: Literal["lm", "rmsprop"] = "lm",
    n_samples: int = 100_000,
    seed: int = 0,
    progress: Callback = silent,
    **render: Any,
) -> list[dict]:
    """Fit models to one measured file and compare them with it.

    Parameters
    ----------
    path : str or Path
        Of any kind that :func:`mi_enhance.data.loading.load` reads. An RGL ``.bsdf`` is rendered as ground truth by
        Mitsuba's plugin ``measured``; of other kinds the errors are those of the samples.
    folder : str or Path
        As for `compare`; besides, ``<label>.bsdf`` for each fitted material.
    material : str, optional
        Which one, in a file that holds several.
    models : dict of str to Material, optional
        Unfitted materials by label; `default_models` if left out.
    method, n_samples, seed
        Of the fit and of the sampling of the data; `seed` of the render too.
    progress, **render
        As for `compare`: `scene`, `resolution`, `spp`. Fits are told, too.

    Returns
    -------
    list of dict
        The rows of `compare`, with ``material``, ``log_l1`` (of the samples), ``fit_seconds``, ``bytes`` (of the file
        of a measured material; of the parameters and network of a fitted one) and ``file``.

    Examples
    --------
    >>> compare_file("mi_enhance/bundled/rgl/satin_rosaline_rgb.bsdf", "out/satin")  # doctest: +SKIP
    """
    truth = rendered_truth(path, "compare_file()")
    measurements = load(path, n_samples=n_samples, seed=seed, material=material)
    path, folder = Path(path), Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    models = default_models() if models is None else models
    fitted: dict[str, BSDF] = {}
    columns: list[dict] = []
    if truth:
        columns.append({"log_l1": 0.0, "fit_seconds": None, "bytes": path.stat().st_size, "file": str(path)})
    for k, (label, model) in enumerate(models.items()):
        progress(Progress(f"fit {label} to {len(measurements.f)} samples of {measurements.name}", k, len(models)))
        ours = fit(model, measurements, method=method, seed=seed)
        file = folder / f"{_file_name(label)}.bsdf"
        ours.save(file)
        fitted[label] = ours.bsdf()
        report = ours.report
        columns.append(
            {"log_l1": report["log_l1"], "fit_seconds": report["seconds"], "bytes": ours.n_bytes, "file": str(file)}
        )
    name = measurements.name
    rows = compare(truth, fitted, folder, seed=seed, progress=progress, title=name, **render)
    return [{"material": name, **row, **column} for row, column in zip(rows, columns, strict=True)]


@dataclasses.dataclass(frozen=True)
class Comparison:
    """Result of :func:`compare_files`.

    Parameters
    ----------
    rows : list of dict
        All rows of all files, as of `compare_file`.
    mean : list of dict
        One row for each label, ``material`` = "mean of N".
    tables : dict of str to str
        The tables written, by suffix.
    """

    rows: list[dict]
    mean: list[dict]
    tables: dict[str, str]


def compare_files(paths: Sequence[str | Path], folder: str | Path, **settings: Any) -> Comparison:
    """Run `compare_file` on several measured files and average the figures of each model.

    Parameters
    ----------
    paths : list of str or Path
    folder : str or Path
        One folder for each material, and ``comparison.csv``, ``.json``, ``.md`` with all rows and the means.
    **settings
        As for `compare_file`.

    Returns
    -------
    Comparison

    Raises
    ------
    ValueError
        If no file is given, or two have the same material name, since each names a folder.

    Examples
    --------
    >>> compare_files(["mi_enhance/bundled/rgl/satin_rosaline_rgb.bsdf"], "out")  # doctest: +SKIP
    """
    names = [settings.get("material") or material_name(path) for path in paths]
    if not names or len(set(names)) != len(names):
        raise ValueError(f"compare_files(): materials {names} must be at least one and all different. Rename a file.")
    folder = Path(folder)
    rows = [
        row for name, path in zip(names, paths, strict=True) for row in compare_file(path, folder / name, **settings)
    ]
    mean = _mean(rows, f"mean of {len(names)}")
    tables = write_table(rows + mean, folder / "comparison")
    return Comparison(rows, mean, {suffix: str(path) for suffix, path in tables.items()})


def _mean(rows: list[dict], name: str) -> list[dict]:
    """One row for each label: the mean of every number, but the harmonic mean of the rate (all paths / all seconds)."""
    result = []
    for label in dict.fromkeys(row["label"] for row in rows):
        group = [row for row in rows if row["label"] == label]
        mean: dict[str, Any] = {"material": name, "label": label}
        for key in group[0]:
            values: list[Any] = [row.get(key) for row in group]  # some files have a render beside them, some have not
            if key == "mpaths_per_s":
                mean[key] = len(values) / sum(1 / value for value in values)
            elif key == "bytes":
                mean[key] = round(sum(values) / len(values))
            elif all(isinstance(value, (int, float)) for value in values):
                mean[key] = sum(values) / len(values)
        result.append(mean)
    return result


def _render(bsdf: BSDF, scene: str | Path, resolution: int, spp: int, seed: int) -> tuple[np.ndarray, dict[str, float]]:
    start = time.perf_counter()
    loaded = scenes.load(scene, bsdf, resolution=resolution, spp=spp)
    np.array(mi.render(loaded, spp=_WARM_UP_SPP, seed=mi.UInt32(seed)))  # the copy waits for the kernels
    cold = time.perf_counter() - start
    start = time.perf_counter()
    image = np.array(mi.render(loaded, spp=spp, seed=mi.UInt32(seed)))
    seconds = time.perf_counter() - start
    traced = loaded.sensors()[0].sampler().sample_count()  # spp, rounded up where the sampler needs it
    rate = resolution**2 * traced / seconds / 1e6
    return image, {"render_seconds_cold": cold, "render_seconds": seconds, "mpaths_per_s": rate}


def _write_exr(image: np.ndarray, path: Path) -> None:
    with replacing(path) as temporary:
        mi.Bitmap(image.astype(np.float32)).write(temporary)


def _file_name(label: str) -> str:
    return re.sub(r"[^A-Za-z0-9]+", "_", label).strip("_").lower()
