"""Error against run time: a table, a Pareto plot and a page of every model of some measured materials.

Errors are those of unseen samples and of a render beside the measured file; times are medians of interleaved runs, as
ratios to plain GGX of this package: a plugin in Python like ours, without networks.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import mitsuba as mi
import numpy as np

from .. import data
from ..evaluation import scenes
from ..evaluation.compare import compare
from ..evaluation.reflectance import reflectance
from ..fitting.losses import log_l1
from ..output.table import write_table
from ..system.files import material_name, replacing, require_file
from . import timing
from .contenders import REFERENCE, Contender, contenders, textured
from .growth import GROWTH_COLUMNS, _growth
from .jobs import LANES, MANY, frame, kernel, many, sphere
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


def bench(
    paths: Sequence[str | Path],
    folder: str | Path,
    *,
    resolution: int = 256,
    spp: int = 64,
    rounds: int = 5,
    samples: int = 100_000,
    seed: int = 0,
    log: Callable = lambda _: None,
) -> dict:
    """Measure error against run time of every model on measured materials.

    Parameters
    ----------
    paths : sequence of str or Path
        RGL ``.bsdf`` files. Errors are means over all of them; run times are those of the first.
    folder : str or Path
        Folder for ``bench.csv``, ``.json``, ``.md``, ``pareto.png``, ``index.html``, the pictures of each material and
        all fits; with the same settings an interrupted run goes on where it was.
    resolution, spp : int
        Of all renders.
    rounds : int
        Interleaved runs, of which medians count.
    samples : int
        Pairs of directions that every model is fitted to; errors are measured on others.
    seed : int
    log : callable, optional
        Called with one line of text before each step.

    Returns
    -------
    dict
        ``machine``, ``rows`` (one for each model, keys of `COLUMNS`), ``growth`` (how seconds grow), ``files``.

    Raises
    ------
    ValueError
        If no file is given, two materials have one name, or `folder` holds a run with other settings.

    Examples
    --------
    >>> bench(["mi_enhance/bundled/rgl/satin_rosaline_rgb.bsdf"], "out/bench")["rows"]  # doctest: +SKIP
    """
    names = [material_name(path) for path in paths]
    if not names or len(set(names)) < len(names):
        raise ValueError(f"bench(): materials {names} must be at least one and all different. Rename a file.")
    paths = [require_file(path, f'bench("{path}")') for path in paths]
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    _same_settings(folder / "settings.json", {"samples": samples, "seed": seed})
    about = {**timing.machine("scikit-image"), "variant": mi.variant(), "peak_gflops": round(timing.peak_gflops())}
    fitted, errors = [], []
    for name, path in zip(names, paths, strict=True):
        measured = data.load(path, n_samples=samples, seed=seed, kind="rgl")
        fitted.append(contenders(path, measured, folder / name, seed=seed, log=log))
        unseen = data.load(path, n_samples=_UNSEEN, seed=seed + 1, kind="rgl")
        errors.append(_errors(fitted[-1], unseen, folder / name, resolution, spp, seed, log))
    rows = [_row(label, [f[label] for f in fitted], [e[label] for e in errors]) for label in fitted[0]]
    by_label = {row["label"]: row for row in rows}
    size = {"resolution": resolution, "spp": spp}
    with Workers(fitted[0]) as workers:
        log("run time: one kernel")
        _add_kernels(by_label, workers, fitted[0], rounds)
        for kind, load, given in _scenes(fitted):
            log(f"run time: {kind}")
            _add_rates(by_label, workers, kind, load, given, size, rounds)
        log("run time: what grows")
        growth = _growth(fitted, workers, resolution, rounds)
    log("first frames")
    for label, c in fitted[0].items():
        by_label[label] |= first_frames((frame, scenes.shader_ball, c), resolution=128, spp=1)
    return _write(folder, about, names, rows, growth)


def _same_settings(file: Path, settings: dict) -> None:
    if file.exists() and json.loads(file.read_text()) != settings:
        raise ValueError(f'bench(): "{file}" is of a run with other settings. Choose another folder, or remove it.')
    with replacing(file) as temporary:
        Path(temporary).write_text(json.dumps(settings) + "\n")


# ---------------------------------------------------------------------- errors


def _errors(fitted: Mapping[str, Contender], unseen, folder: Path, resolution, spp, seed, log) -> dict[str, dict]:
    """Errors of every model on unseen samples and in a render, by label; from `folder` if an earlier run has them."""
    file = folder / f"errors_{resolution}_{spp}.json"
    if not file.exists():
        bsdfs = {label: c.bsdf() for label, c in fitted.items()}
        truth = bsdfs.pop("measured")
        rows = compare(
            truth, bsdfs, folder=folder, resolution=resolution, spp=spp, seed=seed, title=unseen.name, log=log
        )
        keys = ("ssim", "delta_E_ITP_1000", "mean_abs_log")
        result = {row["label"]: {k: row[k] for k in keys} for row in rows}
        for label, bsdf in {**bsdfs, "measured": truth}.items():
            f = np.maximum(reflectance(bsdf, unseen.wi, unseen.wo), 0)  # files hold negative values
            result[label]["log_l1"] = log_l1(f, unseen.f, unseen.wo[:, 2])
        with replacing(file) as temporary:
            Path(temporary).write_text(json.dumps(result, indent=1))
    return json.loads(file.read_text())


def _row(label: str, fitted: list[Contender], errors: list[dict]) -> dict:
    row = {"label": label}
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


def _scenes(fitted: Sequence[Mapping[str, Contender]]):
    """The three scenes: name, function that loads it, and what it takes, for every model it can be rendered with."""
    first = fitted[0]
    yield "ball", scenes.shader_ball, first
    yield "many", scenes.spheres, {label: many(fitted, label, MANY) for label in first}
    yield "textured", sphere, {label: textured(c) for label, c in first.items() if c.can_be_textured}


def _add_rates(rows, workers: Workers, kind: str, load: Callable, given: Mapping, size: dict, rounds: int) -> None:
    jobs = {label: (frame, load, what) for label, what in given.items()}
    seconds = workers.seconds(jobs, rounds, **size)
    # a stratified sampler may round spp up: what was traced is counted
    sampler = mi.load_dict({"type": _SAMPLER.get(kind, "independent"), "sample_count": size["spp"]})
    paths = size["resolution"] ** 2 * sampler.sample_count()
    for label, s in seconds.items():
        rows[label][kind] = paths / s / 1e6
        rows[label][f"{kind}_ratio"] = seconds[REFERENCE] / s


# ---------------------------------------------------------------------- results


def _write(folder: Path, about: dict, names: list[str], rows: list[dict], growth: list[dict]) -> dict:
    from .page import draw_pareto, write_page

    reference = next(row["log_l1"] for row in rows if row["label"] == REFERENCE)
    for row in rows:
        row["error_ratio"] = row["log_l1"] / reference
    files = {kind: str(path) for kind, path in write_table(rows, folder / "bench", COLUMNS).items()}
    write_table(growth, folder / "growth", GROWTH_COLUMNS)
    draw_pareto(rows, folder / "pareto.png", title=f"{', '.join(names)}; {about['cpu']}, {about['cores']} cores")
    result = {"machine": about, "materials": names, "rows": rows, "growth": growth}
    with replacing(Path(files["json"])) as temporary:
        Path(temporary).write_text(json.dumps(result, indent=1) + "\n")
    write_page(result, folder / "index.html", COLUMNS, GROWTH_COLUMNS)
    return {**result, "files": {**files, "png": str(folder / "pareto.png"), "html": str(folder / "index.html")}}
