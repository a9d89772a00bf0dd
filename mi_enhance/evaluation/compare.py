"""Several materials in one scene, held against the ground truth: pictures, SSIM, Delta E_ITP and run time.

All renders use the same scene, seed and number of samples. Each material is rendered once with few samples before the
clock starts, so the rate (Mpaths/s) holds no compilation; the time of that first frame is reported beside it.
"""

from __future__ import annotations

import re
import time
from pathlib import Path

import mitsuba as mi
import numpy as np

from .. import data
from ..output.table import write_table
from ..system.files import material_name, replacing, require_file
from . import comparison_picture, image_metrics, scenes

_WARM_UP_SPP = 1  # compiles the same kernels as any other number


def compare(
    truth,
    candidates,
    *,
    folder,
    scene="shader_ball",
    resolution=256,
    spp=256,
    seed=0,
    truth_label="measured",
    title=None,
    log=None,
):
    """Render ground truth and candidates in one scene, measure their difference, and write pictures.

    Parameters
    ----------
    truth : dict or mi.BSDF
        The ground truth.
    candidates : dict of str to dict or mi.BSDF
        What is compared, in order; the keys are the labels.
    folder : str or Path
        Folder for ``comparison.png`` and one ``<label>.exr`` each (linear RGB radiance); made if missing.
    scene : str or Path
        As for `mi_enhance.evaluation.scenes.load`.
    resolution, spp : int
        Pixels on a side, samples per pixel. Mitsuba may round `spp` up; the rate counts what was traced.
    seed : int
        Of the sampler, the same for all: what is equal in two materials then shows equal noise.
    truth_label, title : str
        Label of the ground truth; name of the material in the picture.
    log : callable, optional
        Called with one line of text before each render.

    Returns
    -------
    list of dict
        One row for the ground truth and each candidate: ``label``, ``ssim``, ``delta_E_ITP_1000`` (mean, times
        1000), ``psnr`` in dB (None where images are equal), ``mean_abs_log``, ``render_seconds_cold`` (scene, tracing,
        compilation, one sample), ``render_seconds``, ``mpaths_per_s``, ``image`` (path of the EXR).

    Raises
    ------
    ValueError
        If there is no candidate, two labels give the same file name, or a render holds NaN.

    Examples
    --------
    >>> compare({"type": "diffuse"}, {"GGX": {"type": "roughconductor"}}, folder="out")  # doctest: +SKIP
    """
    bsdfs = {truth_label: truth, **candidates}
    files = {label: f"{_file_name(label)}.exr" for label in bsdfs}
    if len(bsdfs) != len(candidates) + 1 or len(set(files.values())) != len(bsdfs) or not candidates:
        raise ValueError(
            f"compare(): labels {[truth_label, *candidates]} must be at least two, and differ in letters or digits, "
            "because each names a file. Rename one."
        )
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)

    images, errors, rows = {}, {}, []
    for label, bsdf in bsdfs.items():
        if log:
            log(f"render {label}: {resolution} x {resolution}, {spp} spp")
        images[label], seconds = _render(bsdf, scene, resolution, spp, seed)
        _write_exr(images[label], folder / files[label])
        pair = images[label], images[truth_label]
        errors[label] = image_metrics.delta_E_ITP_map(*pair)
        psnr = image_metrics.psnr(*pair)
        rows.append(
            {
                "label": label,
                "ssim": image_metrics.ssim(*pair),
                "delta_E_ITP_1000": 1000 * float(np.mean(errors[label])),
                "psnr": psnr if np.isfinite(psnr) else None,  # JSON knows no infinity
                "mean_abs_log": image_metrics.mean_abs_log(*pair),
                **seconds,
                "image": str(folder / files[label]),
            }
        )
    tiles = [{**row, "image": images[row["label"]], "error": errors[row["label"]]} for row in rows[1:]]
    comparison_picture.draw((truth_label, images[truth_label]), tiles, folder / "comparison.png", title=title)
    return rows


def default_models(network=None):
    """Return what `compare_files` fits by default: plain GGX and the enhanced network, not yet fitted.

    Parameters
    ----------
    network : Material, optional
        The enhanced model; the shipped default if left out.

    Examples
    --------
    >>> list(default_models())
    ['GGX', 'enhanced GGX']
    """
    from ..material.material import Material

    return {"GGX": Material.analytic("ggx"), "enhanced GGX": network or Material.pretrained()}


def compare_file(path, *, folder, models=None, method="lm", n_samples=100_000, seed=0, log=None, **render):
    """Fit models to one measured RGL file and compare them with it.

    Parameters
    ----------
    path : str or Path
        RGL ``.bsdf``, which Mitsuba's plugin ``measured`` renders as ground truth.
    folder : str or Path
        As for `compare`; besides, ``<label>.bsdf`` for each fitted material.
    models : dict of str to Material, optional
        Unfitted materials by label; `default_models` if left out.
    method, n_samples, seed
        Of the fit and of the sampling of the data; `seed` of the render too.
    log, **render
        As for `compare`: `scene`, `resolution`, `spp`.

    Returns
    -------
    list of dict
        The rows of `compare`, with ``material``, ``log_l1``, ``fit_seconds``, ``bytes`` (of the file of a measured
        material; of the parameters and network of a fitted one) and ``file``.

    Examples
    --------
    >>> compare_file("mi_enhance/bundled/rgl/satin_rosaline_rgb.bsdf", folder="out/satin")  # doctest: +SKIP
    """
    from ..fitting.fit import fit

    path = require_file(path, f'compare_file("{path}")')
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    measurements = data.load(path, n_samples=n_samples, seed=seed, kind="rgl")
    models = default_models() if models is None else models
    fitted, columns = {}, [{"log_l1": 0.0, "fit_seconds": None, "bytes": path.stat().st_size, "file": str(path)}]
    for label, model in models.items():
        if log:
            log(f"fit {label} to {len(measurements.f)} samples of {measurements.name}")
        material = fit(model, measurements, method=method, seed=seed)
        file = folder / f"{_file_name(label)}.bsdf"
        material.save(file)
        fitted[label] = material.bsdf()
        report = material.report
        columns.append(
            {"log_l1": report["log_l1"], "fit_seconds": report["seconds"], "bytes": material.n_bytes, "file": str(file)}
        )
    truth = {"type": "measured", "filename": str(path)}
    rows = compare(truth, fitted, folder=folder, seed=seed, log=log, title=material_name(path), **render)
    return [{"material": material_name(path), **row, **column} for row, column in zip(rows, columns, strict=True)]


def compare_files(paths, *, folder, **settings):
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
    dict
        ``rows`` (all), ``mean`` (one row for each label, ``material`` = "mean of N"), ``tables`` (paths).

    Raises
    ------
    ValueError
        If no file is given, or two have the same material name, since each names a folder.

    Examples
    --------
    >>> compare_files(["mi_enhance/bundled/rgl/satin_rosaline_rgb.bsdf"], folder="out")  # doctest: +SKIP
    """
    names = [material_name(path) for path in paths]
    if not names or len(set(names)) != len(names):
        raise ValueError(f"compare_files(): materials {names} must be at least one and all different. Rename a file.")
    folder = Path(folder)
    rows = [
        row
        for name, path in zip(names, paths, strict=True)
        for row in compare_file(path, folder=folder / name, **settings)
    ]
    mean = _mean(rows, f"mean of {len(names)}")
    tables = write_table(rows + mean, folder / "comparison")
    return {"rows": rows, "mean": mean, "tables": {suffix: str(path) for suffix, path in tables.items()}}


def _mean(rows, name):
    """One row for each label: the mean of every number, but the harmonic mean of the rate (all paths / all seconds)."""
    result = []
    for label in dict.fromkeys(row["label"] for row in rows):
        group = [row for row in rows if row["label"] == label]
        mean = {"material": name, "label": label}
        for key in group[0]:
            values = [row[key] for row in group]
            if key == "mpaths_per_s":
                mean[key] = len(values) / sum(1 / value for value in values)
            elif key == "bytes":
                mean[key] = round(sum(values) / len(values))
            elif all(isinstance(value, (int, float)) for value in values):
                mean[key] = sum(values) / len(values)
        result.append(mean)
    return result


def _render(bsdf, scene, resolution, spp, seed):
    start = time.perf_counter()
    loaded = scenes.load(scene, bsdf, resolution=resolution, spp=spp)
    np.array(mi.render(loaded, spp=_WARM_UP_SPP, seed=seed))  # the copy waits for the kernels
    cold = time.perf_counter() - start
    start = time.perf_counter()
    image = np.array(mi.render(loaded, spp=spp, seed=seed))
    seconds = time.perf_counter() - start
    traced = loaded.sensors()[0].sampler().sample_count()  # spp, rounded up where the sampler needs it
    rate = resolution**2 * traced / seconds / 1e6
    return image, {"render_seconds_cold": cold, "render_seconds": seconds, "mpaths_per_s": rate}


def _write_exr(image, path):
    with replacing(path) as temporary:
        mi.Bitmap(image.astype(np.float32)).write(temporary)


def _file_name(label):
    return re.sub(r"[^A-Za-z0-9]+", "_", label).strip("_").lower()
