"""The state of a training and one step of it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, ClassVar, cast

import drjit as dr
import mitsuba as mi
import numpy as np
from drjit.opt import Adam

from ..analytic import parameter_space
from ..fitting.objective import Objective
from ..material.material import Material
from ..neural import trainable
from ..neural.enhanced_brdf import EnhancedBRDF
from ..numerics import levenberg_marquardt
from ..numerics.schedules import cosine_decay
from ..system import npz
from ..system.files import replacing
from ..system.garbage_collection import no_collection
from .analytic_start import START_SAMPLES, representative
from .settings import TrainingSettings
from .training_set import TrainingSet, first_samples

_REFIT_AT_ONCE = 128  # materials: bounds the memory of their Jacobians
# Steps, at most a quarter of all, in which the rates rise: Adam's first, before its moments mean anything, can kill a
# lobe.
_WARM_UP = 200


class Trainer:
    """State of a training: networks, parameters of every material, optimizer.

    Parameters
    ----------
    brdf : EnhancedBRDF
    samples : TrainingSet
    settings : TrainingSettings
        Read are `batch`, `steps`, `lr`, `lr_parameters` and `seed`.
    start : array (M, n_parameters)
        Parameters of the materials to start from.
    """

    keys: ClassVar[tuple[str, ...]] = ("weights", "parameters")  # of the optimizer

    def __init__(self, brdf: EnhancedBRDF, samples: TrainingSet, settings: TrainingSettings, start: np.ndarray):
        self.brdf, self.settings, self.samples = brdf, settings, samples
        self.n_materials = len(samples.names)
        self.step = 0
        self.trainable = trainable.Trainable(brdf.networks)
        self._data = [mi.Float(row) for row in samples.samples]
        self._space = space = self._space_of(brdf)
        repeat = lambda v: mi.Float(np.repeat(v, self.n_materials).astype(np.float32))  # noqa: E731
        # Tracing takes as long as the kernels; they are the same in every step.
        self._backward = dr.freeze(lambda *inputs: self._trace_backward(*inputs))
        self._low, self._high = repeat(space.low), repeat(space.high)
        self.optimizer = Adam(lr=settings.lr)
        self.optimizer["weights"] = self.trainable.weights
        # all parameters of all materials, parameter after parameter, in the space that is optimized (log alpha)
        self._start = space.to_free(start)
        self.optimizer["parameters"] = mi.Float(self._start.T.ravel().astype(np.float32))

    def _space_of(self, brdf: EnhancedBRDF) -> parameter_space.Space:
        return parameter_space.Space(brdf.parameters)

    def _indices(self, step: int) -> mi.UInt32:
        """A run of consecutive samples of every material, from a random place; they are in random order anyway."""
        n, total = self.settings.batch, self.samples.n_samples
        rng = np.random.default_rng((self.settings.seed, step))
        start = mi.UInt32(rng.integers(0, total, self.n_materials).astype(np.uint32))
        offset = dr.repeat(start, n) + dr.tile(dr.arange(mi.UInt32, n), self.n_materials)
        return offset % total + total * dr.repeat(dr.arange(mi.UInt32, self.n_materials), n)

    def gradients(self) -> tuple[np.ndarray, mi.Float, mi.Float]:
        """Return the loss (eq. 1) per material on the next batch, and the gradients of weights and of parameters."""
        weights, flat = (mi.Float(dr.detach(self.optimizer[key])) for key in ("weights", "parameters"))
        with no_collection():
            loss, gradient, self.trainable.pending = self._backward(weights, flat, self._data, self._indices(self.step))
        return np.array(loss, np.float64) / self.settings.batch, self.trainable.gradient(), gradient

    def _trace_backward(self, weights, flat, data, index):
        """Return the sum of the loss per material, the gradient of the parameters, and the parts of the weights'."""
        rows = [dr.gather(mi.Float, row, index) for row in data]
        wi, wo, f = mi.Vector3f(*rows[:3]), mi.Vector3f(*rows[3:6]), mi.Color3f(*rows[6:])
        n = self.settings.batch
        self.trainable.weights = weights
        dr.enable_grad(weights, flat)
        loss, gradient = Objective(self.brdf, wi, wo, f, n, self.trainable).gradient(flat)
        return dr.block_sum(loss, n), gradient, self.trainable.take()

    def advance(self) -> np.ndarray:
        """Take one step and return the loss of every material before it."""
        loss, *gradients = self.gradients()
        self._descend((self.settings.lr, self.settings.lr_parameters), gradients, self.settings.steps)
        self.trainable.weights = cast(mi.Float, self.optimizer["weights"])
        return loss

    def _descend(self, rates: Iterable[float], gradients: Iterable[Any], steps: int, warm_up: int = _WARM_UP) -> None:
        """Take a step of the optimizer by the gradients of what it moves, one for each of its keys."""
        fall = cosine_decay(self.step, steps, warm_up=warm_up)
        self.optimizer.set_learning_rate({key: rate * fall for key, rate in zip(self.keys, rates, strict=True)})
        for key, gradient in zip(self.keys, gradients, strict=True):
            dr.set_grad(self.optimizer[key], gradient)
        self.optimizer.step()
        clipped = dr.clip(dr.detach(self.optimizer["parameters"]), self._low, self._high)
        self.optimizer["parameters"] = clipped
        self.step += 1

    def refit(self) -> None:
        """Fit every material anew, from where it is and from where it started; the better one stays.

        Noisy small steps drive a few materials, mostly near-mirrors, into minima they do not leave: a tilted normal, a
        roughness at its bound.
        """
        brdf, space, n = self.result(), self._space, min(START_SAMPLES, self.samples.n_samples)
        u = space.to_free(self.parameters())
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
        """Return the BRDF with the current weights."""
        return self.brdf.with_networks(self.trainable.modules())

    def parameters(self) -> np.ndarray:
        """Return the physical parameters of all materials, array (M, n_parameters), float64."""
        flat = np.array(dr.detach(self.optimizer["parameters"]), np.float64).reshape(-1, self.n_materials)
        return self._space.to_physical(flat.T.copy())

    def material(self, curve: Sequence[dict] = ()) -> Material:
        """Return the network as it is shipped: weights, starts of fits, and a report with the `curve`."""
        seen = self.step * self.n_materials * self.settings.batch
        report = {"config": self.settings.to_json(), "steps": self.step, "samples_seen": seen, "curve": list(curve)}
        keep = representative(self.samples.kinds)
        return Material(
            self.result(),
            {},
            {**report, "library": [self.samples.names[k] for k in keep]},
            library=self.parameters()[keep],
        )

    def save(self, path: Path) -> None:
        """Write a checkpoint: weights, parameters, state of the optimizer, step."""
        arrays: dict[str, Any] = {"step": self.step, "start": self._start}
        for key in self.keys:
            _, _, _, (t, m, v, _) = self.optimizer.state[key]
            arrays |= {key: dr.detach(self.optimizer[key]), f"{key}_t": t, f"{key}_m": m, f"{key}_v": v}
        arrays = {key: np.array(value) for key, value in arrays.items()}
        with replacing(path) as temporary:
            np.savez(temporary, **arrays)

    def resume(self, path: Path) -> None:
        """Go on from a checkpoint, to the bit; a ValueError if it is damaged or another network's."""
        where = f'checkpoint "{path}"'
        names = [f"{key}{suffix}" for key in self.keys for suffix in ("", "_t", "_m", "_v")]
        stored = npz.read(path, ["step", "start", *names], where)
        self.step, self._start = int(npz.numbers(stored, "step", (), where)), stored["start"]
        for key in self.keys:
            n = (len(self.optimizer[key]),)
            self.optimizer[key], m, v = (
                mi.Float(npz.numbers(stored, f"{key}{suffix}", n, where)) for suffix in ("", "_m", "_v")
            )
            value, promoted, rate, _ = self.optimizer.state[key]
            counter: Any = mi.UInt32(stored[f"{key}_t"])
            self.optimizer.state[key] = value, promoted, rate, (counter, m, v, None)
        self.trainable.weights = cast(mi.Float, self.optimizer["weights"])
