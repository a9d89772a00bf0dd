"""What all candidates of a search share."""

from __future__ import annotations

import functools
from pathlib import Path

from ..analytic import models
from ..system.files import read_json
from ..training.training_set import TrainingSet
from . import states


def candidate_folder(folder: Path, stage: int, digits: states.State) -> Path:
    return folder / f"stage-{stage:02d}" / states.state_digits(digits)


def model_of(settings: dict) -> models.Model:
    """The model that the settings of a search name, or hold as a text."""
    text = settings["model"]
    return models.from_expression(text) if "\n" in text else models.get(text)


def choices_of(settings: dict) -> dict[str, tuple[states.Choice, ...]]:
    """What may stand in every slot, by the settings of a search."""
    names = ("modules", "alternatives", "fixed", "nodes_only")
    return states.choices(model_of(settings), **{name: settings[name] for name in names})


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
