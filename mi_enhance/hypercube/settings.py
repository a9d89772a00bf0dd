"""Settings of a search, and their checks."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any, ClassVar

from ..analytic import models
from ..neural.inputs import INPUTS, InputKind
from ..system.settings import FLAG, LIST, TABLE, TEXT, Rule, Settings, number, one_of, setting, whole

COSTS = ("multiply-adds", "measured")


@dataclasses.dataclass(frozen=True)
class SearchSettings(Settings):
    """Settings of :func:`mi_enhance.hypercube.search.search`. ``search.json`` holds them under the same names.

    Parameters
    ----------
    model : str
        Name of the analytic model, or its text.
    modules : list of list of int
        Hidden sizes of the modules to choose from.
    alternatives : dict of str to list of str
        Slot -> names of other analytic terms.
    fixed : dict of str to str
        Slot -> ``"analytic"`` or ``"neural"``.
    nodes_only : bool
        Operators stay as they are.
    max_modules : int, optional
        Most modules of a state.
    distance : int
        Hamming distance of the candidates, 1 or 2.
    epochs : float
        Passes over the samples between changes.
    tolerance : float
        A change must lower the score by this part of it.
    price : float
        The score is loss x (1 + price x cost).
    cost : str
        ``"multiply-adds"``, in thousands, or ``"measured"``, in nanoseconds per evaluation.
    inputs, modulated, n_latent, batch, imitation_steps, lr, lr_parameters, seed
        As for :class:`mi_enhance.training.settings.TrainingSettings`.
    n_samples, n_aside : int
        Samples per material: those to train on, and those to judge by.

    Examples
    --------
    >>> SearchSettings.of({"epochs": 1}).cost
    'multiply-adds'
    """

    WHERE: ClassVar[str] = "search()"

    model: str = setting("ggx", TEXT)
    modules: list[list[int]] = setting([[16, 32, 16]], LIST)
    alternatives: dict[str, list[str]] = setting({}, TABLE)
    fixed: dict[str, str] = setting({}, TABLE)
    nodes_only: bool = setting(False, FLAG)
    max_modules: int | None = setting(
        None, Rule("null, or a whole number of at least 0", lambda v: v is None or whole().holds(v))
    )
    distance: int = setting(1, one_of(1, 2))
    epochs: float = setting(5.0, number(1e-6))
    tolerance: float = setting(0.01, number())
    price: float = setting(0.0, number())
    cost: str = setting("multiply-adds", one_of(*COSTS))
    inputs: InputKind = setting("shape", one_of(*INPUTS))
    modulated: bool = setting(True, FLAG)
    n_latent: int = setting(27, whole())
    n_samples: int = setting(4096, whole(1))
    n_aside: int = setting(1024, whole(1))
    batch: int = setting(64, whole(1))
    imitation_steps: int = setting(500, whole())
    lr: float = setting(4e-3, number())
    lr_parameters: float = setting(3e-3, number())
    seed: int = setting(0, whole())


def settings_for(model: models.Model | str, given: Mapping[str, Any]) -> SearchSettings:
    """Return the settings of a search that starts from `model`.

    Raises
    ------
    ValueError, KeyError
        For an unknown or impossible setting, or a model that no file could name.
    """
    if isinstance(model, str):
        model = models.from_toml(model) if model.endswith(".toml") else models.get(model)
    settings = SearchSettings.of({**given, "model": model.text or model.name})
    if str(model_of(settings)) != str(model):
        raise ValueError(
            f'search(): model "{model.name}" ({model}) is not the one that name stands for; '
            "files could not say what it is. Write it as a text: models.from_expression."
        )
    return settings


def model_of(settings: SearchSettings) -> models.Model:
    """Return the model that the settings name, or hold as a text."""
    text = settings.model
    return models.from_expression(text) if "\n" in text else models.get(text)
