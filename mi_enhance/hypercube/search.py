"""Hypercube search: which slots of an analytic model to replace, and by what (paper, section 4.2).

All states within a Hamming distance of the current one are trained for some epochs from where it stands; the best
becomes current, until the current one wins. The candidates of a stage are independent: any ``concurrent.futures``
executor runs them, see :mod:`mi_enhance.hypercube.candidate`. Everything is kept in a folder, from which a killed
search goes on.
"""

from __future__ import annotations

import dataclasses
import functools
import json
import time
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np

from ..analytic import models
from ..data.measurements import Measurements
from ..material.material import Material
from ..neural.enhanced_brdf import EnhancedBRDF
from ..output.pareto import pareto
from ..system.files import digest
from ..system.progress import Callback, Progress, silent
from ..system.run_folder import keep_settings
from ..system.variants import require_rgb
from ..system.workers import run_all
from ..training.analytic_start import analytic_start, representative, validate
from ..training.sources import UNSEEN_SEED, Source, build
from ..training.trainer import Trainer
from ..training.training_set import TrainingSet, gather
from . import candidate, inheritance, states
from .picture import draw_search
from .settings import SearchSettings, settings_for
from .setup import Setup, candidate_folder, choices_of
from .stages import candidates_of, current_of, is_over, read_stages, write_stages


@dataclasses.dataclass(frozen=True, eq=False)
class SearchResult:
    """Outcome of a search.

    Parameters
    ----------
    material : Material
        The enhanced model, ready to fit and render, with the training materials as starts of fits.
    stages : list of dict
        Per stage ``stage``, ``current`` and ``best`` (digits), ``change`` in words, ``equation``, ``loss`` (best),
        ``unchanged`` (loss of the current state trained on), ``validation``, ``candidates`` (their results).
    pareto : list of dict
        Candidates of all stages that no other beats in both loss and cost, cheapest first.
    """

    material: Material
    stages: list[dict]
    pareto: list[dict]


def search(
    model: models.Model | str,
    materials: Sequence[Measurements | Source],
    folder: str | Path,
    *,
    validation: Sequence[Measurements | Source] = (),
    executor: Executor | None = None,
    progress: Callback = silent,
    **settings: Any,
) -> SearchResult:
    """Find what to replace in an analytic model, or go on where an earlier search in `folder` stopped.

    Parameters
    ----------
    model : Model or str
        The analytic model: one of :mod:`mi_enhance.analytic.models`, its name, or a ``.toml`` file of one.
    materials : sequence of Measurements, or of dict
        What to train on; dictionaries are sources as in a training configuration, see
        :mod:`mi_enhance.training.sources`.
    folder : str or Path
        Keeps everything: ``search.json`` (settings), one folder per candidate, ``stages.jsonl``, the network of each
        stage (``stage-01.bsdf``) and the last of them (``network.bsdf``), ``search.png``, and in ``cache/`` what was
        decoded or imitated.
    validation : sequence, optional
        Materials that are not trained on; only reported, after each stage.
    executor : concurrent.futures.Executor, optional
        Runs the candidates of a stage; its processes must see `folder`. By default they run here, one by one.
    progress : callable
        Hears of every decoded material, then at least once a candidate of every stage; at the end of a stage with its
        ``loss`` and that of the ``unchanged`` state.
    **settings
        Those that differ from the defaults, see :class:`mi_enhance.hypercube.settings.SearchSettings`.

    Returns
    -------
    SearchResult

    Raises
    ------
    ValueError, KeyError
        For unknown or impossible settings, or those that differ from the search to be continued.
    RuntimeError
        If all candidates of a stage diverged, or no RGB variant with gradients is active.

    References
    ----------
    Section 4.2. Candidates inherit weights and parameters, are trained with the same samples, budget and seed, the
    unchanged state too, and are judged on samples kept aside.

    Examples
    --------
    >>> found = search("ggx", [m1, m2, m3], "out/search", epochs=1)  # doctest: +SKIP
    >>> print(found.material.brdf)  # doctest: +SKIP
    M + S * D * F * [G] * [1/E]
    """
    require_rgb("search()")
    folder = Path(folder).resolve()
    materials, validation = list(materials), list(validation)
    prepare(folder, settings_for(model, settings), materials, validation, progress)
    setup, stages = Setup.of(folder), read_stages(folder)
    while not is_over(stages):
        stage = _stage(setup, folder, stages, executor, progress)
        stages.append(stage)
        write_stages(folder, stages)
        _network(setup, folder, stages).save(folder / f"stage-{len(stages):02d}.bsdf")
        n, figures = len(stage["candidates"]), ("loss", "unchanged", "cost", "validation")
        progress(Progress(f"stage {len(stages)}", n, n, {k: stage[k] for k in figures if k in stage}))
    rows = [row for s in stages for row in s["candidates"]]
    found = SearchResult(_network(setup, folder, stages), stages, pareto(rows))
    found.material.save(folder / "network.bsdf")
    draw_search(stages, found.pareto, setup.choices, folder / "search.png", cost=setup.settings.cost)
    return found


def _digest(materials: Iterable) -> str:
    """A few letters that change with the materials: a search is not continued with others."""
    parts: list = []
    for m in materials:
        parts += [m.name.encode(), m.wi, m.wo, m.f] if isinstance(m, Measurements) else [json.dumps(m).encode()]
    return digest(*parts)


def prepare(
    folder: Path, settings: SearchSettings, materials: list, validation: list, progress: Callback = silent
) -> None:
    """Write what all candidates read: settings, samples, the start state with the analytic fit of every material."""
    begun = (folder / "samples.npz").exists()
    start = (0,) * len(choices_of(settings))
    if not (begun or materials):
        raise ValueError("search(): no materials to train on. Give measurements or sources.")
    kept = {**settings.to_json(), "materials": _digest([*materials, "validation", *validation])}
    keep_settings(folder / "search.json", kept, "search()", begun=begun)
    if not begun:
        (folder / "validation.npz").unlink(missing_ok=True)  # of a run that ended before it had samples
        for name, given, seed in (("validation", validation, UNSEEN_SEED), ("samples", materials, 0)):
            if given:
                made = _training_set(given, settings, settings.seed + seed, folder / "cache", progress)
                made.save(folder / f"{name}.npz")
    checkpoint = candidate_folder(folder, 0, start) / "checkpoint.npz"
    if not checkpoint.exists():
        checkpoint.parent.mkdir(parents=True, exist_ok=True)
        setup = Setup.of(folder)
        brdf = inheritance.started(setup, folder, states.brdf_of(setup.model, start, setup.choices, **setup.build), {})
        samples, _ = setup.samples
        Trainer(brdf, samples, setup.training(0), analytic_start(brdf, samples)).save(checkpoint)


def _training_set(given: list, settings: SearchSettings, seed: int, cache: Path, progress: Callback) -> TrainingSet:
    n = settings.n_samples + settings.n_aside
    if all(isinstance(m, Measurements) for m in given):
        return gather(given, n, seed)
    if all(isinstance(m, Mapping) for m in given):
        return build(given, n_samples=n, seed=seed, cache=cache, progress=progress)
    raise ValueError("search(): materials must all be Measurements, or all be sources (dictionaries).")


def _stage(setup: Setup, folder: Path, stages: list[dict], executor: Executor | None, progress: Callback) -> dict:
    """Train and judge all candidates around the current state."""
    number = len(stages) + 1
    current, around = current_of(setup, stages), candidates_of(setup, stages)
    begun = time.perf_counter()
    threads = 0 if executor is None else 1
    run = functools.partial(
        candidate.train_candidate, str(folder), number, parent=current, variant=mi.variant() or "", threads=threads
    )
    results = run_all(run, around, executor, lambda done: progress(Progress(f"stage {number}", len(done), len(around))))
    price = setup.settings.price
    rows = [{**r, "score": r["loss"] * (1 + price * r["cost"])} for r in (results[digits] for digits in around)]
    unchanged = rows[0]
    best = min(rows, key=lambda row: row["score"])
    if not np.isfinite(best["score"]):
        raise RuntimeError(f"search(): all candidates of stage {number} diverged. Lower lr or lr_parameters.")
    if best["score"] >= unchanged["score"] * (1 - setup.settings.tolerance):
        best = unchanged
    stage = {
        "stage": number,
        "current": list(current),
        "best": best["digits"],
        "change": best["change"],
        "equation": best["equation"],
        "loss": best["loss"],
        "unchanged": unchanged["loss"],
        "cost": best["cost"],
        "candidates": rows,
    }
    path = folder / "validation.npz"
    if path.exists():
        brdf, _ = _state_of(setup, folder, number, tuple(best["digits"]))
        unseen = TrainingSet.read(path)
        terms = "-".join(brdf.model.terms.values()) or "original"
        start = analytic_start(brdf, unseen, folder / f"validation-{terms}.npz")
        stage["validation"] = float(validate(brdf, unseen, start).mean())
    stage["seconds"] = round(time.perf_counter() - begun, 1)
    return stage


def _state_of(setup: Setup, folder: Path, stage: int, digits: states.State) -> tuple[EnhancedBRDF, np.ndarray]:
    """Return the trained BRDF of a candidate, and the parameters of all materials."""
    template = states.brdf_of(setup.model, digits, setup.choices, **setup.build)
    return inheritance.restore(template, candidate_folder(folder, stage, digits) / "checkpoint.npz")


def _network(setup: Setup, folder: Path, stages: list[dict]) -> Material:
    """Return the last state as a network: weights, starts of fits, the log of the search."""
    last = stages[-1]
    brdf, values = _state_of(setup, folder, last["stage"], tuple(last["best"]))
    samples, _ = setup.samples
    keep = representative(samples.kinds)
    log = [{k: v for k, v in s.items() if k != "candidates"} for s in stages]
    report = {
        "search": setup.kept,
        "stages": log,
        "steps": setup.steps * len(stages),
        "library": [samples.names[k] for k in keep],
    }
    return Material(brdf, {}, report, library=values[keep])
