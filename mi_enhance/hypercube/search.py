"""Hypercube search: which slots of an analytic model to replace, and by what (paper, section 4.2).

All states within a Hamming distance of the current one are trained for some epochs from where it stands; the best
becomes current, until the current one wins. The candidates of a stage are independent: any ``concurrent.futures``
executor runs them, see :mod:`mi_enhance.hypercube.candidate`. Everything is kept in a folder, from which a killed search goes on.
"""

from __future__ import annotations

import dataclasses
import json
import time
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, wait
from pathlib import Path

import mitsuba as mi
import numpy as np

from ..analytic import models
from ..data.measurements import Measurements
from ..material.material import Material
from ..neural.enhanced_brdf import EnhancedBRDF
from ..output.pareto import pareto
from ..system.files import digest, read_json, replacing
from ..training.analytic_start import analytic_start, representative, validate
from ..training.sources import build
from ..training.trainer import Trainer
from ..training.training_set import TrainingSet, gather
from . import candidate, inheritance, states
from .settings import _checked
from .setup import Setup, candidate_folder, choices_of


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
    materials: Sequence[Measurements | dict],
    folder: str | Path,
    *,
    validation: Sequence[Measurements | dict] = (),
    executor: Executor | None = None,
    progress: bool = True,
    callback: Callable | None = None,
    **settings,
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
        stage (``stage-01.bsdf``) and the last of them (``network.bsdf``), ``search.png``.
    validation : sequence, optional
        Materials that are not trained on; only reported, after each stage.
    executor : concurrent.futures.Executor, optional
        Runs the candidates of a stage; its processes must see `folder`. By default they run here, one by one.
    progress : bool
        Show a live table.
    callback : callable, optional
        ``callback(stage)`` with each finished stage, a dictionary as in :class:`SearchResult`.
    **settings
        Entries of :data:`DEFAULTS` that differ from it.

    Returns
    -------
    SearchResult

    Raises
    ------
    ValueError, KeyError
        For unknown or impossible settings, or those that differ from the search to be continued.
    RuntimeError
        If all candidates of a stage diverged.

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
    folder = Path(folder).resolve()
    materials, validation = list(materials), list(validation)
    settings = {**_checked(model, settings), "materials": _digest([*materials, "validation", *validation])}
    prepare(folder, settings, materials, validation)
    setup = Setup.of(folder)
    log = folder / "stages.jsonl"
    stages = read_json(log, "search()", ("stage", "current", "best", "candidates"), lines=True) if log.exists() else []
    view = _view(folder, setup, progress)
    with view:
        while not stages or stages[-1]["best"] != stages[-1]["current"]:
            stage = _stage(setup, folder, stages, executor, view)
            stages.append(stage)
            # one line at once: a killed search never leaves half a line
            with replacing(log) as temporary:
                Path(temporary).write_text("".join(json.dumps(s) + "\n" for s in stages))
            _network(setup, folder, stages).save(folder / f"stage-{len(stages):02d}.bsdf")
            view.finished(stages)
            if callback:
                callback(stage)
    found = SearchResult(_network(setup, folder, stages), stages, pareto(stages))
    found.material.save(folder / "network.bsdf")
    from .picture import draw_search

    draw_search(found, setup.choices, folder / "search.png")
    return found


def _digest(materials: list) -> str:
    """A few letters that change with the materials: a search is not continued with others."""
    parts = []
    for m in materials:
        parts += [m.name.encode(), m.wi, m.wo, m.f] if isinstance(m, Measurements) else [json.dumps(m).encode()]
    return digest(*parts)


def prepare(folder: Path, settings: dict, materials: list, validation: list) -> None:
    """Write what all candidates read: settings, samples, the start state with the analytic fit of every material."""
    file = folder / "search.json"
    text = json.dumps(settings, indent=2) + "\n"
    start = (0,) * len(choices_of(settings))
    if file.exists() and file.read_text() != text:
        raise ValueError(
            f'search(): "{file}" is of a search with other settings or materials. Choose another folder, or remove it.'
        )
    folder.mkdir(parents=True, exist_ok=True)
    n = settings["n_samples"] + settings["n_aside"]
    for name, given in (("samples", materials), ("validation", validation)):
        path = folder / f"{name}.npz"
        if given and not path.exists():
            _training_set(given, n, settings["seed"], folder).save(path)
    if not (folder / "samples.npz").exists():
        raise ValueError("search(): no materials to train on. Give measurements or sources.")
    if not file.exists():
        with replacing(file) as temporary:
            Path(temporary).write_text(text)
    checkpoint = candidate_folder(folder, 0, start) / "checkpoint.npz"
    if not checkpoint.exists():
        checkpoint.parent.mkdir(parents=True, exist_ok=True)
        setup = Setup.of(folder)
        brdf = inheritance.started(setup, folder, states.brdf_of(setup.model, start, setup.choices, **setup.build), {})
        samples, _ = setup.samples
        Trainer(brdf, samples, {**settings, "steps": 0}, analytic_start(brdf, samples)).save(checkpoint)


def _training_set(given: list, n: int, seed: int, folder: Path) -> TrainingSet:
    if all(isinstance(m, Measurements) for m in given):
        return gather(given, n, seed)
    if all(isinstance(m, dict) for m in given):
        return build(given, n_samples=n, seed=seed, cache=folder.parent / "cache")
    raise ValueError("search(): materials must all be Measurements, or all be sources (dictionaries).")


def _stage(setup: Setup, folder: Path, stages: list[dict], executor: Executor | None, view) -> dict:
    """Train and judge all candidates around the current state."""
    number = len(stages) + 1
    current = tuple(stages[-1]["best"]) if stages else (0,) * len(setup.choices)
    left = {tuple(s["current"]) for s in stages} - {current}  # a state that has lost does not come back
    around = states.neighbours(
        current, setup.choices, distance=setup.settings["distance"], max_modules=setup.settings["max_modules"]
    )
    around = [digits for digits in around if digits not in left]
    begun = time.perf_counter()
    view.started(number, current, around)
    results = {}
    threads = 0 if executor is None else 1
    jobs = [(str(folder), number, digits, current, mi.variant(), threads) for digits in around]
    if executor is None:
        for job in jobs:
            results[job[2]] = candidate.train_candidate(*job)
            view.update()
    else:
        futures = {executor.submit(candidate.train_candidate, *job): job[2] for job in jobs}
        pending = set(futures)
        while pending:
            done, pending = wait(pending, timeout=1, return_when=FIRST_COMPLETED)
            results |= {futures[future]: future.result() for future in done}
            view.update()
    price = setup.settings["price"]
    rows = [{**r, "score": r["loss"] * (1 + price * r["cost"])} for r in (results[digits] for digits in around)]
    unchanged = rows[0]
    best = min(rows, key=lambda row: row["score"])
    if not np.isfinite(best["score"]):
        raise RuntimeError(f"search(): all candidates of stage {number} diverged. Lower lr or lr_parameters.")
    if best["score"] >= unchanged["score"] * (1 - setup.settings["tolerance"]):
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
    """The trained BRDF of a candidate, and the parameters of all materials."""
    template = states.brdf_of(setup.model, digits, setup.choices, **setup.build)
    return inheritance.restore(template, candidate_folder(folder, stage, digits) / "checkpoint.npz")


def _network(setup: Setup, folder: Path, stages: list[dict]) -> Material:
    """The last state as a network file: weights, starts of fits, the log of the search."""
    last = stages[-1]
    brdf, values = _state_of(setup, folder, last["stage"], tuple(last["best"]))
    samples, _ = setup.samples
    keep = representative(samples.kinds)
    log = [{k: v for k, v in s.items() if k != "candidates"} for s in stages]
    report = {
        "search": setup.settings,
        "stages": log,
        "steps": setup.steps * len(stages),
        "library": [samples.names[k] for k in keep],
    }
    return Material(brdf, {}, report, library=values[keep])


def _view(folder: Path, setup: Setup, progress: bool):
    from .live_table import LiveTable, Silent

    return LiveTable(folder, setup) if progress else Silent()
