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
``thin-film``         `count` iridescent materials: interference films, half of them with flakes
``coated``            `count` materials under a sharp clear coat, often tinted
``near-mirror``       `count` polished metals, roughness 0.003 to 0.03, with haze
``cloth``             `count` materials with the sheen of fibres that stand up
``retro``             `count` materials that send light back where it came from
``anisotropic``       `count` brushed materials, up to 20 times as rough along one axis
``file``              one measured file that :func:`mi_enhance.data.loading.load` reads
====================  =====================================================================================

All that are made up by formulas, ``synthetic`` to ``anisotropic``, take ``"peaks": share``: that share of the samples
of each material, 0 (default) to 1, has its half vector in the highlight, which uniform samples hardly see.
"""

from __future__ import annotations

import functools
import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..data import made_up, nbrdf, nps
from ..data.directions import cosine_hemisphere, sample_pairs
from ..data.loading import load, names
from ..data.measurements import Measurements
from ..data.random_terms import assorted
from ..data.synthetic import ggx_anisotropic, two_lobes
from ..system.cache import cached
from ..system.files import digest, require_file
from ..system.messages import did_you_mean, shortened
from ..system.progress import Callback, Progress, silent
from ..system.settings import FLAG, TEXT, Rule, check, one_of, refuse_unknown, whole
from .augmentation import warp
from .training_set import TrainingSet, rows_of

# A fifth of MERL, aside for decisions while developing: every fifth material of the alphabetical list.
HELD_OUT_EVERY = 5
# Added to the seed of materials to judge by: made-up ones must not be those of the training. A source of a list has
# 1,000 more than the one before.
UNSEEN_SEED = 10**7
_MAX_COUNT = 1_000_000  # materials of a source: their samples would be terabytes long before

Source = Mapping[str, Any]
Job = Callable[[], Measurements]


def sources_of(path: str | Path) -> list[dict]:
    """Return the sources, as `build` takes them, of all materials in a file; a ``.json`` file lists sources itself.

    Raises
    ------
    ValueError, OSError
        If the file is no list of sources, or cannot be read.
    """
    where = f'training set "{path}"'
    file = require_file(path, where)
    if file.suffix == ".json":
        try:
            sources = json.loads(file.read_text())
        except ValueError as error:
            raise ValueError(f"{where}: no JSON ({error}).") from None
        if not (isinstance(sources, list) and all(isinstance(s, dict) and "kind" in s for s in sources)):
            raise ValueError(f'{where}: must be a list of sources, [{{"kind": "nps", "path": ...}}, ...].')
        return sources
    found = names(path)
    if len(found) == 1:
        return [{"kind": "file", "path": str(path)}]
    return [{"kind": "file", "path": str(path), "material": name} for name in found]


def build(
    sources: Sequence[Source], *, n_samples: int, seed: int, cache: Path, progress: Callback = silent
) -> TrainingSet:
    """Decode all materials of `sources`, or read them from `cache` if that has been done before.

    Parameters
    ----------
    sources : sequence of dict
        See the table above. ``path`` is a file, ``count`` a number; ``held_out`` (nps, nps-mixtures) is ``"without"``
        (leave every fifth material out), ``"only"`` (nothing else) or ``"all"`` (default).
    n_samples : int
        Samples per material.
    seed : int
        Of directions, mixtures and noise.
    cache : Path
        Folder for the decoded samples; the file name is a digest of everything that decides them.
    progress : callable
        Hears of every material, see :mod:`mi_enhance.system.progress`.

    Returns
    -------
    TrainingSet

    Raises
    ------
    ValueError
        For an unknown ``kind``, or a source with a wrong entry; the message lists what is allowed.
    """

    def decode() -> TrainingSet:
        per_source = [jobs_of(source, n_samples, seed + 1000 * k) for k, source in enumerate(sources)]
        kinds = [source["kind"] for source, jobs in zip(sources, per_source, strict=True) for _ in jobs]
        jobs = [job for some in per_source for job in some]
        samples = np.empty((9, len(jobs) * n_samples), np.float32)
        materials = []
        for k, job in enumerate(jobs):
            m = job()
            materials.append(m.name)
            samples[:, k * n_samples : (k + 1) * n_samples] = rows_of(m, np.arange(n_samples))
            progress(Progress("decode", k + 1, len(jobs)))
        return TrainingSet(materials, kinds, samples, n_samples)

    key = json.dumps([3, sources, n_samples, seed], sort_keys=True)
    file = Path(cache) / f"training-{digest(key.encode())}.npz"
    return cached(file, decode, TrainingSet.read, lambda path, training_set: training_set.save(path))


def jobs_of(source: Source, n: int, seed: int) -> list[Job]:
    """Return one function per material of a source; each draws its own directions.

    Raises
    ------
    ValueError
        For a source that is none; the message shows it.
    """
    kind = source.get("kind")
    if not isinstance(kind, str) or kind not in _KINDS:
        raise ValueError(
            f'training set: kind "{kind}" is unknown. Choose one of: {", ".join(_KINDS)}.{did_you_mean(kind, _KINDS)}'
        )
    jobs, needed, optional = _KINDS[kind]
    where = f"training set: source {shortened(dict(source), 200)}"
    refuse_unknown(source, ("kind", *needed, *optional), where)
    for name in needed:
        if name not in source:
            raise ValueError(f"{where}: {name} is missing. A source of this kind needs it.")
    check(source, _RULES, where)
    return jobs(source, n, seed)


def _from_nps(source: Source, n: int, seed: int) -> list[Job]:
    names, latents, decoder = _nps(source)
    return [functools.partial(_decoded, decoder, latents[k], names[k], n, seed + k) for k in range(len(names))]


def _mixtures(source: Source, n: int, seed: int) -> list[Job]:
    _, latents, decoder = _nps(source)
    return [functools.partial(_mixture, source, decoder, latents, n, seed + k) for k in range(source["count"])]


def _from_nbrdf(source: Source, n: int, seed: int) -> list[Job]:
    path = source["path"]
    return [functools.partial(nbrdf.read, path, k, n_samples=n, seed=seed + k) for k in range(len(nbrdf.names(path)))]


def _from_file(source: Source, n: int, seed: int) -> list[Job]:
    return [functools.partial(load, source["path"], n_samples=n, seed=seed, material=source.get("material"))]


Kind = tuple[Callable[[Source, int, int], list[Job]], tuple[str, ...], tuple[str, ...]]


def _made_up(draw: Callable[..., Measurements]) -> Kind:
    """Return the kind whose materials ``draw(seed, n, peaks=share)`` makes up."""

    def jobs(source: Source, n: int, seed: int) -> list[Job]:
        peaks = source.get("peaks", 0)
        return [functools.partial(draw, seed + k, n, peaks=peaks) for k in range(source["count"])]

    return jobs, ("count",), ("peaks",)


# kind: its jobs, what it needs, what it may have
_KINDS: dict[str, Kind] = {
    "nps": (_from_nps, ("path",), ("held_out",)),
    "nps-mixtures": (_mixtures, ("path", "count"), ("held_out", "albedo", "warp")),
    "nbrdf": (_from_nbrdf, ("path",), ()),
    "synthetic": _made_up(lambda seed, n, peaks: ggx_anisotropic(seed, n, peaks=peaks)[0]),
    "two-lobes": _made_up(two_lobes),
    "assorted": _made_up(assorted),
    **{kind: _made_up(functools.partial(made_up.measured, kind)) for kind in made_up.KINDS},
    "file": (_from_file, ("path",), ("material",)),
}


def _is_range(value: Any) -> bool:
    return isinstance(value, (list, tuple)) and len(value) == 2 and all(type(v) in (int, float) for v in value)


_RULES = {
    "path": TEXT,
    "count": whole(0, _MAX_COUNT),
    "held_out": one_of("all", "without", "only"),
    "albedo": Rule("[low, high]", _is_range),
    "warp": FLAG,
    "peaks": Rule("a number from 0 to 1", lambda v: type(v) in (int, float) and 0 <= v <= 1),
    "material": Rule("a name, or null", lambda v: v is None or isinstance(v, str)),
}


def _nps(source: Source) -> tuple[list[str], np.ndarray, dict]:
    names, latents = nps.read_latents(source["path"])
    decoder = nps.read_decoder(Path(source["path"]).with_name("decoder.npz"))
    held_out = np.arange(len(names)) % HELD_OUT_EVERY == HELD_OUT_EVERY - 1
    keep = {"all": held_out | True, "without": ~held_out, "only": held_out}[source.get("held_out", "all")]
    return [n for n, k in zip(names, keep, strict=True) if k], latents[keep], decoder


def _decoded(decoder: dict, latent: np.ndarray, name: str, n: int, seed: int, order=(0, 1, 2)) -> Measurements:
    wi, wo = sample_pairs(n, seed=seed)
    return Measurements(wi, wo, nps.decode(decoder, latent, wi, wo)[:, list(order)], name, "NPs")


def _mixture(source: Source, decoder: dict, latents: np.ndarray, n: int, seed: int) -> Measurements:
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
