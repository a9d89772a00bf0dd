"""Training: the weights of all networks and the parameters of all materials together (paper, section 4.3).

One step sees the same few samples of every material. A fused kernel evaluates and differentiates, see
:class:`mi_enhance.nn.Trainable`; what belongs to a material is summed over its samples afterwards.
"""

from __future__ import annotations

import dataclasses
import json
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import drjit as dr
import mitsuba as mi
import numpy as np
from drjit.opt import Adam

from . import nn, parameters
from .data._io import replacing
from .data.sampling import sample_pairs
from .data.training import TrainingSet, build
from .enhance import EnhancedBRDF, enhance
from .fit import fit_analytic
from .objective import Objective

DEFAULTS = {
    "model": "ggx",
    "replace": ["F", "F*G", "G", "1/E"],
    "inputs": "symmetric",
    "n_latent": 27,
    "hidden": list(nn.HIDDEN),
    "data": [],
    "validation": [],
    "n_samples": 8192,  # per material
    "batch": 64,  # samples per material and step
    "steps": 10000,
    "imitation_steps": 1000,
    "lr": 2e-3,  # of the weights; both rates fall to 1 % along a cosine
    "lr_parameters": 1e-2,
    "seed": 0,
}
_CHECKPOINT_EVERY = 500  # steps
_START_SAMPLES = 1024  # per material, for the analytic fit that training starts from
_WARM_UP = 200  # steps in which the rates rise: Adam's first steps, before its moments mean anything, can kill a lobe


class Trainer:
    """State of a training: networks, parameters of every material, optimiser.

    Parameters
    ----------
    brdf : EnhancedBRDF
    samples : TrainingSet
    config : dict
        As :data:`DEFAULTS`.
    start : array (M, n_parameters)
        Parameters of the materials to start from.
    """

    def __init__(self, brdf: EnhancedBRDF, samples: TrainingSet, config: dict, start: np.ndarray):
        self.brdf, self.config, self.samples = brdf, config, samples
        self.n_materials = len(samples.names)
        self.step = 0
        self.trainable = nn.Trainable(brdf.networks)
        self._data = [mi.Float(row) for row in samples.samples]
        self._space = space = parameters.Space(brdf.parameters)
        repeat = lambda v: mi.Float(np.repeat(v, self.n_materials).astype(np.float32))  # noqa: E731
        self._low, self._high = repeat(space.low), repeat(space.high)
        self.optimizer = Adam(lr=config["lr"])
        self.optimizer["weights"] = self.trainable.weights
        # all parameters of all materials, parameter after parameter, in the space that is optimised (log alpha)
        self.optimizer["parameters"] = mi.Float(space.to(start).T.ravel().astype(np.float32))

    def _indices(self) -> mi.UInt32:
        """A run of consecutive samples of every material, from a random place; they are in random order anyway."""
        n, total = self.config["batch"], self.samples.n_samples
        rng = np.random.default_rng((self.config["seed"], self.step))
        start = mi.UInt32(rng.integers(0, total, self.n_materials).astype(np.uint32))
        offset = dr.repeat(start, n) + dr.tile(dr.arange(mi.UInt32, n), self.n_materials)
        offset = dr.select(offset >= total, offset - total, offset)
        return offset + total * dr.repeat(dr.arange(mi.UInt32, self.n_materials), n)

    def gradients(self) -> tuple[np.ndarray, mi.Float, mi.Float]:
        """Loss per material on the next batch (eq. 1), gradient of the weights, gradient of the parameters."""
        n = self.config["batch"]
        index = self._indices()
        rows = [dr.gather(mi.Float, row, index) for row in self._data]
        wi, wo, f = mi.Vector3f(*rows[:3]), mi.Vector3f(*rows[3:6]), mi.Color3f(*rows[6:])
        objective = Objective(self.brdf, wi, wo, f, n, self.trainable)
        flat = mi.Float(dr.detach(self.optimizer["parameters"]))
        dr.enable_grad(flat)
        loss, gradient = objective.gradient(flat)
        weights = self.trainable.gradient()
        return np.array(dr.block_sum(loss, n), np.float64) / n, weights, gradient

    def advance(self) -> np.ndarray:
        """Take one step and return the loss of every material before it."""
        loss, weights, params = self.gradients()
        fall = 0.01 + 0.99 * 0.5 * (1 + np.cos(np.pi * min(self.step / self.config["steps"], 1)))
        fall *= min(1, (self.step + 1) / _WARM_UP)
        rates = {"weights": self.config["lr"], "parameters": self.config["lr_parameters"]}
        self.optimizer.set_learning_rate({key: float(rate * fall) for key, rate in rates.items()})
        for key, gradient in (("weights", weights), ("parameters", params)):
            dr.set_grad(self.optimizer[key], gradient)
        self.optimizer.step()
        clipped = dr.clip(dr.detach(self.optimizer["parameters"]), self._low, self._high)
        self.optimizer["parameters"] = clipped
        self.trainable.weights = self.optimizer["weights"]
        self.step += 1
        return loss

    def result(self) -> EnhancedBRDF:
        """The BRDF with the current weights."""
        return dataclasses.replace(self.brdf, networks=self.trainable.networks())

    def parameters(self) -> np.ndarray:
        """Physical parameters of all materials, array (M, n_parameters), float64."""
        flat = np.array(dr.detach(self.optimizer["parameters"]), np.float64).reshape(-1, self.n_materials)
        return self._space.back(flat.T.copy())

    def save(self, path: Path) -> None:
        """Write a checkpoint: weights, parameters, state of the optimiser, step."""
        arrays = {"step": self.step}
        for key in ("weights", "parameters"):
            _, _, _, (t, m, v, _) = self.optimizer.state[key]
            arrays |= {key: dr.detach(self.optimizer[key]), f"{key}_t": t, f"{key}_m": m, f"{key}_v": v}
        with replacing(path) as temporary:
            np.savez(temporary, **{k: np.array(v) for k, v in arrays.items()})

    def resume(self, path: Path) -> None:
        """Go on from a checkpoint, to the bit."""
        with np.load(path, allow_pickle=False) as stored:
            self.step = int(stored["step"])
            for key in ("weights", "parameters"):
                self.optimizer[key] = mi.Float(stored[key])
                value, promoted, rate, _ = self.optimizer.state[key]
                state = mi.UInt32(stored[f"{key}_t"]), mi.Float(stored[f"{key}_m"]), mi.Float(stored[f"{key}_v"]), None
                self.optimizer.state[key] = value, promoted, rate, state
        self.trainable.weights = self.optimizer["weights"]


def imitate(brdf: EnhancedBRDF, *, steps: int = 1000, batch: int = 8192, seed: int = 0, lr: float = 5e-3) -> EnhancedBRDF:
    """Teach each network the term or operator it replaces, so that training starts where the analytic model is.

    Parameters
    ----------
    brdf : EnhancedBRDF
        Its networks are where the imitation starts.
    steps, batch : int
        Random pairs of directions, each with random parameters, per step.
    seed : int
        Of directions and parameters.
    lr : float
        Learning rate, falling to 0 along a cosine.

    Returns
    -------
    EnhancedBRDF
        With networks close to the original terms.
    """
    rng = np.random.default_rng(seed)
    trainable = nn.Trainable(brdf.networks)
    optimizer = Adam(lr=lr, params={"weights": trainable.weights})
    evaluators = {slot: trainable[slot] for slot in brdf.networks}
    for step in range(steps):
        wi, wo = (mi.Vector3f(w.T) for w in sample_pairs(batch, seed=rng))
        params = parameters.unflatten(brdf.parameters, [mi.Float(v) for v in _random(brdf.parameters, batch, rng)])
        loss = brdf.imitation_error(wi, wo, params, evaluators)
        dr.backward(loss)
        dr.set_grad(optimizer["weights"], trainable.gradient())
        optimizer.set_learning_rate(float(lr * 0.5 * (1 + np.cos(np.pi * step / steps))))
        optimizer.step()
        trainable.weights = optimizer["weights"]
    return dataclasses.replace(brdf, networks=trainable.networks())


def _random(space, n: int, rng: np.random.Generator) -> np.ndarray:
    """Random parameter vectors, (P, n): uniform (log-uniform where optimised so) in the range, or around the start."""
    rows = []
    for p in space:
        for _ in range(p.size):
            if p.name == "latent":
                row = rng.normal(p.initial, 0.5, n)
            elif p.log:
                row = np.exp(rng.uniform(np.log(max(p.low, 3e-3)), np.log(p.high), n))
            else:
                row = rng.uniform(p.low, p.high, n)
            rows.append(row)
    return np.asarray(rows, np.float32)


def train(config: dict, folder: Path, *, progress: bool = True, callback: Callable | None = None) -> Trainer:
    """Train a network, or go on where an earlier run in `folder` stopped.

    Parameters
    ----------
    config : dict
        Entries of :data:`DEFAULTS` that differ from it.
    folder : Path
        Keeps ``config.json``, ``checkpoint.npz`` and ``curve.jsonl`` (step, loss, seconds).
    progress : bool
        Show a bar with the loss.
    callback : callable, optional
        ``callback(trainer)`` after every checkpoint.

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
    if checkpoint.exists() and json.loads(file.read_text()) != config:
        raise ValueError(f'train(): "{file}" is of a run with other settings. Choose another folder, or remove it.')
    file.write_text(json.dumps(config, indent=2) + "\n")
    bar = _bar if progress else (lambda items, **_: items)
    samples = build(
        config["data"], n_samples=config["n_samples"], seed=config["seed"], cache=folder.parent / "cache",
        progress=lambda jobs: bar(jobs, desc="decode"),
    )
    brdf = enhance(
        config["model"], config["replace"], n_latent=config["n_latent"], hidden=config["hidden"],
        inputs=config["inputs"], seed=config["seed"],
    )
    if checkpoint.exists():
        trainer = Trainer(brdf, samples, config, np.ones((len(samples.names), brdf.n_parameters)))
        trainer.resume(checkpoint)
    else:
        brdf = imitate(brdf, steps=config["imitation_steps"], seed=config["seed"])
        trainer = Trainer(brdf, samples, config, _analytic(brdf, samples))
    start, first, losses = time.perf_counter(), trainer.step, []
    for _ in (steps := bar(range(trainer.step, config["steps"]), desc="train")):
        losses.append(trainer.advance())
        if trainer.step % _CHECKPOINT_EVERY == 0 or trainer.step == config["steps"]:
            mean = float(np.mean(losses))
            seconds = time.perf_counter() - start
            record = {"step": trainer.step, "loss": mean, **_by_kind(samples.kinds, np.mean(losses, 0))}
            with open(folder / "curve.jsonl", "a") as curve:
                curve.write(json.dumps({**record, "seconds": round(seconds, 1)}) + "\n")
            if progress:
                steps.set_postfix(loss=f"{mean:.5f}", samples=f"{_rate(trainer, first, seconds):.2f} M/s")
            trainer.save(checkpoint)
            losses = []
            if callback:
                callback(trainer)
    return trainer


def _analytic(brdf: EnhancedBRDF, samples: TrainingSet) -> np.ndarray:
    """Where the materials start: the best fit of the analytic model, latent numbers at their initial value."""
    m = len(samples.names)
    rows = samples.samples.reshape(9, m, samples.n_samples)[:, :, :_START_SAMPLES].reshape(9, -1).copy()
    wi, wo, f = mi.Vector3f(rows[:3]), mi.Vector3f(rows[3:6]), mi.Color3f(rows[6:])
    analytic = fit_analytic(EnhancedBRDF(brdf.model, {}), wi, wo, f, rows.shape[1] // m)
    start = np.tile(parameters.flatten(brdf.parameters, parameters.initial(brdf.parameters)), (m, 1))
    start[:, : analytic.shape[1]] = analytic
    return start


def _by_kind(kinds: list[str], losses: np.ndarray) -> dict[str, float]:
    """Mean loss of each kind of material: noisy ones hide what happens to the others."""
    return {kind: float(losses[np.array(kinds) == kind].mean()) for kind in sorted(set(kinds))}


def _rate(trainer: Trainer, first: int, seconds: float) -> float:
    return (trainer.step - first) * trainer.n_materials * trainer.config["batch"] / seconds / 1e6


def _bar(items, desc: str):
    from tqdm import tqdm

    return tqdm(items, desc=desc, mininterval=2)
