"""One candidate of a search: a state trained for some epochs from where its parent stands, and judged (section 4.2).

Everything a candidate needs lies in the folder of the search, everything it finds is written there, so it can run in
any process on any machine that sees the folder, be killed, and go on elsewhere with the same result.
"""

from __future__ import annotations

import dataclasses
import functools
import gc
import json
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path

import drjit as dr
import mitsuba as mi
import numpy as np

from . import state
from .analytic import alternative_terms, models, parameter_space, parameters
from .fitting.objective import Objective
from .neural.enhance import enhance
from .neural.enhanced_brdf import EnhancedBRDF
from .neural.mlp import MLP, flatten, unflatten
from .system import npz
from .system.files import digest, read_json, replacing
from .training.imitation import imitate
from .training.trainer import Trainer
from .training.training_set import TrainingSet, first_samples

_JUDGED_AT_ONCE = 1 << 19  # lanes: bounds the memory of a judgement
_SAVES = 4  # checkpoints of one candidate
_lock = threading.Lock()  # a worker process may have several threads; Dr.Jit records one step at a time


def train_candidate(folder: str, stage: int, digits: state.State, parent: state.State, variant: str, threads: int):
    """Train one state of a stage and judge it, or go on where that stopped.

    Parameters
    ----------
    folder : str
        Of the search, as :mod:`mi_enhance.search` prepares it.
    stage : int
        From 1; the parent is a candidate of the stage before.
    digits, parent : tuple of int
        The state, and the one it inherits weights and parameters from.
    variant : str
        Mitsuba variant that the worker sets for itself.
    threads : int
        Of Dr.Jit in this process; 0 leaves them as they are.

    Returns
    -------
    dict
        ``digits``, ``stage``, ``change`` to the parent in words, ``equation``, ``loss`` (eq. 1 on the samples kept
        aside, mean over materials; infinite if the training diverged), ``training`` (mean of the last tenth of its
        steps), ``cost``, ``seconds`` of the steps.
    """
    with _lock:
        mi.set_variant(variant)
        if threads:
            dr.set_thread_count(threads)
        result = _train(Path(folder), stage, digits, parent)
        gc.collect()  # the frozen steps of this trainer
        return result


def candidate_folder(folder: Path, stage: int, digits: state.State) -> Path:
    return folder / f"stage-{stage:02d}" / state.name(digits)


def _train(folder: Path, stage: int, digits: state.State, parent: state.State) -> dict:
    own = candidate_folder(folder, stage, digits)
    file, checkpoint = own / "result.json", own / "checkpoint.npz"
    if file.exists():
        return read_json(file, "search()", ("digits", "loss", "cost"))
    own.mkdir(parents=True, exist_ok=True)
    setup = Setup.of(folder)
    samples, aside = setup.samples
    brdf, start = inherit(setup, folder, stage, digits, parent)
    config = {**setup.settings, "steps": setup.steps, "seed": setup.settings["seed"] + stage}
    trainer = Trainer(brdf, samples, config, start)

    def report(losses):
        every = max(1, setup.steps // _SAVES)
        _write(own / "progress.json", {"step": trainer.step, "loss": float(np.mean(losses[-every:]))})

    begun = time.perf_counter()
    losses = run(trainer, checkpoint, report)
    seconds = time.perf_counter() - begun
    result = {
        "digits": list(digits),
        "stage": stage,
        "change": state.change(parent, digits, setup.choices),
        "equation": str(brdf),
        "loss": judge(trainer.result(), trainer.parameters(), aside),
        "training": float(np.mean(losses[-max(1, setup.steps // 10) :])) if losses else None,
        "cost": cost(trainer.result(), trainer.parameters(), setup.settings["cost"]),
        "seconds": round(seconds, 2),
    }
    _write(file, result)
    return result


def run(trainer: Trainer, checkpoint: Path, report: Callable) -> list[float]:
    """Train to the last step, or go on from `checkpoint`; ``report(losses)`` whenever that has been written."""
    if checkpoint.exists():
        trainer.resume(checkpoint)
    steps, losses = trainer.config["steps"], []
    while trainer.step < steps:
        losses.append(trainer.advance().mean())
        if trainer.step % max(1, steps // _SAVES) == 0 or trainer.step == steps:
            trainer.save(checkpoint)
            report(losses)
    return losses


def model_of(settings: dict) -> models.Model:
    """The model that the settings of a search name, or hold as a text."""
    text = settings["model"]
    return models.from_expression(text) if "\n" in text else models.registered(text)


def choices_of(settings: dict) -> dict[str, tuple[state.Choice, ...]]:
    """What may stand in every slot, by the settings of a search."""
    names = ("modules", "alternatives", "fixed", "nodes_only")
    return state.choices(model_of(settings), **{name: settings[name] for name in names})


class Setup:
    """What all candidates of a search share, read once per process: settings, model, choices, samples."""

    def __init__(self, folder: Path):
        self.settings = read_json(folder / "search.json", "search()", ("model", "n_samples", "batch", "epochs"))
        self.model = model_of(self.settings)
        self.choices = choices_of(self.settings)
        self.build = {name: self.settings[name] for name in ("inputs", "modulated", "n_latent", "seed")}
        self.samples = TrainingSet.read(folder / "samples.npz").split(self.settings["n_samples"])
        self.steps = max(1, round(self.settings["epochs"] * self.settings["n_samples"] / self.settings["batch"]))

    @staticmethod
    def of(folder: Path) -> Setup:
        """The setup in a folder, read again only if its files have changed."""
        times = tuple((folder / name).stat().st_mtime_ns for name in ("search.json", "samples.npz"))
        return _setup(folder, times)


@functools.lru_cache(maxsize=1)
def _setup(folder: Path, times: tuple[int, int]) -> Setup:
    return Setup(folder)


def inherit(setup: Setup, folder: Path, stage: int, digits: state.State, parent: state.State):
    """The BRDF of a state and the parameters of all materials, as far as possible those of the parent.

    What is new starts as what it replaces: a network imitates its term or operator, another analytic term takes the
    parameters with which it resembles the usual one.
    """
    template = state.build(setup.model, parent, setup.choices, **setup.build)
    before, values = restore(template, candidate_folder(folder, stage - 1, parent) / "checkpoint.npz")
    brdf = state.build(setup.model, digits, setup.choices, **setup.build)
    return started(setup, folder, brdf, before.networks), _carry(values, before, brdf)


def restore(template: EnhancedBRDF, checkpoint: Path) -> tuple[EnhancedBRDF, np.ndarray]:
    """The BRDF with the weights of a checkpoint, and the parameters of all materials, (M, P)."""
    where = f'search(): "{checkpoint}"'
    stored = npz.read(checkpoint, ["weights", "parameters"], where)
    flat = npz.numbers(stored, "weights", (max(template.n_weights, 1),), where)  # without networks one float stands in
    values = stored["parameters"]
    if values.dtype.kind != "f" or values.size % template.n_parameters or not np.isfinite(values).all():
        raise ValueError(f"{where}: the parameters are not those of {template}. Remove this file's folder.")
    values = values.astype(np.float64)
    values = values.reshape(template.n_parameters, -1).T.copy()
    brdf = dataclasses.replace(template, networks=unflatten(template.networks, flat))
    return brdf, parameter_space.Space(template.parameters).back(values)


def started(setup: Setup, folder: Path, brdf: EnhancedBRDF, kept: Mapping[str, MLP]) -> EnhancedBRDF:
    """`brdf` with the networks of `kept` where they fit, and others that imitate what they replace."""
    networks = {}
    for slot, mlp in brdf.networks.items():
        same = slot in kept and kept[slot].sizes == mlp.sizes
        networks[slot] = kept[slot] if same else _imitation(setup, folder, slot, mlp.sizes[1:-1])
    return dataclasses.replace(brdf, networks=networks)


def _carry(old: np.ndarray, before: EnhancedBRDF, brdf: EnhancedBRDF) -> np.ndarray:
    """Parameters of all materials by name, (M, P); new ones at their initial or resembling value."""
    known = parameters.unflatten(before.parameters, old.T)
    columns = {p.name: np.full((p.size, len(old)), p.initial) for p in brdf.parameters}
    usual = {name: np.asarray(v)[0] for name, v in known.items() if len(np.atleast_2d(v)) == 1}
    for slot, term in brdf.model.terms.items():
        if before.model.terms.get(slot) != term:
            started = alternative_terms.start(brdf.model, slot, term, usual)
            columns |= {name: np.atleast_2d(v) for name, v in started.items()}
    columns |= {name: np.atleast_2d(v) for name, v in known.items() if name in columns}
    return np.concatenate([columns[p.name] for p in brdf.parameters]).T


def _imitation(setup: Setup, folder: Path, slot: str, hidden: tuple[int, ...]) -> MLP:
    """A network that has learned the term or operator in `slot`, kept on disk beside the folders of all searches."""
    steps, seed = setup.settings["imitation_steps"], setup.settings["seed"]
    key = json.dumps([1, str(setup.model), setup.model.name, slot, hidden, steps, setup.build], sort_keys=True)
    file = folder.parent / "cache" / f"imitation-{digest(key.encode())}.npz"
    alone = enhance(setup.model, {slot: hidden}, **setup.build)
    if not file.exists():
        taught = imitate(alone, steps=steps, seed=seed)
        file.parent.mkdir(exist_ok=True)
        with replacing(file) as temporary:
            np.savez(temporary, weights=flatten(taught.networks))
    where = f'search(): "{file}"'
    weights = npz.numbers(npz.read(file, ["weights"], where), "weights", (alone.n_weights,), where)
    return unflatten(alone.networks, weights)[slot]


def judge(brdf: EnhancedBRDF, values: np.ndarray, samples: TrainingSet) -> float:
    """Mean loss (eq. 1) of materials with parameters (M, P) on their samples; infinite where it is not a number."""
    n, space = samples.n_samples, parameter_space.Space(brdf.parameters)
    at_once = max(1, _JUDGED_AT_ONCE // n)
    losses = []
    for first in range(0, len(values), at_once):
        part = slice(first, first + at_once)
        losses.append(Objective(brdf, *first_samples(samples, n, part), n).loss(space.to(values[part])))
    mean = float(np.concatenate(losses).mean())
    return mean if np.isfinite(mean) else float("inf")


def cost(brdf: EnhancedBRDF, values: np.ndarray, how: str) -> float:
    """Cost of one evaluation: thousands of multiply-adds, or (``"measured"``) nanoseconds in a kernel of its own."""
    if how == "multiply-adds":
        return brdf.multiply_adds / 1000
    n = 1 << 18
    rng = np.random.default_rng(0)
    wi, wo = (mi.warp.square_to_uniform_hemisphere(mi.Point2f(rng.random((2, n)).astype(np.float32))) for _ in "io")
    row = [mi.Float(float(v)) for v in values[0]]
    dr.make_opaque(row, wi, wo)
    seconds = []
    for _ in range(7):
        begun = time.perf_counter()
        dr.eval(brdf(wi, wo, parameters.unflatten(brdf.parameters, row)))
        dr.sync_thread()
        seconds.append(time.perf_counter() - begun)
    return float(np.median(seconds[2:])) / n * 1e9


def _write(path: Path, content: dict) -> None:
    with replacing(path) as temporary:
        Path(temporary).write_text(json.dumps(content) + "\n")
