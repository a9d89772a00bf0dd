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
    "lr": 3e-3,  # of the weights; both rates fall to 1 % along a cosine
    "lr_parameters": 1e-2,
    "seed": 0,
}
_CHECKPOINT_EVERY = 500  # steps


class Trainer:
    """State of a training: networks, parameters of every material, optimiser.

    Parameters
    ----------
    brdf : EnhancedBRDF
    samples : TrainingSet
    config : dict
        As :data:`DEFAULTS`.
    """

    def __init__(self, brdf: EnhancedBRDF, samples: TrainingSet, config: dict):
        self.brdf, self.config, self.samples = brdf, config, samples
        self.n_materials = len(samples.names)
        self.step = 0
        self.trainable = nn.Trainable(brdf.networks)
        self._data = [mi.Float(row) for row in samples.samples]
        space = parameters.Space(brdf.parameters)
        self._space = space
        start = space.to(parameters.flatten(brdf.parameters, parameters.initial(brdf.parameters)))
        repeat = lambda v: mi.Float(np.repeat(v, self.n_materials).astype(np.float32))  # noqa: E731
        self._low, self._high = repeat(space.low), repeat(space.high)
        self.optimizer = Adam(lr=config["lr"])
        self.optimizer["weights"] = self.trainable.weights
        # all parameters of all materials, parameter after parameter, in the space that is optimised (log alpha)
        self.optimizer["parameters"] = repeat(start)

    def _indices(self) -> mi.UInt32:
        """A run of consecutive samples of every material, from a random place; they are in random order anyway."""
        n, total = self.config["batch"], self.samples.n_samples
        rng = np.random.default_rng((self.config["seed"], self.step))
        start = mi.UInt32(rng.integers(0, total, self.n_materials).astype(np.uint32))
        offset = dr.repeat(start, n) + dr.tile(dr.arange(mi.UInt32, n), self.n_materials)
        offset = dr.select(offset >= total, offset - total, offset)
        return offset + total * dr.repeat(dr.arange(mi.UInt32, self.n_materials), n)

    def gradients(self) -> tuple[mi.Float, mi.Float, mi.Float]:
        """Loss on the next batch (eq. 1), gradient of the weights, gradient of the parameters."""
        n = self.config["batch"]
        index = self._indices()
        wi_x, wi_y, wi_z, wo_x, wo_y, wo_z, *f = (dr.gather(mi.Float, row, index) for row in self._data)
        flat = mi.Float(dr.detach(self.optimizer["parameters"]))
        dr.enable_grad(flat)
        lane = dr.arange(mi.UInt32, self.n_materials)
        u = [dr.gather(mi.Float, flat, lane + k * self.n_materials) for k in range(self.brdf.n_parameters)]
        params = parameters.unflatten(self.brdf.parameters, self._space.back(u))
        folded = self.brdf.fold(params, self.trainable)
        # What belongs to a material becomes N lanes wide by hand, so that its gradient is summed in one go below.
        per_material = [*_arrays(params), *(v for bias in folded.values() for v in bias)]
        lanes = [dr.repeat(dr.detach(v), n) for v in per_material]
        dr.enable_grad(lanes)
        rest = iter(lanes)
        wide = _like(params, rest)
        wide_folded = {slot: [next(rest) for _ in bias] for slot, bias in folded.items()}
        wi, wo = mi.Vector3f(wi_x, wi_y, wi_z), mi.Vector3f(wo_x, wo_y, wo_z)
        value = self.brdf(wi, wo, wide, self.trainable, wide_folded)
        error = dr.abs(dr.log(1 + mi.Color3f(*f) * wo_z) - dr.log(1 + value * wo_z))
        error = (error.x + error.y + error.z) / 3
        _backward(error, 1 / len(index))
        wide_gradient = dr.grad(lanes)
        dr.eval(dr.detach(error), wide_gradient)
        _backward(per_material, [dr.block_sum(g, n) for g in wide_gradient])
        return dr.mean(dr.detach(error)), self.trainable.gradient(), dr.grad(flat)

    def advance(self) -> float:
        """Take one step and return the loss before it."""
        loss, weights, params = self.gradients()
        fall = 0.01 + 0.99 * 0.5 * (1 + np.cos(np.pi * min(self.step / self.config["steps"], 1)))
        rates = {"weights": self.config["lr"], "parameters": self.config["lr_parameters"]}
        self.optimizer.set_learning_rate({key: float(rate * fall) for key, rate in rates.items()})
        for key, gradient in (("weights", weights), ("parameters", params)):
            dr.set_grad(self.optimizer[key], gradient)
        self.optimizer.step()
        clipped = dr.clip(dr.detach(self.optimizer["parameters"]), self._low, self._high)
        self.optimizer["parameters"] = clipped
        self.trainable.weights = self.optimizer["weights"]
        self.step += 1
        return float(loss[0])

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
                moments = mi.Float(stored[f"{key}_m"]), mi.Float(stored[f"{key}_v"])
                extra = (int(stored[f"{key}_t"]), *(dr.detach(m, preserve_type=False) for m in moments), None)
                self.optimizer.state[key] = value, promoted, rate, extra
        self.trainable.weights = self.optimizer["weights"]


def _backward(variables, gradients) -> None:
    """Propagate given gradients of `variables`."""
    dr.set_grad(variables, gradients)
    dr.enqueue(dr.ADMode.Backward, variables)
    dr.traverse(dr.ADMode.Backward)


def _arrays(params: dict) -> Iterator[mi.Float]:
    """All arrays of a parameter dictionary, colours and lists taken apart."""
    for v in params.values():
        yield from [v] if isinstance(v, mi.Float) else v


def _like(params: dict, arrays: Iterator[mi.Float]) -> dict:
    """A parameter dictionary of the same form with other arrays."""
    result = {}
    for name, v in params.items():
        if isinstance(v, mi.Float):
            result[name] = next(arrays)
        else:
            parts = [next(arrays) for _ in v]
            result[name] = mi.Color3f(*parts) if isinstance(v, mi.Color3f) else parts
    return result


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
    if not checkpoint.exists():
        brdf = imitate(brdf, steps=config["imitation_steps"], seed=config["seed"])
    trainer = Trainer(brdf, samples, config)
    if checkpoint.exists():
        trainer.resume(checkpoint)
    start, first, losses = time.perf_counter(), trainer.step, []
    for _ in (steps := bar(range(trainer.step, config["steps"]), desc="train")):
        losses.append(trainer.advance())
        if trainer.step % _CHECKPOINT_EVERY == 0 or trainer.step == config["steps"]:
            mean = float(np.mean(losses))
            seconds = time.perf_counter() - start
            with open(folder / "curve.jsonl", "a") as curve:
                curve.write(json.dumps({"step": trainer.step, "loss": mean, "seconds": round(seconds, 1)}) + "\n")
            if progress:
                steps.set_postfix(loss=f"{mean:.5f}", samples=f"{_rate(trainer, first, seconds):.2f} M/s")
            trainer.save(checkpoint)
            losses = []
            if callback:
                callback(trainer)
    return trainer


def _rate(trainer: Trainer, first: int, seconds: float) -> float:
    return (trainer.step - first) * trainer.n_materials * trainer.config["batch"] / seconds / 1e6


def _bar(items, desc: str):
    from tqdm import tqdm

    return tqdm(items, desc=desc, mininterval=2)
