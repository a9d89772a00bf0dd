"""Samples of many materials in one record."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import mitsuba as mi
import numpy as np

from ..data.measurements import Measurements
from ..numerics.arrays import color3f, vector3f
from ..system import npz
from ..system.files import replacing


@dataclass(frozen=True, eq=False)
class TrainingSet:
    """Samples of M materials, S each.

    Parameters
    ----------
    names, kinds : list of M str
        Materials, and the source kind each came from.
    samples : array (9, M * S), float32
        Rows wi (3), wo (3), f (3); the samples of a material are consecutive and in random order.
    n_samples : int
        S.
    """

    names: list[str]
    kinds: list[str]
    samples: np.ndarray
    n_samples: int

    def material(self, k: int) -> Measurements:
        """Return the samples of material `k`."""
        part = self.samples[:, k * self.n_samples : (k + 1) * self.n_samples].T
        return Measurements(part[:, :3], part[:, 3:6], part[:, 6:], self.names[k], "training set")

    def split(self, n: int) -> tuple[TrainingSet, TrainingSet]:
        """Return the first `n` samples of every material, and the rest."""
        rows = self.samples.reshape(9, -1, self.n_samples)
        first, rest = (np.ascontiguousarray(part.reshape(9, -1)) for part in (rows[:, :, :n], rows[:, :, n:]))
        return (
            TrainingSet(self.names, self.kinds, first, n),
            TrainingSet(self.names, self.kinds, rest, self.n_samples - n),
        )

    def save(self, path: Path) -> None:
        """Write one file, replaced as a whole."""
        with replacing(path) as temporary:
            np.savez(temporary, names=np.array(self.names), kinds=np.array(self.kinds), samples=self.samples)

    @staticmethod
    def read(path: Path) -> TrainingSet:
        """Read what :meth:`save` has written.

        Raises
        ------
        ValueError
            If the file is damaged.
        """
        where = f'training set "{path}"'
        stored = npz.read(path, ["names", "kinds", "samples"], where)
        names, kinds = (npz.words(stored, key, where) for key in ("names", "kinds"))
        shape = stored["samples"].shape
        n = shape[-1] // len(names) if shape else 0
        samples = npz.numbers(stored, "samples", (9, n * len(names)), where)
        if n == 0 or len(kinds) != len(names):
            raise ValueError(f"{where}: {len(names)} names, {len(kinds)} kinds, samples {shape}. Remove the file.")
        return TrainingSet(names, kinds, samples, n)


def gather(materials: list[Measurements], n_samples: int, seed: int) -> TrainingSet:
    """Return a training set of measurements at hand: `n_samples` of each at random, repeated where there are fewer."""
    rng = np.random.default_rng(seed)
    order = [rng.permutation(len(m.f)) for m in materials]
    rows = [rows_of(m, np.resize(index, n_samples)) for m, index in zip(materials, order, strict=True)]
    return TrainingSet([m.name for m in materials], ["given"] * len(materials), np.concatenate(rows, axis=1), n_samples)


def rows_of(m: Measurements, index: np.ndarray) -> np.ndarray:
    """Return wi, wo, f of the samples `index` as rows (9, N), from the start again where a table has fewer."""
    return np.concatenate([m.wi, m.wo, m.f], axis=1)[index % len(m.f)].T


def first_samples(
    samples: TrainingSet, n: int, materials: slice = slice(None)
) -> tuple[mi.Vector3f, mi.Vector3f, mi.Color3f]:
    """Return wi, wo and f of the first n samples of the materials, as Dr.Jit arrays."""
    rows = samples.samples.reshape(9, -1, samples.n_samples)[:, materials, :n].reshape(9, -1)
    return vector3f(rows[:3].T), vector3f(rows[3:6].T), color3f(rows[6:].T)
