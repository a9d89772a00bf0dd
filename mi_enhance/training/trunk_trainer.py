"""One step of the training of a shared trunk, together with the read-outs of all materials."""

from __future__ import annotations

from typing import ClassVar, cast

import drjit as dr
import mitsuba as mi
import numpy as np

from ..analytic import parameter_space
from ..neural.enhance import FIRST_ASYMMETRY, first_latent
from ..neural.enhanced_brdf import EnhancedBRDF
from ..neural.trunk import Trunk
from .settings import TrainingSettings
from .trainer import Trainer
from .training_set import TrainingSet
from .trunk_gradient import TrunkGradient

# Of the mean square of the numbers of a read-out: holds those that the samples of a material say nothing about.
_RIDGE = 1e-4
# A material counts by 1 / sqrt(analytic loss), this at least: a near-mirror, whose peak is off by a factor, would drown
# the others, and what the analytic model meets already has nothing to teach.
_LEAST_LOSS = 3e-3
_FIRST = 8  # batches that tell the analytic loss


class TrunkTrainer(Trainer):
    """State of a training: trunk, parameters and read-outs of every material, optimizer; see :class:`Trainer`.

    `settings.lr_read_out` is the learning rate of the read-outs.
    """

    keys: ClassVar[tuple[str, ...]] = ("weights", "parameters", "read_out")

    def __init__(self, brdf: EnhancedBRDF, samples: TrainingSet, settings: TrainingSettings, start: np.ndarray):
        trunk = cast(Trunk, brdf.trunk)
        n = brdf.n_parameters - trunk.size  # the read-out comes last, and has an optimizer of its own
        names = [p.name for p in brdf.parameters for _ in range(p.size)]
        start = start.copy()
        start[:, [k for k, name in enumerate(names) if name == "latent"]] = first_latent(brdf, start)
        start[:, names.index("asymmetry")] = FIRST_ASYMMETRY
        super().__init__(brdf, samples, settings, start[:, :n])
        self._gradient = TrunkGradient(brdf, self.n_materials, settings.batch, self.trainable)
        self._counts: mi.Float | None = None
        self.optimizer["read_out"] = dr.zeros(mi.Float, self.n_materials * trunk.size)

    def _space_of(self, brdf: EnhancedBRDF) -> parameter_space.Space:
        return parameter_space.Space(brdf.parameters[:-1])

    def _read_outs(self) -> np.ndarray:
        return np.array(dr.detach(self.optimizer["read_out"])).reshape(self.n_materials, -1)

    def _importance(self) -> mi.Float:
        """Return how much every material counts, from its loss at the analytic start."""
        if self._counts is None:
            flat = self._start.T.ravel().astype(np.float32).tolist()
            read, ones = np.zeros_like(self._read_outs()), dr.opaque(mi.Float, 1, self.n_materials)
            losses: list = []
            for step in range(_FIRST):
                weights, index = mi.Float(dr.detach(self.optimizer["weights"])), self._indices(step)
                losses.append(self._gradient(weights, mi.Float(flat), read, self._data, index, ones)[0])
            count = np.maximum(np.mean(losses, 0), _LEAST_LOSS) ** -0.5
            self._counts = mi.Float((count / count.mean()).tolist())
            self.trainable.take()
        return self._counts

    def advance(self) -> np.ndarray:
        """Take one step and return the loss of every material before it."""
        weights, flat = (mi.Float(dr.detach(self.optimizer[key])) for key in ("weights", "parameters"))
        read = self._read_outs()
        loss, params, read_gradient = self._gradient(
            weights, flat, read, self._data, self._indices(self.step), self._importance()
        )
        read_gradient = read_gradient + (2 * _RIDGE / read.size) * read
        rates = (self.settings.lr, self.settings.lr_parameters, self.settings.lr_read_out)
        gradients = (self.trainable.gradient(), params, mi.Float(read_gradient.ravel()))
        self._descend(rates, gradients, self.settings.steps)
        self.trainable.weights = cast(mi.Float, self.optimizer["weights"])
        return loss

    def refit(self) -> None:
        """Do nothing: read-outs start at the analytic model, and steps of all materials at once are not noisy."""

    def parameters(self) -> np.ndarray:
        """Return the physical parameters of all materials, array (M, n_parameters), float64."""
        return np.concatenate([super().parameters(), self._read_outs()], axis=1)
