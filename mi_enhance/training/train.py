"""Training: the weights of all networks and the parameters of all materials together (paper, section 4.3).

One step sees the same few samples of every material. A fused kernel evaluates and differentiates, see
:class:`mi_enhance.neural.trainable.Trainable`; what belongs to a material is summed over its samples afterwards.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from ..analytic import models
from ..neural.enhance import enhance
from ..system.files import read_json, replacing
from .analytic_start import analytic_start, validate
from .curve_picture import draw_curve
from .imitation import imitate
from .settings import DEFAULTS
from .sources import build
from .trainer import Trainer

_EVERY = (1000, 4)  # steps to a checkpoint, and checkpoints to a validation, which takes as long as 200 steps


def train(
    config: dict,
    folder: Path,
    *,
    progress: bool = True,
    callback: Callable | None = None,
    every: tuple[int, int] = _EVERY,
) -> Trainer:
    """Train a network, or go on where an earlier run in `folder` stopped.

    Parameters
    ----------
    config : dict
        Entries of :data:`DEFAULTS` that differ from it.
    folder : Path
        Keeps ``config.json``, ``checkpoint.npz``, ``network.bsdf`` (ready to fit with), ``curve.jsonl`` (per line the
        step, the mean loss since the last line, also by kind of source and of ``validation`` materials, seconds) and
        its picture, ``curve.png``.
    progress : bool
        Show a bar with the loss.
    callback : callable, optional
        ``callback(trainer)`` after every checkpoint.
    every : (int, int)
        Steps from checkpoint to checkpoint, and checkpoints from validation to validation.

    Returns
    -------
    Trainer
        Holds the networks and the parameters of all training materials.

    Raises
    ------
    ValueError
        For an unknown entry of the configuration, or one that differs from the run to be continued.
    """
    unknown = set(config) - set(DEFAULTS)
    if unknown:
        raise ValueError(f"train(): unknown entries {sorted(unknown)}. Choose from: {', '.join(DEFAULTS)}.")
    config = {**DEFAULTS, **config}
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    file, checkpoint = folder / "config.json", folder / "checkpoint.npz"
    if checkpoint.exists() and read_json(file, "train()") != config:
        raise ValueError(f'train(): "{file}" is of a run with other settings. Choose another folder, or remove it.')
    with replacing(file) as temporary:
        Path(temporary).write_text(json.dumps(config, indent=2) + "\n")
    bar = _bar if progress else (lambda items, **_: items)
    read = lambda sources: build(  # noqa: E731
        sources,
        n_samples=config["n_samples"],
        seed=config["seed"],
        cache=folder.parent / "cache",
        progress=lambda jobs: bar(jobs, desc="decode"),
    )
    samples = read(config["data"])
    brdf = enhance(
        models.from_toml(config["model"]) if config["model"].endswith(".toml") else config["model"],
        config["replace"],
        n_latent=config["n_latent"],
        hidden=config["hidden"],
        inputs=config["inputs"],
        modulated=config["modulated"],
        seed=config["seed"],
    )
    if checkpoint.exists():
        trainer = Trainer(brdf, samples, config, np.ones((len(samples.names), brdf.n_parameters)))
        trainer.resume(checkpoint)
    else:
        brdf = imitate(brdf, steps=config["imitation_steps"], seed=config["seed"])
        trainer = Trainer(brdf, samples, config, analytic_start(brdf, samples))
    unseen = read(config["validation"]) if config["validation"] and trainer.step < config["steps"] else None
    unseen_start = analytic_start(brdf, unseen) if unseen else None
    refits = {config["steps"] * k // (config["refits"] + 1) for k in range(1, config["refits"] + 1)}
    start, first, losses = time.perf_counter(), trainer.step, []
    for _ in (steps := bar(range(trainer.step, config["steps"]), desc="train")):
        losses.append(trainer.advance())
        if trainer.step in refits:
            trainer.refit()
        last = trainer.step == config["steps"]
        if trainer.step % every[0] == 0 or last:
            mean, seconds = float(np.mean(losses)), time.perf_counter() - start
            record = {"step": trainer.step, "loss": mean, **_by_kind(samples.kinds, np.mean(losses, 0))}
            if unseen and (last or trainer.step % (every[0] * every[1]) == 0):
                losses_unseen = _by_kind(unseen.kinds, validate(trainer.result(), unseen, unseen_start))
                record |= {f"validation {kind}": loss for kind, loss in losses_unseen.items()}
            curve = [*_curve(folder), {**record, "seconds": round(seconds, 1)}]
            # all lines at once: a killed run never leaves half a line
            with replacing(folder / "curve.jsonl") as temporary:
                Path(temporary).write_text("".join(json.dumps(line) + "\n" for line in curve))
            if progress:
                steps.set_postfix(loss=f"{mean:.5f}", samples=f"{_rate(trainer, first, seconds):.2f} M/s")
            trainer.save(checkpoint)
            _ship(trainer, folder)
            if _has_validation(record):
                draw_curve(_curve(folder), folder / "curve.png")
            losses = []
            if callback:
                callback(trainer)
    _ship(trainer, folder)
    return trainer


def _ship(trainer: Trainer, folder: Path) -> None:
    """Write ``network.bsdf``, with the last line of the curve and those that hold validation errors."""
    curve = _curve(folder)
    trainer.material([r for r in curve if r is curve[-1] or _has_validation(r)]).save(folder / "network.bsdf")


def _has_validation(record: dict) -> bool:
    return any(key.startswith("validation") for key in record)


def _curve(folder: Path) -> list[dict]:
    file = folder / "curve.jsonl"
    return read_json(file, "train()", ("step", "loss", "seconds"), lines=True) if file.exists() else []


def _by_kind(kinds: list[str], losses: np.ndarray) -> dict[str, float]:
    """Mean loss of each kind of material: noisy ones hide what happens to the others."""
    return {kind: float(losses[np.array(kinds) == kind].mean()) for kind in sorted(set(kinds))}


def _rate(trainer: Trainer, first: int, seconds: float) -> float:
    return (trainer.step - first) * trainer.n_materials * trainer.config["batch"] / seconds / 1e6


def _bar(items, desc: str):
    from tqdm import tqdm

    return tqdm(items, desc=desc, mininterval=2)
