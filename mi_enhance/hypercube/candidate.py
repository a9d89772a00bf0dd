"""One candidate of a search: a state trained for some epochs from where its parent stands, and judged (section 4.2).

Everything a candidate needs lies in the folder of the search, everything it finds is written there, so it can run in
any process on any machine that sees the folder, be killed, and go on elsewhere with the same result.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from ..system.files import read_json, write_text
from ..system.workers import alone
from ..training.trainer import Trainer
from . import states
from .inheritance import inherit
from .judging import cost, judge
from .setup import Setup, candidate_folder

_SAVES = 4  # checkpoints of one candidate


def train_candidate(
    folder: str, stage: int, digits: states.State, parent: states.State, variant: str, threads: int
) -> dict:
    """Train one state of a stage and judge it, or go on where that stopped.

    Parameters
    ----------
    folder : str
        Of the search, as :mod:`mi_enhance.hypercube.search` prepares it.
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
    with alone(variant, threads):
        return _train(Path(folder), stage, digits, parent)


def _train(folder: Path, stage: int, digits: states.State, parent: states.State) -> dict:
    own = candidate_folder(folder, stage, digits)
    file, checkpoint = own / "result.json", own / "checkpoint.npz"
    if file.exists():
        return read_json(file, "search()", ("digits", "loss", "cost"))
    own.mkdir(parents=True, exist_ok=True)
    setup = Setup.of(folder)
    samples, aside = setup.samples
    brdf, start = inherit(setup, folder, stage, digits, parent)
    trainer = Trainer(brdf, samples, setup.training(stage), start)

    def report(losses: list[float]) -> None:
        every = max(1, setup.steps // _SAVES)
        _write(own / "progress.json", {"step": trainer.step, "loss": float(np.mean(losses[-every:]))})

    begun = time.perf_counter()
    losses = run(trainer, checkpoint, report)
    seconds = time.perf_counter() - begun
    result = {
        "digits": list(digits),
        "stage": stage,
        "change": states.describe_change(parent, digits, setup.choices),
        "equation": str(brdf),
        "loss": judge(trainer.result(), trainer.parameters(), aside),
        "training": float(np.mean(losses[-max(1, setup.steps // 10) :])) if losses else None,
        "cost": cost(trainer.result(), trainer.parameters(), setup.settings.cost),
        "seconds": round(seconds, 2),
    }
    _write(file, result)
    return result


def run(trainer: Trainer, checkpoint: Path, report: Callable[[list[float]], None]) -> list[float]:
    """Train to the last step, or go on from `checkpoint`; ``report(losses)`` whenever that has been written."""
    if checkpoint.exists():
        trainer.resume(checkpoint)
    steps, losses = trainer.settings.steps, []
    while trainer.step < steps:
        losses.append(trainer.advance().mean())
        if trainer.step % max(1, steps // _SAVES) == 0 or trainer.step == steps:
            trainer.save(checkpoint)
            report(losses)
    return losses


def _write(path: Path, content: dict) -> None:
    write_text(path, json.dumps(content) + "\n")
