"""Training: the weights of all networks and the parameters of all materials together (paper, section 4.3).

One step sees the same few samples of every material. A fused kernel evaluates and differentiates, see
:class:`mi_enhance.neural.trainable.Trainable`; what belongs to a material is summed over its samples afterwards.
"""

from __future__ import annotations

import dataclasses
import json
import time
from collections.abc import Callable
from pathlib import Path

import drjit as dr
import mitsuba as mi
import numpy as np
from drjit.opt import Adam

from .analytic import parameter_space, parameters
from .data.training import TrainingSet, build
from .fitting.analytic_fit import fit_analytic
from .fitting.objective import Objective
from .imitate import imitate
from .material.material import Material
from .neural import mlp, trainable
from .neural.enhance import enhance
from .neural.enhanced_brdf import EnhancedBRDF
from .numerics import levenberg_marquardt
from .system import npz
from .system.files import read_json, replacing
from .system.garbage_collection import _no_collection
from .training.curve_picture import draw_curve

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
_EVERY = (1000, 4)  # steps to a checkpoint, and checkpoints to a validation, which takes as long as 200 steps
_REFIT_AT_ONCE = 128  # materials: bounds the memory of their Jacobians
_START_SAMPLES = 1024  # per material, for the analytic fit that training starts from
# Steps, at most a quarter of all, in which the rates rise: Adam's first, before its moments mean anything, can kill a
# lobe.
_WARM_UP = 200


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
        self.trainable = trainable.Trainable(brdf.networks)
        self._data = [mi.Float(row) for row in samples.samples]
        self._space = space = parameter_space.Space(brdf.parameters)
        repeat = lambda v: mi.Float(np.repeat(v, self.n_materials).astype(np.float32))  # noqa: E731
        # Tracing takes as long as the kernels; they are the same in every step.
        self._backward = dr.freeze(lambda *inputs: self._trace_backward(*inputs))
        self._low, self._high = repeat(space.low), repeat(space.high)
        self.optimizer = Adam(lr=config["lr"])
        self.optimizer["weights"] = self.trainable.weights
        # all parameters of all materials, parameter after parameter, in the space that is optimised (log alpha)
        self._start = space.to(start)
        self.optimizer["parameters"] = mi.Float(self._start.T.ravel().astype(np.float32))

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
        weights, flat = (mi.Float(dr.detach(self.optimizer[key])) for key in ("weights", "parameters"))
        with _no_collection():
            loss, gradient, self.trainable.pending = self._backward(weights, flat, self._data, self._indices())
        return np.array(loss, np.float64) / self.config["batch"], self.trainable.gradient(), gradient

    def _trace_backward(self, weights, flat, data, index):
        """Sum of the loss per material, gradient of the parameters, and what the gradient of the weights is made of."""
        rows = [dr.gather(mi.Float, row, index) for row in data]
        wi, wo, f = mi.Vector3f(*rows[:3]), mi.Vector3f(*rows[3:6]), mi.Color3f(*rows[6:])
        n = self.config["batch"]
        self.trainable.weights = weights
        dr.enable_grad(weights, flat)
        loss, gradient = Objective(self.brdf, wi, wo, f, n, self.trainable).gradient(flat)
        return dr.block_sum(loss, n), gradient, self.trainable.take()

    def advance(self) -> np.ndarray:
        """Take one step and return the loss of every material before it."""
        loss, weights, params = self.gradients()
        fall = 0.01 + 0.99 * 0.5 * (1 + np.cos(np.pi * min(self.step / self.config["steps"], 1)))
        fall *= min(1, (self.step + 1) / min(_WARM_UP, max(1, self.config["steps"] // 4)))
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

    def refit(self) -> None:
        """Fit every material anew, from where it is and from where it started; the better one stays.

        Noisy small steps drive a few materials, mostly near-mirrors, into minima they do not leave: a tilted normal, a
        roughness at its bound.
        """
        brdf, space, n = self.result(), self._space, min(_START_SAMPLES, self.samples.n_samples)
        u = space.to(self.parameters())
        for first in range(0, self.n_materials, _REFIT_AT_ONCE):
            part = slice(first, first + _REFIT_AT_ONCE)
            problem = Objective(brdf, *first_samples(self.samples, n, part), n)
            tries = [
                levenberg_marquardt.minimize(
                    problem.loss, problem.normal_equations, v[part], space.low, space.high, steps=10
                )
                for v in (u, self._start)
            ]
            u[part] = np.where((tries[0][1] <= tries[1][1])[:, None], tries[0][0], tries[1][0])
        self.optimizer["parameters"] = mi.Float(u.T.ravel().astype(np.float32))

    def result(self) -> EnhancedBRDF:
        """The BRDF with the current weights."""
        return dataclasses.replace(self.brdf, networks=self.trainable.networks())

    def parameters(self) -> np.ndarray:
        """Physical parameters of all materials, array (M, n_parameters), float64."""
        flat = np.array(dr.detach(self.optimizer["parameters"]), np.float64).reshape(-1, self.n_materials)
        return self._space.back(flat.T.copy())

    def material(self, curve: list[dict] = ()) -> Material:
        """The network as it is shipped: weights, where fits start, and how it was made, its `curve` included."""
        seen = self.step * self.n_materials * self.config["batch"]
        report = {"config": self.config, "steps": self.step, "samples_seen": seen, "curve": list(curve)}
        keep = representative(self.samples.kinds)
        return Material(
            self.result(),
            {},
            {**report, "library": [self.samples.names[k] for k in keep]},
            library=self.parameters()[keep],
        )

    def save(self, path: Path) -> None:
        """Write a checkpoint: weights, parameters, state of the optimiser, step."""
        arrays = {"step": self.step, "start": self._start}
        for key in ("weights", "parameters"):
            _, _, _, (t, m, v, _) = self.optimizer.state[key]
            arrays |= {key: dr.detach(self.optimizer[key]), f"{key}_t": t, f"{key}_m": m, f"{key}_v": v}
        with replacing(path) as temporary:
            np.savez(temporary, **{k: np.array(v) for k, v in arrays.items()})

    def resume(self, path: Path) -> None:
        """Go on from a checkpoint, to the bit; a ValueError if it is damaged or another network's."""
        where, keys = f'checkpoint "{path}"', ("weights", "parameters")
        names = [f"{key}{suffix}" for key in keys for suffix in ("", "_t", "_m", "_v")]
        stored = npz.read(path, ["step", "start", *names], where)
        self.step, self._start = int(npz.numbers(stored, "step", (), where)), stored["start"]
        for key in keys:
            n = (len(self.optimizer[key]),)
            self.optimizer[key], m, v = (
                mi.Float(npz.numbers(stored, f"{key}{suffix}", n, where)) for suffix in ("", "_m", "_v")
            )
            value, promoted, rate, _ = self.optimizer.state[key]
            self.optimizer.state[key] = value, promoted, rate, (mi.UInt32(stored[f"{key}_t"]), m, v, None)
        self.trainable.weights = self.optimizer["weights"]


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
        config["model"],
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


def analytic_start(brdf: EnhancedBRDF, samples: TrainingSet, cache: Path | None = None) -> np.ndarray:
    """Where the materials start: the best fit of the analytic model, latent numbers at their initial value.

    With `cache`, a ``.npz`` file, the analytic fits are kept there or taken from there.
    """
    n = min(_START_SAMPLES, samples.n_samples)
    if cache and cache.exists():
        where, shape = f'analytic fits "{cache}"', (len(samples.names), parameters.count(brdf.model.parameters))
        analytic = npz.numbers(npz.read(cache, ["analytic"], where), "analytic", shape, where).astype(np.float64)
    else:
        analytic = fit_analytic(EnhancedBRDF(brdf.model, {}), *first_samples(samples, n), n)
    if cache and not cache.exists():
        with replacing(cache) as temporary:
            np.savez(temporary, analytic=analytic)
    start = np.tile(parameters.flatten(brdf.parameters, parameters.initial(brdf.parameters)), (len(analytic), 1))
    start[:, : analytic.shape[1]] = analytic
    return start


def representative(kinds: list[str]) -> np.ndarray:
    """Materials that fits start from: all measured ones, and of the made-up ones as many, evenly spaced."""
    made_up = np.array([kind in ("nps-mixtures", "synthetic", "two-lobes", "assorted") for kind in kinds])
    measured, rest = np.flatnonzero(~made_up), np.flatnonzero(made_up)
    n = min(len(rest), max(len(measured), 250))
    return np.sort(np.append(measured, rest[np.linspace(0, len(rest) - 1, n).astype(int)] if n else rest))


def validate(brdf: EnhancedBRDF, samples: TrainingSet, start: np.ndarray) -> np.ndarray:
    """Loss of materials the networks do not train on, (M,), each fitted by a few steps from `start`."""
    n = min(_START_SAMPLES, samples.n_samples)
    problem = Objective(brdf, *first_samples(samples, n), n)
    _, losses = levenberg_marquardt.minimize(
        problem.loss, problem.normal_equations, problem.space.to(start), problem.space.low, problem.space.high, steps=20
    )
    return losses


def first_samples(samples: TrainingSet, n: int, materials=slice(None)) -> tuple:
    """wi, wo and f of the first n samples of the materials, as Dr.Jit arrays."""
    rows = samples.samples.reshape(9, -1, samples.n_samples)[:, materials, :n].reshape(9, -1)
    return tuple(
        t(np.ascontiguousarray(rows[k : k + 3])) for k, t in ((0, mi.Vector3f), (3, mi.Vector3f), (6, mi.Color3f))
    )


def _by_kind(kinds: list[str], losses: np.ndarray) -> dict[str, float]:
    """Mean loss of each kind of material: noisy ones hide what happens to the others."""
    return {kind: float(losses[np.array(kinds) == kind].mean()) for kind in sorted(set(kinds))}


def _rate(trainer: Trainer, first: int, seconds: float) -> float:
    return (trainer.step - first) * trainer.n_materials * trainer.config["batch"] / seconds / 1e6


def _bar(items, desc: str):
    from tqdm import tqdm

    return tqdm(items, desc=desc, mininterval=2)
