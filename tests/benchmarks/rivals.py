"""The models that the accuracy benchmarks hold against each other: one call fits any of them, and remembers the fit.

A fit is kept in a file whose name holds a digest of everything that decides it: the samples, the network's own file,
the method, the seed. So an interrupted run goes on, and a model that is added later does not refit the others. Code is
not part of the digest: delete the folder after a change of the fit.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

import mi_enhance  # noqa: F401  (first: it finds the LLVM that Dr.Jit then loads)
from mi_enhance import Material, fit, fit_best, models
from mi_enhance.analytic import parameters
from mi_enhance.benchmark import nbrdf as models_of_others
from mi_enhance.data import nbrdf, nps
from mi_enhance.data.measurements import Measurements
from mi_enhance.system.bundled_files import DEFAULT_NETWORK, network_file
from mi_enhance.system.files import replacing

REFERENCE = "ggx"  # all ratios are to this one


class Fitted(NamedTuple):
    """A model that was fitted to one material."""

    evaluate: Callable  # (wi, wo) -> f_r, arrays (N, 3)
    seconds: float | None  # of the fit; None where somebody else made it
    n_parameters: int  # floats that belong to this material alone
    shared_bytes: int  # of what all materials have in common, as float32
    multiply_adds: int  # of all networks in one evaluation, after what is constant for a material was folded
    material: Material | None = None  # where it is one of ours


class Rival(NamedTuple):
    """A model to be fitted."""

    label: str
    key: list  # what decides the fit besides the samples, as JSON
    run: Callable  # (measurements, path without suffix of the file to keep) -> Fitted, or None if it has none

    def fit(self, measurements: Measurements, folder: Path) -> Fitted | None:
        """Fit, or read what an earlier call has left in `folder`."""
        return self.run(measurements, self.stem(measurements, folder))

    def stem(self, measurements: Measurements, folder: Path) -> Path:
        """Path without suffix of all files about this model and these samples."""
        digest = hashlib.sha256(json.dumps(self.key).encode())
        for a in (measurements.wi, measurements.wo, measurements.f):
            digest.update(a.tobytes())
        return Path(folder) / f"{re.sub('[^a-z0-9]+', '_', self.label.lower())}-{digest.hexdigest()[:12]}"


def kept(path: Path, compute: Callable) -> dict:
    """What `compute` returns, from the JSON file `path` if an earlier run has written it."""
    if not path.exists():
        result = json.dumps(compute(), indent=1)
        with replacing(path) as temporary:
            Path(temporary).write_text(result)
    return json.loads(path.read_text())


def ours(args) -> list[Rival]:
    """The analytic models and networks that the options of `add_options` ask for, the reference first."""
    names = [REFERENCE, *(name for name in args.analytic or models.MODELS if name != REFERENCE)]
    rivals = [
        Rival(name, ["analytic", name, args.method, args.seed], _run_material(Material.analytic(name), args))
        for name in names
    ]
    shipped = sorted(path.stem for path in network_file("ggx").parent.glob("*.bsdf"))
    for name in args.network or shipped:
        path = Path(name) if name.endswith(".bsdf") else network_file(name)
        digest = hashlib.sha256(path.read_bytes()).hexdigest()
        run = _run_material(Material.load(path), args)
        rivals.append(Rival(f"enhanced {path.stem}", ["network", digest, args.method, args.seed], run))
    for size in args.own or ():
        label, key = f"own network {size}-{size}", ["own", size, DEFAULT_NETWORK, args.seed]
        rivals.append(Rival(label, key, _run_own(size, args)))
    if len({r.label for r in rivals}) < len(rivals):
        raise SystemExit("two networks have the same file name; rename one: the name is their label.")
    return rivals


def add_options(parser) -> None:
    """Options that all benchmarks over `ours` share."""
    parser.add_argument("--analytic", action="append", metavar="NAME", help="repeatable (default: every model)")
    parser.add_argument(
        "-m", "--network", action="append", help="shipped network or file, repeatable (default: every shipped one)"
    )
    parser.add_argument(
        "--own", action="append", type=int, metavar="SIZE", help="a network of each material's own, repeatable"
    )
    parser.add_argument("--method", default="lm", choices=("lm", "rmsprop"))
    parser.add_argument("--samples", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=0)


def nbrdf_trained(seed: int) -> Rival:
    """NBRDF, trained by us on the samples that the others are fitted to."""

    def run(measurements, stem):
        path = stem.with_suffix(".npz")
        if not path.exists():
            network, seconds = models_of_others.train_nbrdf(measurements, seed=seed)
            arrays = {key: w[None] for key, w in network.items()}  # a file that mi_enhance.data reads
            with replacing(path) as temporary:
                np.savez(temporary, names=np.array([measurements.name]), seconds=seconds, **arrays)
        with np.load(path) as stored:
            network = {key: stored[key][0] for key in stored if key[0] in "Wb"}
            return _nbrdf(network, float(stored["seconds"]), measurements.f.max())

    return Rival("NBRDF trained", ["nbrdf trained", models_of_others.train_nbrdf.__kwdefaults__, seed], run)


def nbrdf_authors(path) -> Rival:
    """NBRDF as its authors trained it on the whole files, by name of the material."""
    names, networks = nbrdf.read_networks(path)

    def run(measurements, _):
        if measurements.name not in names:
            return None
        return _nbrdf({key: w[names.index(measurements.name)] for key, w in networks.items()}, None, np.inf)

    return Rival("NBRDF authors", ["nbrdf authors", _digest(path)], run)


def nps_authors(path) -> Rival:
    """NPs: the authors' latents of RGL materials by name, and ``decoder.npz`` beside them."""
    names, latents = nps.read_latents(path)
    decoder = nps.read_decoder(Path(path).with_name("decoder.npz"))
    weights = [decoder[f"W{i}"] for i in range(1, 8)]
    latent_inputs = latents.shape[1] * weights[0].shape[1]

    def run(measurements, _):
        if measurements.name not in names:
            return None
        latent = latents[names.index(measurements.name)]

        def evaluate(wi, wo):
            return nps.decode(decoder, latent, wi, wo, with_cosine=True)  # as the authors encoded RGL

        shared = 4 * sum(w.size for w in decoder.values())
        return Fitted(evaluate, None, len(latent), shared, sum(w.size for w in weights) - latent_inputs)

    return Rival("NPs", ["nps", _digest(path)], run)


def _run_own(size: int, args) -> Callable:
    def run(measurements, stem):
        path = stem.with_suffix(".bsdf")
        if not path.exists():
            start = Material.pretrained()
            fit_best(start, measurements, own="always", size=size, seed=args.seed).save(path)
        material = Material.load(path)
        analytic = parameters.count(material.brdf.model.parameters)
        return _ours(material, analytic + sum(c.n_weights for c in material.brdf.distilled), 0)

    return run


def _run_material(start: Material, args) -> Callable:
    def run(measurements, stem):
        path = stem.with_suffix(".bsdf")
        if not path.exists():
            fit(start, measurements, method=args.method, seed=args.seed).save(path)
        material = Material.load(path)
        return _ours(material, material.brdf.n_parameters, 4 * material.brdf.n_weights)

    return run


def _ours(material: Material, n_parameters: int, shared_bytes: int) -> Fitted:
    seconds, madds = material.report["seconds"], material.brdf.multiply_adds
    return Fitted(material.evaluate, seconds, n_parameters, shared_bytes, madds, material)


def _nbrdf(network: dict, seconds: float | None, highest: float) -> Fitted:
    """Values are cut at `highest`, the largest that training has seen: far from its samples a network can overflow."""
    products = sum(network[name].size for name in ("W1", "W2", "W3"))
    total = sum(w.size for w in network.values())
    return Fitted(lambda wi, wo: np.minimum(nbrdf.decode(network, wi, wo), highest), seconds, total, 0, products)


def _digest(path) -> str:
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()
