"""Settings, model, choices and samples: what all candidates of a search share."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Any

from ..system.files import read_json
from ..training.settings import TrainingSettings
from ..training.training_set import TrainingSet
from . import states
from .settings import SearchSettings, model_of


def candidate_folder(folder: Path, stage: int, digits: states.State) -> Path:
    """Return the folder of a candidate in that of its search."""
    return folder / f"stage-{stage:02d}" / states.state_digits(digits)


def choices_of(settings: SearchSettings) -> dict[str, tuple[states.Choice, ...]]:
    """Return the choices of every slot, by the settings of a search."""
    return states.choices(
        model_of(settings),
        modules=settings.modules,
        alternatives=settings.alternatives,
        fixed=settings.fixed,
        nodes_only=settings.nodes_only,
    )


class Setup:
    """Settings, model, choices and samples that all candidates of a search share, read once per process.

    Parameters
    ----------
    folder : Path
        Of the search, with ``search.json`` and ``samples.npz``.
    """

    def __init__(self, folder: Path):
        kept = read_json(folder / "search.json", "search()", ("model", "n_samples", "batch", "epochs"))
        self.kept = kept  # as it is in the file: with the digest of the materials
        self.settings = s = SearchSettings.of({key: value for key, value in kept.items() if key != "materials"})
        self.model = model_of(s)
        self.choices = choices_of(s)
        self.build: dict[str, Any] = {
            "inputs": s.inputs,
            "modulated": s.modulated,
            "n_latent": s.n_latent,
            "seed": s.seed,
        }
        self.samples = TrainingSet.read(folder / "samples.npz").split(s.n_samples)
        self.steps = max(1, round(s.epochs * s.n_samples / s.batch))

    def training(self, stage: int) -> TrainingSettings:
        """Return the settings by which a candidate of a stage is trained."""
        s = self.settings
        return TrainingSettings(
            steps=self.steps, batch=s.batch, lr=s.lr, lr_parameters=s.lr_parameters, seed=s.seed + stage
        )

    @staticmethod
    def of(folder: Path) -> Setup:
        """Return the setup in a folder, read again only if its files have changed."""
        times = tuple((folder / name).stat().st_mtime_ns for name in ("search.json", "samples.npz"))
        return _setup(folder, times)


@functools.lru_cache(maxsize=1)
def _setup(folder: Path, times: tuple[int, ...]) -> Setup:
    return Setup(folder)
