"""Error against run time: a table, a Pareto plot and a page of every model of some measured materials.

Errors are those of unseen samples and, where all files can be rendered (RGL), of a render beside the measured file;
times are medians of interleaved runs, as ratios to plain GGX of this package: a plugin in Python like ours, without
networks.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np

from ..data.loading import is_scattered, load
from ..data.measurements import Measurements, split
from ..evaluation import scenes
from ..evaluation.truth import rendered_truth
from ..material.material import Material
from ..output.table import write_table
from ..system.files import material_name, replacing
from ..system.progress import Callback, Progress, silent
from ..system.run_folder import keep_settings
from ..system.workers import alone, run_all
from . import timing
from .contender import Contender
from .contenders import REFERENCE, contenders, settings_of_fits, textured
from .errors import rendered_errors, write_json
from .growth import GROWTH_COLUMNS, growth
from .hybrid_contender import HYBRID_OF_FILES, hybrids_of_files
from .jobs import LANES, MANY, frame, kernel, many, sphere
from .page import draw_pareto, write_page
from .processes import Workers, first_frames

_UNSEEN = 50_000  # pairs that errors are measured on
_SAMPLER = {"ball": "multijitter"}  # of the scenes: `independent` unless named
COLUMNS = {
    "label": ("model", ""),
    "log_l1": ("log-L1", ".4f"),
    "error_ratio": ("to GGX", ".2f"),
    "ssim": ("SSIM", ".4f"),
    "delta_E_ITP_1000": ("ΔE ITP x1000", ".2f"),
    "eval_ns": ("eval ns", ".1f"),
    "gflops": ("GFLOP/s", ".0f"),
    "ball": ("ball Mpaths/s", ".2f"),
    "ball_ratio": ("to GGX", ".2f"),
    "many": (f"{MANY} materials", ".2f"),
    "many_ratio": ("to GGX", ".2f"),
    "textured": ("textured", ".2f"),
    "textured_ratio": ("to GGX", ".2f"),
    "cold": ("first frame, cold s", ".2f"),
    "warm": ("warm s", ".2f"),
    "megabytes": ("peak MB", ".0f"),
    "n_bytes": ("bytes", ",d"),
    "shared_bytes": ("shared bytes", ",d"),
    "multiply_adds": ("multiply-adds", ",d"),
    "fit_seconds": ("fit s", ".1f"),
}


@dataclasses.dataclass(frozen=True)
class BenchReport:
    """Result of a benchmark.

    Parameters
    ----------
    machine : dict
        The processor and the versions that decide the figures.
    materials : list of str
    rows : list of dict
        One for each model, with the keys of `COLUMNS`.
    growth : list of dict
        Milliseconds of a frame as image, depth and materials grow, with the keys of `GROWTH_COLUMNS`.
    files : dict of str to str
        The files written, by suffix.
    """

    machine: dict[str, Any]
    materials: list[str]
    rows: list[dict]
    growth: list[dict]
    files: dict[str, str]


def bench(
    paths: Sequence[str | Path],
    folder: str | Path,
    *,
    resolution: int = 256,
    spp: int = 64,
    rounds: int = 5,
    n_samples: int = 100_000,
    seed: int = 0,
    model: Material | None = None,
    material: str | None = None,
    executor: Executor | None = None,
    progress: Callback = silent,
) -> BenchReport:
    """Measure error against run time of every model on measured materials.

    Parameters
    ----------
    paths : sequence of str or Path
        Measured files of any kind. Errors are means over all of them; run times are those of the first.
    folder : str or Path
        Folder for ``bench.csv``, ``.json``, ``.md``, ``pareto.png``, ``index.html``, the pictures of each material and
        all fits; with the same settings an interrupted run goes on where it was.
    resolution, spp : int
        Of all renders.
    rounds : int
        Interleaved runs; their medians count.
    n_samples : int
        Pairs of directions that every model is fitted to; errors are measured on others.
    seed : int
    model : Material, optional
        The enhanced model in the place of the shipped default, exact and specialized.
    material : str, optional
        Which one, in files that hold several.
    executor : concurrent.futures.Executor, optional
        Who fits the models, each file on its own; its processes must see the files and `folder` under the same names.
        Run times are always those of this machine.
    progress : callable
        Hears of every step before it begins, see :mod:`mi_enhance.system.progress`.

    Returns
    -------
    BenchReport

    Raises
    ------
    ValueError
        If no file is given, one cannot be read, two materials have one name, `model` has no networks, or `folder` holds
        a run with other settings.

    Examples
    --------
    >>> bench(["mi_enhance/bundled/rgl/satin_rosaline_rgb.bsdf"], "out/bench").rows  # doctest: +SKIP
    """
    names = [material or material_name(path) for path in paths]
    if not names or len(set(names)) < len(names):
        raise ValueError(f"bench(): materials {names} must be at least one and all different. Rename a file.")
    truths = [rendered_truth(path, "bench()") for path in paths]
    if not all(truths):  # a row is one model on all files
        truths = [None] * len(truths)
    folder = Path(folder)
    if model and not model.brdf.networks:
        raise ValueError(f"bench(): {model.brdf} has no networks. Give an enhanced model; GGX is always compared.")
    settings = settings_of_fits(model, n_samples, seed)
    if material:
        settings["material"] = material
    keep_settings(folder / "settings.json", settings, "bench()")
    about = {**timing.machine("scikit-image"), "variant": mi.variant(), "peak_gflops": round(timing.peak_gflops())}
    size = {"resolution": resolution, "spp": spp}
    if executor:  # what follows finds the fits where they leave them
        start = folder / "model.bsdf"
        if model:
            model.save(start)
        run = functools.partial(
            _fit_elsewhere,
            model=str(start.absolute()) if model else None,
            variant=mi.variant() or "",
            given=(n_samples, seed, material),
        )
        jobs = [(str(Path(p).absolute()), str((folder / n).absolute())) for n, p in zip(names, paths, strict=True)]
        run_all(run, jobs, executor, lambda done: progress(Progress("fits", len(done), len(jobs))))
    samples = [_samples(path, n_samples, seed, material) for path in paths]
    fitted: list[dict[str, Contender]] = [
        contenders(truth, measured, folder / name, model=model, seed=seed, progress=progress)
        for name, (measured, _), truth in zip(names, samples, truths, strict=True)
    ]
    lobes, measured = [models[REFERENCE] for models in fitted], [m for m, _ in samples]
    for models, hybrid in zip(
        fitted, hybrids_of_files(lobes, measured, folder, seed=seed, progress=progress), strict=True
    ):
        models[HYBRID_OF_FILES] = hybrid
    errors: list[dict[str, dict]] = []
    for name, (_, unseen), models in zip(names, samples, fitted, strict=True):
        bsdfs = functools.partial(lambda models: {label: c.bsdf() for label, c in models.items()}, models)
        errors.append(rendered_errors(list(models), bsdfs, unseen, folder / name, **size, seed=seed, progress=progress))
    rows = [_row(label, [f[label] for f in fitted], [e[label] for e in errors]) for label in fitted[0]]
    by_label = {row["label"]: row for row in rows}
    with Workers(fitted[0]) as workers:
        progress(Progress("run time: one kernel", 0, 6))
        _add_kernels(by_label, workers, fitted[0], rounds)
        for k, (kind, make, given) in enumerate(_scenes(fitted)):
            progress(Progress(f"run time: {kind}", 1 + k, 6))
            _add_rates(by_label, workers, kind, make, given, size, rounds)
        progress(Progress("run time: growth", 4, 6))
        growing = growth(fitted, workers, resolution, rounds)
    progress(Progress("first frames", 5, 6))
    for label, c in fitted[0].items():
        by_label[label] |= first_frames((frame, scenes.shader_ball, c), resolution=128, spp=1)
    return _write(folder, about, names, rows, growing)


def _fit_elsewhere(job: tuple[str, str], *, model: str | None, variant: str, given: tuple) -> None:
    """Fit all models to one file and leave them in its folder, in any process."""
    path, folder = job
    with alone(variant):
        loaded = Material.load(model) if model else None
        truth, (measured, _) = rendered_truth(path, "bench()"), _samples(path, *given)
        contenders(truth, measured, Path(folder), model=loaded, seed=given[1])


def _samples(path: str | Path, n: int, seed: int, material: str | None) -> tuple[Measurements, Measurements]:
    """Return samples to fit to, and others to measure errors on; of a table a fifth of its rows is kept aside."""
    if is_scattered(path):
        measured = load(path, n_samples=n, seed=seed, material=material)
        return split(measured, min(_UNSEEN, len(measured.f) // 5), seed)
    pair = [load(path, n_samples=m, seed=seed + k, material=material) for k, m in enumerate((n, _UNSEEN))]
    return pair[0], pair[1]


def _row(label: str, fitted: list[Contender], errors: list[dict]) -> dict:
    row: dict[str, Any] = {"label": label}
    row |= {key: float(np.mean([e[key] for e in errors])) for key in errors[0] if errors[0][key] is not None}
    return row | {
        "n_bytes": round(np.mean([c.n_bytes for c in fitted])),
        "shared_bytes": fitted[0].shared_bytes,
        "multiply_adds": round(np.mean([c.multiply_adds for c in fitted])),
        "fit_seconds": fitted[0].seconds,
    }


# ---------------------------------------------------------------------- run time


def _add_kernels(rows: Mapping[str, dict], workers: Workers, fitted: Mapping[str, Contender], rounds: int) -> None:
    """Nanoseconds of one ``eval`` in a kernel of 2^20 lanes, and the GFLOP/s of its networks in them."""
    for label, seconds in workers.seconds({label: (kernel, c) for label, c in fitted.items()}, rounds).items():
        row, ns = rows[label], seconds / LANES * 1e9
        row["eval_ns"] = ns
        if row["multiply_adds"]:
            row["gflops"] = 2 * row["multiply_adds"] / ns


def _scenes(fitted: Sequence[Mapping[str, Contender]]) -> Iterator[tuple[str, Callable, Mapping[str, Any]]]:
    """Yield the three scenes: name, function that loads it, and its arguments for every model that it can show."""
    first = fitted[0]
    yield "ball", scenes.shader_ball, first
    yield "many", scenes.spheres, {label: many(fitted, label, MANY) for label in first}
    yield "textured", sphere, {label: textured(c) for label, c in first.items() if c.can_be_textured}


def _add_rates(
    rows: Mapping[str, dict],
    workers: Workers,
    kind: str,
    make: Callable,
    given: Mapping[str, Any],
    size: dict,
    rounds: int,
) -> None:
    jobs = {label: (frame, make, what) for label, what in given.items()}
    seconds = workers.seconds(jobs, rounds, **size)
    # a stratified sampler may round spp up: what was traced is counted
    sampler = mi.load_dict({"type": _SAMPLER.get(kind, "independent"), "sample_count": size["spp"]})
    paths = size["resolution"] ** 2 * sampler.sample_count()
    for label, s in seconds.items():
        rows[label][kind] = paths / s / 1e6
        rows[label][f"{kind}_ratio"] = seconds[REFERENCE] / s


# ---------------------------------------------------------------------- results


def _write(folder: Path, about: dict, names: list[str], rows: list[dict], growing: list[dict]) -> BenchReport:
    reference = next(row["log_l1"] for row in rows if row["label"] == REFERENCE)
    for row in rows:
        row["error_ratio"] = row["log_l1"] / reference
    files = {kind: str(path) for kind, path in write_table(rows, folder / "bench", COLUMNS).items()}
    write_table(growing, folder / "growth", GROWTH_COLUMNS)
    draw_pareto(rows, folder / "pareto.png", title=f"{', '.join(names)}; {about['cpu']}, {about['cores']} cores")
    result = {"machine": about, "materials": names, "rows": rows, "growth": growing}
    with replacing(Path(files["json"])) as temporary:
        write_json(Path(temporary), result)
    files |= {"png": str(folder / "pareto.png"), "html": str(folder / "index.html")}
    report = BenchReport(about, names, rows, growing, files)
    write_page(report, folder / "index.html", COLUMNS, GROWTH_COLUMNS)
    return report
