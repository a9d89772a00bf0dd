"""The training set of a network: many materials, the same number of samples each, decoded once and kept on disk.

What is decoded, and how many of each, is said by a list of sources (the ``data`` entry of a training configuration):

====================  =====================================================================================
``kind``              what it is
====================  =====================================================================================
``nps``               every material of an NPs file (MERL: 100 stand-ins for the measurements)
``nps-mixtures``      `count` new materials: random mixtures of two latents of that file, channels permuted; scaled to
                      an albedo drawn from ``"albedo": [low, high]``; with ``"warp": true`` times a random smooth factor
``nbrdf``             every material of an NBRDF file
``synthetic``         `count` anisotropic GGX with rotated tangents and the paper's noise
``two-lobes``         `count` materials with a sharp and a wide lobe, half of them anisotropic
``assorted``          `count` materials of assorted distributions, Fresnel colours, geometric and diffuse factors
``file``              one measured file that :func:`mi_enhance.data.loading.load` reads
====================  =====================================================================================
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np

from ..data import nbrdf, nps
from ..data.directions import cosine_hemisphere, sample_pairs
from ..data.loading import load, names
from ..data.measurements import Measurements
from ..data.random_terms import assorted
from ..data.synthetic import ggx_anisotropic, two_lobes
from ..system.files import digest, require_file
from .augmentation import warp
from .training_set import TrainingSet, _rows

# A fifth of MERL, aside for decisions while developing: every fifth material of the alphabetical list.
HELD_OUT_EVERY = 5
_NEEDED = {
    **dict.fromkeys(("nps", "nbrdf", "file"), ("path",)),
    "nps-mixtures": ("path", "count"),
    **dict.fromkeys(("synthetic", "two-lobes", "assorted"), ("count",)),
}
_MAX_COUNT = 1_000_000  # materials of a source: their samples would be terabytes long before


def sources_of(path: str | Path) -> list[dict]:
    """The sources, as :func:`build` takes them, of all materials in a file; a ``.json`` file lists sources itself."""
    where = f'training set "{path}"'
    path = require_file(path, where)
    if path.suffix == ".json":
        try:
            sources = json.loads(path.read_text())
        except ValueError as error:
            raise ValueError(f"{where}: no JSON ({error}).") from None
        if not (isinstance(sources, list) and all(isinstance(s, dict) and "kind" in s for s in sources)):
            raise ValueError(f'{where}: must be a list of sources, [{{"kind": "nps", "path": ...}}, ...].')
        return sources
    found = names(path)
    if len(found) == 1:
        return [{"kind": "file", "path": str(path)}]
    return [{"kind": "file", "path": str(path), "material": name} for name in found]


def build(sources: list[dict], *, n_samples: int, seed: int, cache: Path, progress: Callable = iter) -> TrainingSet:
    """Decode all materials of `sources`, or read them from `cache` if that has been done before.

    Parameters
    ----------
    sources : list of dict
        See the table above. ``path`` is a file, ``count`` a number; ``held_out`` (nps, nps-mixtures) is ``"without"``
        (leave every fifth material out), ``"only"`` (nothing else) or ``"all"`` (default).
    n_samples : int
        Samples per material.
    seed : int
        Of directions, mixtures and noise.
    cache : Path
        Folder for the decoded samples; the file name is a digest of everything that decides them.
    progress : callable
        Wraps the list of materials, e.g. ``tqdm``.

    Returns
    -------
    TrainingSet

    Raises
    ------
    ValueError
        For an unknown ``kind``; the message lists the choices.
    """
    key = json.dumps([3, sources, n_samples, seed], sort_keys=True)
    file = Path(cache) / f"training-{digest(key.encode())}.npz"
    if file.exists():
        return TrainingSet.read(file)
    per_source = [jobs_of(source, n_samples, seed + 1000 * k) for k, source in enumerate(sources)]
    kinds = [source["kind"] for source, jobs in zip(sources, per_source, strict=True) for _ in jobs]
    jobs = [job for some in per_source for job in some]
    samples = np.empty((9, len(jobs) * n_samples), np.float32)
    materials = []
    for k, job in enumerate(progress(jobs)):
        m = job()
        materials.append(m.name)
        samples[:, k * n_samples : (k + 1) * n_samples] = _rows(m, np.arange(n_samples))
    file.parent.mkdir(parents=True, exist_ok=True)
    training_set = TrainingSet(materials, kinds, samples, n_samples)
    training_set.save(file)
    return training_set


def jobs_of(source: dict, n: int, seed: int) -> list[Callable[[], Measurements]]:
    """One function per material of a source; each draws its own directions.

    Raises
    ------
    ValueError
        For a source that is none; the message shows it.
    """
    _check_source(source)
    kind = source.get("kind")
    if kind == "nps":
        names, latents, decoder = _nps(source)
        return [lambda k=k: _decoded(decoder, latents[k], names[k], n, seed + k) for k in range(len(names))]
    if kind == "nps-mixtures":
        names, latents, decoder = _nps(source)
        return [lambda k=k: _mixture(source, decoder, latents, n, seed + k) for k in range(source["count"])]
    if kind == "nbrdf":
        return [
            lambda k=k: nbrdf.read(source["path"], k, n_samples=n, seed=seed + k)
            for k in range(len(nbrdf.names(source["path"])))
        ]
    if kind == "synthetic":
        return [lambda k=k: ggx_anisotropic(seed + k, n)[0] for k in range(source["count"])]
    if kind == "two-lobes":
        return [lambda k=k: two_lobes(seed + k, n) for k in range(source["count"])]
    if kind == "assorted":
        return [lambda k=k: assorted(seed + k, n) for k in range(source["count"])]
    if kind == "file":
        return [lambda: load(source["path"], n_samples=n, seed=seed, material=source.get("material"))]
    raise ValueError(
        f'training set: kind "{kind}" is unknown. Choose one of: nps, nps-mixtures, nbrdf, synthetic, two-lobes, '
        "assorted, file."
    )


def _check_source(source: dict) -> None:
    """Raise unless what a source of its kind needs is there, and of the right type."""
    where, kind = f"training set: source {json.dumps(source)[:200]}", source.get("kind")
    for key in _NEEDED.get(kind, ()) if isinstance(kind, str) else ():
        if key not in source or (key == "path" and not isinstance(source[key], str)):
            raise ValueError(f"{where}: {key} is missing, or no text. A source of this kind needs it.")
    count, held_out, albedo = source.get("count", 1), source.get("held_out", "all"), source.get("albedo", [0, 1])
    if type(count) is not int or not 0 <= count <= _MAX_COUNT:
        raise ValueError(f"{where}: count must be a whole number up to {_MAX_COUNT:,}; got {str(count)[:40]}.")
    if held_out not in ("all", "without", "only"):
        raise ValueError(f'{where}: held_out must be "all", "without" or "only"; got {str(held_out)[:40]}.')
    if not (isinstance(albedo, list) and len(albedo) == 2 and all(type(v) in (int, float) for v in albedo)):
        raise ValueError(f"{where}: albedo must be [low, high]; got {str(albedo)[:40]}.")


def _nps(source: dict):
    names, latents = nps.read_latents(source["path"])
    decoder = nps.read_decoder(Path(source["path"]).with_name("decoder.npz"))
    held_out = np.arange(len(names)) % HELD_OUT_EVERY == HELD_OUT_EVERY - 1
    keep = {"all": held_out | True, "without": ~held_out, "only": held_out}[source.get("held_out", "all")]
    return [n for n, k in zip(names, keep, strict=True) if k], latents[keep], decoder


def _decoded(decoder: dict, latent: np.ndarray, name: str, n: int, seed: int, order=(0, 1, 2)) -> Measurements:
    wi, wo = sample_pairs(n, seed=seed)
    return Measurements(wi, wo, nps.decode(decoder, latent, wi, wo)[:, list(order)], name, "NPs")


def _mixture(source: dict, decoder: dict, latents: np.ndarray, n: int, seed: int) -> Measurements:
    rng = np.random.default_rng(seed)
    a, b = rng.choice(len(latents), 2, replace=False)
    t = rng.random()
    latent, order = (1 - t) * latents[a] + t * latents[b], rng.permutation(3)
    m = _decoded(decoder, latent, f"mixture_{seed}", n, seed, order)
    f = m.f * warp(m.wi, m.wo, seed) if source.get("warp") else m.f
    if "albedo" in source:
        wi, wo = np.tile((0.0, 0.0, 1.0), (512, 1)), cosine_hemisphere(512)
        albedo = np.pi * nps.decode(decoder, latent, wi, wo).mean(0).max()
        # 30: a black material is not all specks of the decoder, however dark
        f = f * min(rng.uniform(*source["albedo"]) / max(albedo, 1e-6), 30)
    return Measurements(m.wi, m.wo, np.minimum(f, 1e4), m.name, m.source)
