"""The basis of a trained trunk: the few directions in which read-outs of materials differ most, to the eye of the loss.

Trunk and training materials are there; codes, basis and parameters of the materials are trained together, from
principal directions of the read-outs. Plain ones would not do: what counts is how much a read-out changes the loss.
"""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar, cast

import drjit as dr
import mitsuba as mi
import numpy as np

from ..material.low_rank import LowRank, with_basis
from ..material.material import Material
from ..neural.mlp import MLP, flatten
from ..neural.trunk import Trunk
from ..system.files import digest
from ..system.progress import Callback, Progress, silent
from ..system.run_folder import keep_settings
from .analytic_start import representative
from .trainer import Trainer
from .trunk_gradient import TrunkGradient
from .trunk_trainer import TrunkTrainer

_RATES = {"parameters": 2e-3, "code": 5e-3, "basis": 2e-3}
_RIDGE = 1e-5  # of the mean square of the codes: holds those that the samples of a material say nothing about
_WARM_UP = 50
_LOOKED_AT = 8  # batches that tell how much the units of a slot change the loss
_EVERY = 100  # steps from checkpoint to checkpoint


class BasisTrainer(TrunkTrainer):
    """State of a training: codes, basis and parameters of every material, optimizer; see :class:`Trainer`.

    Parameters
    ----------
    trained : TrunkTrainer
        With a trained trunk, which stays as it is.
    rank : int
        Numbers of a code for each slot.
    steps : int
        Of the training.
    """

    keys: ClassVar[tuple[str, ...]] = ("parameters", "code", "basis")

    def __init__(self, trained: TrunkTrainer, rank: int, steps: int):
        brdf, trunk = trained.result(), cast(Trunk, trained.brdf.trunk)
        start = trained.parameters()
        super().__init__(brdf, trained.samples, trained.settings, start)
        flat = self._space.to_free(start[:, : -trunk.size]).T.ravel()
        self.optimizer["parameters"] = mi.Float(flat.astype(np.float32).tolist())
        self._gradient = TrunkGradient(brdf, self.n_materials, self.settings.batch, self.trainable, fixed=True)
        # a copy: while a function is recorded, no memory of NumPy may be set free
        self.trainable.weights = mi.Float(np.array(dr.detach(self.trainable.weights)).tolist())
        self.rank, self.steps, self.slots = rank, steps, len(trunk.slots)
        self._counts = trained._importance()
        codes, basis = self._principal(start[:, -trunk.size :])
        self.optimizer["code"], self.optimizer["basis"] = mi.Float(codes.ravel()), mi.Float(basis.ravel())

    def _arrays(self) -> tuple[np.ndarray, np.ndarray]:
        """Return codes (M, slots, rank) and basis (slots, rank, numbers of a slot)."""
        code, basis = (np.array(dr.detach(self.optimizer[key]), np.float64) for key in ("code", "basis"))
        return code.reshape(self.n_materials, self.slots, -1), basis.reshape(self.slots, self.rank, -1)

    def _read_outs(self) -> np.ndarray:
        return np.einsum("msr,srk->msk", *self._arrays()).reshape(self.n_materials, -1).astype(np.float32)

    def _step(self, index: int) -> tuple[tuple[mi.Float, mi.Float], tuple[list[mi.Float], mi.UInt32, mi.Float]]:
        """Return the arguments of :class:`TrunkGradient` but for the read-outs, before and after them."""
        weights, flat = mi.Float(self.trainable.weights), mi.Float(dr.detach(self.optimizer["parameters"]))
        return (weights, flat), (self._data, self._indices(index), self._importance())

    def _principal(self, read: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return codes and basis: directions in which the squares of read-outs, weighted by the loss, are largest."""
        trunk, m = cast(Trunk, self.brdf.trunk), self.n_materials
        k, channels = trunk.n_units + 1, trunk.channels
        metric = np.zeros((m, self.slots, k, k))
        for step in range(_LOOKED_AT):
            before, after = self._step(step)
            *_, phi, dy = self._gradient.to_logs(*before, read.astype(np.float32), *after)
            seen = np.append(phi, np.ones_like(phi[:, :1]), 1)
            size = np.abs(dy).reshape(m, self.slots, channels, -1).sum(2)
            for s in range(self.slots):
                metric[:, s] += np.matmul(seen * size[:, s, None], seen.transpose(0, 2, 1))
        codes, basis = np.zeros((m, self.slots, self.rank)), np.zeros((self.slots, self.rank, k * channels))
        for s in range(self.slots):
            weight = np.sqrt(np.trace(metric[:, s], axis1=1, axis2=2))[:, None]
            mean = metric[:, s].sum(0) / (weight**2).sum()
            # 1e-3: units that nothing tells apart
            values, vectors = np.linalg.eigh(mean + 1e-3 * np.trace(mean) / k * np.eye(k))
            rows = read[:, trunk.numbers_of(trunk.slots[s])].reshape(m, channels, k)
            seen = (rows @ vectors * np.sqrt(values)).reshape(m, -1)
            _, _, directions = np.linalg.svd(weight * seen, full_matrices=False)
            found = directions[: self.rank]
            codes[:, s] = seen @ found.T
            size = np.sqrt(np.square(codes[:, s]).mean(0))
            codes[:, s] /= size
            back = (found.reshape(-1, channels, k) / np.sqrt(values)) @ vectors.T
            basis[s] = back.reshape(self.rank, -1) * size[:, None]
        return codes.astype(np.float32), basis.astype(np.float32)

    def advance(self) -> np.ndarray:
        """Take one step and return the loss of every material before it."""
        codes, basis = self._arrays()
        (weights, flat), (data, index, counts) = self._step(self.step)
        loss, params, read = self._gradient(weights, flat, self._read_outs(), data, index, counts)
        read = read.reshape(self.n_materials, self.slots, -1).astype(np.float64)
        of_codes = np.einsum("msk,srk->msr", read, basis) + (2 * _RIDGE / codes.size) * codes
        of_basis = np.einsum("msk,msr->srk", read, codes)
        gradients = params, *(mi.Float(g.ravel().astype(np.float32).tolist()) for g in (of_codes, of_basis))
        self._descend(_RATES.values(), gradients, self.steps, _WARM_UP)
        return loss

    def low_rank(self) -> LowRank:
        """Return the basis, for codes of mean square 1, and the training materials from which fits start."""
        trunk = cast(Trunk, self.brdf.trunk)
        codes, basis = self._arrays()
        size = np.sqrt(np.square(codes).mean(0))
        codes, rows = codes / size, (basis * size[:, :, None]).reshape(-1, trunk.n_units + 1).astype(np.float32)
        layer = np.ascontiguousarray(rows[:, :-1]), np.ascontiguousarray(rows[:, -1])
        mlp = MLP((layer,))
        n = self.parameters().shape[1] - trunk.size
        norms = np.zeros((self.n_materials, self.slots * trunk.channels))
        library = np.concatenate([self.parameters()[:, :n], norms, codes.reshape(self.n_materials, -1)], axis=1)
        kept = library[representative(self.samples.kinds)]
        own = with_basis(self.brdf, mlp).parameters
        low, high = (np.concatenate([np.full(p.size, getattr(p, end)) for p in own]) for end in ("low", "high"))
        return LowRank(mlp, np.clip(kept, low, high))


def train_basis(
    trained: Trainer, folder: str | Path, *, rank: int = 16, steps: int = 2000, progress: Callback = silent
) -> Material:
    """Train a basis for a trained trunk, or go on where an earlier run stopped.

    Parameters
    ----------
    trained : Trainer
        With a trunk, from :func:`mi_enhance.training.train.train`, of the same folder.
    folder : str or Path
        Keeps ``basis.npz``, the state. ``network.bsdf`` gets the basis.
    rank : int
        Numbers of a code for each slot.
    steps : int
        Of all materials, with the samples and the batch of the training of the trunk.
    progress : callable
        Hears of every step, with the mean ``loss`` since the last checkpoint.

    Returns
    -------
    Material
        The network, with free read-outs and the basis for those of low rank.

    Raises
    ------
    ValueError
        For a rank below 1, or a state of another rank, of other steps or for another trunk.
    """
    if rank < 1 or not isinstance(trained, TrunkTrainer):
        raise ValueError(
            f"train_basis(): rank is {rank}, of a {type(trained).__name__}; needed: 1 or more, of a trunk."
        )
    folder = Path(folder)
    checkpoint = folder / "basis.npz"
    trunk = digest(flatten(trained.result().networks))
    settings = {"rank": rank, "steps": steps, "trunk": trunk}
    keep_settings(folder / "basis.json", settings, "train_basis()", begun=checkpoint.exists())
    trainer = BasisTrainer(trained, rank, steps)
    if checkpoint.exists():
        trainer.resume(checkpoint)
    losses: list[float] = []
    mean = float("nan")
    while trainer.step < steps:
        losses.append(float(trainer.advance().mean()))
        if trainer.step % _EVERY == 0 or trainer.step == steps:
            trainer.save(checkpoint)
            mean, losses = float(np.mean(losses)), []
        progress(Progress("basis", trainer.step, steps, {"loss": mean}))
    network = trained.material()
    report = {**network.report, "basis": {"rank": rank, "steps": steps}}
    network = Material(network.brdf, {}, report, library=network.library, low_rank=trainer.low_rank())
    network.save(folder / "network.bsdf")
    return network
