"""Weights and parameters that a candidate inherits from its parent."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ..analytic import alternative_terms, parameter_space, parameters
from ..neural.enhance import enhance
from ..neural.enhanced_brdf import EnhancedBRDF
from ..neural.mlp import MLP, flatten, unflatten
from ..system import npz
from ..system.cache import cached
from ..system.files import digest
from ..training.imitation import imitate
from . import states
from .setup import Setup, candidate_folder


def inherit(
    setup: Setup, folder: Path, stage: int, digits: states.State, parent: states.State
) -> tuple[EnhancedBRDF, np.ndarray]:
    """Return the BRDF of a state and the parameters of all materials, (M, P), as far as possible those of the parent.

    New parts start as the parts they replace: a module imitates its term or operator, another analytic term takes the
    parameters with which it resembles the usual one.
    """
    template = states.brdf_of(setup.model, parent, setup.choices, **setup.build)
    before, values = restore(template, candidate_folder(folder, stage - 1, parent) / "checkpoint.npz")
    brdf = states.brdf_of(setup.model, digits, setup.choices, **setup.build)
    return started(setup, folder, brdf, before.modules), _carry(values, before, brdf)


def restore(template: EnhancedBRDF, checkpoint: Path) -> tuple[EnhancedBRDF, np.ndarray]:
    """Return the BRDF with the weights of a checkpoint, and the parameters of all materials, (M, P)."""
    where = f'search(): "{checkpoint}"'
    stored = npz.read(checkpoint, ["weights", "parameters"], where)
    flat = npz.numbers(stored, "weights", (max(template.n_weights, 1),), where)  # without networks one float stands in
    values = stored["parameters"]
    if values.dtype.kind != "f" or values.size % template.n_parameters or not np.isfinite(values).all():
        raise ValueError(f"{where}: the parameters are not those of {template}. Remove this file's folder.")
    values = values.astype(np.float64)
    values = values.reshape(template.n_parameters, -1).T.copy()
    brdf = dataclasses.replace(template, modules=unflatten(template.modules, flat))
    return brdf, parameter_space.Space(template.parameters).to_physical(values)


def started(setup: Setup, folder: Path, brdf: EnhancedBRDF, kept: Mapping[str, MLP]) -> EnhancedBRDF:
    """Return `brdf` with the modules of `kept` where they fit, and others that imitate what they replace."""
    networks = {}
    for slot, mlp in brdf.modules.items():
        same = slot in kept and kept[slot].sizes == mlp.sizes
        networks[slot] = kept[slot] if same else _imitation(setup, folder, slot, mlp.sizes[1:-1])
    return dataclasses.replace(brdf, modules=networks)


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
    """Return a module that has learned the term or operator in `slot`; it is kept in the folder of the search."""
    steps, seed = setup.settings.imitation_steps, setup.settings.seed
    key = json.dumps([1, str(setup.model), setup.model.name, slot, hidden, steps, setup.build], sort_keys=True)
    file = folder / "cache" / f"imitation-{digest(key.encode())}.npz"
    alone = enhance(setup.model, {slot: hidden}, **setup.build)

    def read(path: Path) -> np.ndarray:
        where = f'search(): "{path}"'
        return npz.numbers(npz.read(path, ["weights"], where), "weights", (alone.n_weights,), where)

    weights = cached(
        file,
        lambda: flatten(imitate(alone, steps=steps, seed=seed).modules),
        read,
        lambda path, flat: np.savez(path, weights=flat),
    )
    return unflatten(alone.modules, weights)[slot]
