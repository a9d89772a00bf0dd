"""Training: the weights of all networks and the parameters of all materials together (paper, section 4.3).

One step sees the same few samples of every material. A fused kernel evaluates and differentiates, see
:class:`mi_enhance.neural.trainable.Trainable`; what belongs to a material is summed over its samples afterwards.
"""

from __future__ import annotations

import functools
import json
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..analytic import models
from ..neural.enhance import enhance, with_trunk
from ..neural.enhanced_brdf import EnhancedBRDF
from ..system.files import read_json, write_text
from ..system.progress import Callback, Progress, silent
from ..system.run_folder import keep_settings
from .analytic_start import analytic_start, validate
from .curve_picture import draw_curve
from .imitation import imitate
from .settings import TrainingSettings
from .sources import UNSEEN_SEED, build
from .trainer import Trainer
from .trunk_trainer import TrunkTrainer

_EVERY = (1000, 4)  # steps to a checkpoint, and checkpoints to a validation, which takes as long as 200 steps


def train(
    config: TrainingSettings | Mapping[str, Any],
    folder: str | Path,
    *,
    progress: Callback = silent,
    every: tuple[int, int] = _EVERY,
) -> Trainer:
    """Train a network, or go on where an earlier run in `folder` stopped.

    Parameters
    ----------
    config : TrainingSettings or dict
        The settings, or those of them that differ from the defaults.
    folder : str or Path
        Keeps ``config.json``, ``checkpoint.npz``, ``network.bsdf`` (ready to fit with), ``curve.jsonl`` (per line the
        step, the mean loss since the last line, also by kind of source and of ``validation`` materials, seconds), its
        picture, ``curve.png``, and in ``cache/`` the decoded samples.
    progress : callable
        Hears of every decoded material, of every step of the imitation and, after the checkpoint, of every step of the
        training, with ``loss`` and ``million samples per s`` of the last checkpoint.
    every : (int, int)
        Steps from checkpoint to checkpoint, and checkpoints from validation to validation.

    Returns
    -------
    Trainer
        Holds the modules and the parameters of all training materials.

    Raises
    ------
    ValueError
        For an unknown or wrong setting, or one that differs from the run to be continued.

    Examples
    --------
    >>> data = [{"kind": "synthetic", "count": 100}]
    >>> train({"data": data, "steps": 1000}, "out/run").material()  # doctest: +SKIP
    """
    settings = config if isinstance(config, TrainingSettings) else TrainingSettings.of(config)
    folder = Path(folder)
    checkpoint = folder / "checkpoint.npz"
    keep_settings(folder / "config.json", settings.to_json(), "train()", begun=checkpoint.exists())
    read = functools.partial(build, n_samples=settings.n_samples, cache=folder / "cache", progress=progress)
    samples = read(settings.data, seed=settings.seed)
    brdf, kind = _network(settings), TrunkTrainer if settings.read_out else Trainer
    if checkpoint.exists():
        trainer = kind(brdf, samples, settings, np.ones((len(samples.names), brdf.n_parameters)))
        trainer.resume(checkpoint)
    else:
        if not settings.read_out:  # which is the analytic model at first
            brdf = imitate(brdf, steps=settings.imitation_steps, seed=settings.seed, progress=progress)
        trainer = kind(brdf, samples, settings, analytic_start(brdf, samples))
    total = settings.steps
    validation = settings.validation and trainer.step < total
    unseen = read(settings.validation, seed=settings.seed + UNSEEN_SEED) if validation else None
    unseen_start = analytic_start(brdf, unseen) if unseen else None
    refits = {total * k // (settings.refits + 1) for k in range(1, settings.refits + 1)}
    # A killed run may have written a line after its checkpoint.
    curve = [line for line in _curve(folder) if line["step"] <= trainer.step]
    before = curve[-1]["seconds"] if curve else 0.0
    start, first, losses = time.perf_counter(), trainer.step, []
    figures: dict[str, float] = {}
    while trainer.step < total:
        losses.append(trainer.advance())
        if trainer.step in refits:
            trainer.refit()
        last = trainer.step == total
        if trainer.step % every[0] == 0 or last:
            mean, seconds = float(np.mean(losses)), time.perf_counter() - start
            record = {"step": trainer.step, "loss": mean, **_by_kind(samples.kinds, np.mean(losses, 0))}
            if unseen and unseen_start is not None and (last or trainer.step % (every[0] * every[1]) == 0):
                losses_unseen = _by_kind(unseen.kinds, validate(trainer.result(), unseen, unseen_start))
                record |= {f"validation {kind}": loss for kind, loss in losses_unseen.items()}
            curve.append({**record, "seconds": round(before + seconds, 1)})
            # all lines at once: a killed run never leaves half a line
            write_text(folder / "curve.jsonl", "".join(json.dumps(line) + "\n" for line in curve))
            trainer.save(checkpoint)
            _ship(trainer, folder)
            if _has_validation(record):
                draw_curve(curve, folder / "curve.png")
            rate = (trainer.step - first) * trainer.n_materials * settings.batch / seconds / 1e6
            figures, losses = {"loss": mean, "million samples per s": rate}, []
        progress(Progress("train", trainer.step, total, figures))
    _ship(trainer, folder)
    return trainer


def _network(settings: TrainingSettings) -> EnhancedBRDF:
    """Return the BRDF to train, with its first weights."""
    model = models.from_toml(settings.model) if settings.model.endswith(".toml") else settings.model
    if settings.read_out:
        return with_trunk(
            model,
            settings.replace,
            n_latent=settings.n_latent,
            hidden=settings.hidden,
            channels=3 if settings.read_out == "rgb" else 1,
            seed=settings.seed,
        )
    return enhance(
        model,
        settings.replace,
        n_latent=settings.n_latent,
        hidden=settings.hidden,
        inputs=settings.inputs,
        modulated=settings.modulated,
        seed=settings.seed,
    )


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
