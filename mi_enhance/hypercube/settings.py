"""Settings of a search, and their checks."""

from __future__ import annotations

from ..analytic import models
from ..neural.inputs import INPUTS
from . import setup

DEFAULTS = {
    "model": "ggx",
    # the hypercube
    "modules": [[16, 32, 16]],  # hidden sizes to choose from
    "alternatives": {},  # slot: names of other analytic terms
    "fixed": {},  # slot: "analytic" or "neural"
    "nodes_only": False,
    "max_modules": None,
    "distance": 1,  # Hamming distance of candidates
    # when a state is better
    "epochs": 5.0,  # between changes
    "tolerance": 0.01,  # a change must lower the score by this part of it
    "price": 0.0,  # score = loss x (1 + price x cost)
    "cost": "multiply-adds",  # in thousands; or "measured", in nanoseconds per evaluation
    # the networks and their training
    "inputs": "shape",
    "modulated": True,
    "n_latent": 27,
    "n_samples": 4096,  # per material, to train on
    "n_aside": 1024,  # per material, to judge by
    "batch": 64,  # samples per material and step
    "imitation_steps": 500,
    "lr": 4e-3,
    "lr_parameters": 3e-3,
    "seed": 0,
}


_COSTS = ("multiply-adds", "measured")


_AT_LEAST = {
    "epochs": 1e-6,
    "tolerance": 0.0,
    "price": 0.0,
    "lr": 0.0,
    "lr_parameters": 0.0,
    "max_modules": 0,
    "n_latent": 0,
}


_AT_LEAST |= {"n_samples": 1, "n_aside": 1, "batch": 1, "imitation_steps": 0, "seed": 0}


def _checked(model: models.Model | str, settings: dict) -> dict:
    unknown = set(settings) - set(DEFAULTS)
    if unknown:
        raise ValueError(f"search(): unknown settings {sorted(unknown)}. Choose from: {', '.join(DEFAULTS)}.")
    if isinstance(model, str):
        model = models.from_toml(model) if model.endswith(".toml") else models.get(model)
    settings = {**DEFAULTS, **settings, "model": model.text or model.name}
    if str(setup.model_of(settings)) != str(model):
        raise ValueError(
            f'search(): model "{model.name}" ({model}) is not the one that name stands for; '
            "files could not say what it is. Write it as a text: models.from_expression."
        )
    for key, choices in (("cost", _COSTS), ("inputs", INPUTS), ("distance", (1, 2))):
        if settings[key] not in choices:
            raise ValueError(f"search(): {key}={settings[key]!r} is unknown. Choose one of: {choices}.")
    for key, low in _AT_LEAST.items():
        value, whole = settings[key], isinstance(DEFAULTS[key], int) or key == "max_modules"
        if key == "max_modules" and value is None:
            continue
        if isinstance(value, bool) or not isinstance(value, int if whole else (int, float)) or not low <= value < 1e12:
            kind = "whole number" if whole else "number"
            raise ValueError(f"search(): {key}={value!r}; it must be a {kind} of at least {low:g}.")
    for key, kind in (
        ("nodes_only", bool),
        ("modulated", bool),
        ("modules", list),
        ("alternatives", dict),
        ("fixed", dict),
    ):
        if not isinstance(settings[key], kind):
            raise ValueError(f"search(): {key}={settings[key]!r}; it must be a {kind.__name__}, as {DEFAULTS[key]!r}.")
    return settings
