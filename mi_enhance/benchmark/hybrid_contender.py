"""The hybrid of :mod:`mi_enhance.benchmark.hybrid` as a model of a benchmark, with its network trained in two ways.

The bundled network never saw the files, like ours. Its authors train one network on the very materials that they judge
it by, so there is one of all files of a benchmark, too.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from pathlib import Path

import mitsuba as mi
import numpy as np

from ..data.measurements import Measurements
from ..material.material import Material
from ..system.cache import cached
from ..system.files import digest
from ..system.progress import Callback, silent
from ..training.training_set import gather
from . import hybrid_fit
from .contender import Contender
from .hybrid import train_hybrid

HYBRID = "hybrid of 2026, network never saw the files"
HYBRID_OF_FILES = "hybrid of 2026, network trained on the files"
_STEPS, _SAMPLES_OF_A_STEP = 8000, 2048
_MOST_SAMPLES = 50_000  # of a material


def fit_to_file(path: Path, lobe: Material, measurements: Measurements, seed: int) -> None:
    """Fit the numbers of a material to the bundled network, and write them."""
    u, seconds = hybrid_fit.fit_hybrid(lobe, measurements, seed=seed)
    np.savez(path, u=u[None], seconds=seconds + lobe.report["seconds"])


def hybrid_of_file(file: Path, lobe: Path, *, network: Path | None = None, row: int = 0) -> Contender:
    """Return the model of the numbers in a row of `file`, of the bundled network or another."""
    with np.load(file, allow_pickle=False) as stored:
        seconds = float(stored["seconds"])
    spec = {"type": "hybrid", "numbers": str(file), "row": row, "lobe": str(lobe)}
    if network:
        spec["network"] = str(network)
    own, shared = 4 * hybrid_fit.N_NUMBERS, 4 * hybrid_fit.N_WEIGHTS
    return Contender(_load, spec, own, shared, hybrid_fit.MULTIPLY_ADDS, seconds)


def hybrids_of_files(
    lobes: Sequence[Contender],
    measured: Sequence[Measurements],
    folder: Path,
    *,
    steps: int = _STEPS,
    seed: int = 0,
    progress: Callback = silent,
) -> list[Contender]:
    """Train one network on all files, together with the numbers of their materials, or read what is in `folder`.

    Parameters
    ----------
    lobes : sequence of Contender
        GGX as fitted to each.
    measured : sequence of Measurements
    folder : Path
    steps : int
        Each of 2,048 samples: 8,000 are half a minute of one core.
    seed : int
    progress : callable
    """
    file = folder / f"hybrid_{digest(*(part for m in measured for part in (m.wi, m.wo, m.f)))}.npz"

    def train() -> Mapping:
        begun = time.perf_counter()
        params = [Material.load(lobe.spec["filename"]).params for lobe in lobes]
        samples = gather(list(measured), min(_MOST_SAMPLES, max(len(m.f) for m in measured)), seed)
        network, u = train_hybrid(
            samples,
            np.stack([hybrid_fit.start_of(p) for p in params]),
            file.with_suffix(".checkpoint.npz"),
            steps=steps,
            per_material=max(1, _SAMPLES_OF_A_STEP // len(measured)),
            seed=seed,
            progress=progress,
        )
        return {**network, "u": u, "seconds": (time.perf_counter() - begun) / len(measured)}

    cached(file, train, lambda _: {}, lambda path, arrays: np.savez(path, **arrays))
    return [hybrid_of_file(file, lobe.spec["filename"], network=file, row=k) for k, lobe in enumerate(lobes)]


def _load(spec: dict) -> mi.BSDF:
    from ..bsdfs.function import function_bsdf

    network, _ = hybrid_fit.read_network(Path(spec["network"]) if "network" in spec else None)
    with np.load(spec["numbers"], allow_pickle=False) as stored:
        f = hybrid_fit.hybrid_function(network, stored["u"][spec["row"]].astype(np.float64))
    return function_bsdf(f, Material.load(spec["lobe"]))
