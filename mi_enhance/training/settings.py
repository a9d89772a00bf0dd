"""Settings of a training."""

from __future__ import annotations

from ..neural import mlp

DEFAULTS = {
    "model": "ggx",
    "replace": ["F", "F*G", "G", "1/E"],  # or {slot: hidden sizes}
    "inputs": "symmetric",
    "modulated": False,
    "n_latent": 27,
    "hidden": list(mlp.HIDDEN),
    "data": [],
    "validation": [],
    "n_samples": 8192,  # per material
    "batch": 64,  # samples per material and step
    "steps": 10000,
    "imitation_steps": 1000,
    "lr": 2e-3,  # of the weights; both rates fall to 1 % along a cosine
    "lr_parameters": 3e-3,
    "refits": 3,  # times, evenly spread, that every material is fitted anew
    "seed": 0,
}
