"""The models of a benchmark: every one fitted to one measured material and ready to render.

Fits are kept as files, so an interrupted benchmark goes on where it was. Everything here can be sent to another
process: the first frame of a fresh one is measured, too.
"""

from __future__ import annotations

import functools
import json
from collections.abc import Callable, Collection
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np

from ..data.measurements import Measurements
from ..fitting.fit import fit
from ..material.material import Material
from ..neural.mlp import flatten
from ..specialization.own_network import can_have_one
from ..specialization.specialize import SIZES, specialize
from ..system.bundled_files import DEFAULT_NETWORK
from ..system.cache import cached
from ..system.files import digest
from ..system.progress import Callback, Progress, silent
from ..system.run_folder import keep_settings
from . import mitsuba_bsdfs, nbrdf, residual_network
from .contender import Contender
from .hybrid_contender import HYBRID, fit_to_file, hybrid_of_file

REFERENCE = "GGX in Python"
ANALYTIC = {"Ward": "ward", "Cook-Torrance": "cook_torrance", "Low's ABC": "abc"}  # models of ours, fitted like GGX
NBRDF = "NBRDF"
EXACT = "enhanced, exact"
_PAPER = "the paper's network"
_NETWORKS = {"enhanced, small network": "ggx2_small", "enhanced ggx": "ggx", _PAPER: "paper"}


def contenders(
    truth: dict | None,
    measurements: Measurements,
    folder: Path,
    *,
    model: Material | None = None,
    only: Collection[str] | None = None,
    seed: int = 0,
    progress: Callback = silent,
) -> dict[str, Contender]:
    """Fit models to one measured material, or take what an earlier call has left.

    Parameters
    ----------
    truth : dict, optional
        The measured file as Mitsuba's ``measured`` renders it, if it can.
    measurements : Measurements
        Samples of it, which the models are fitted to.
    folder : Path
        Keeps the fits, of these samples only.
    model : Material, optional
        The enhanced model in the place of the shipped default.
    only : collection of str, optional
        Labels of the models that are wanted; all if left out.
    seed : int
    progress : callable
        Hears of every fit before it begins, see :mod:`mi_enhance.system.progress`.

    Returns
    -------
    dict of str to Contender
        The reference, plain GGX, first; ``measured``, the truth itself if it can be rendered, last.

    Examples
    --------
    >>> contenders(truth, measurements, Path("out/bench"))  # doctest: +SKIP
    """
    given = digest(measurements.wi, measurements.wo, measurements.f)
    keep_settings(folder / "samples.json", {"samples": given}, f'fits to "{measurements.name}"')
    n_done = 0

    def kept(name: str, suffix: str, write: Callable[[Path], None]) -> Path:
        """Return the file of a fit; `write` makes it where no earlier call has."""
        nonlocal n_done
        n_done += 1
        file = folder / f"{name}.{suffix}"
        begin = functools.partial(progress, Progress(f"{measurements.name}: {name}", n_done))
        cached(file, begin, lambda _: None, lambda path, _: write(path))
        return file

    @functools.cache
    def analytic(name: str) -> Path:
        return ours(f"{name}_analytic", lambda: fit(Material.analytic(name), measurements, seed=seed))

    @functools.cache
    def network(name: str) -> Path:
        return ours(name, lambda: fit(Material.pretrained(name), measurements, seed=seed))

    @functools.cache
    def exact() -> Path:
        return ours(
            "model" if model else DEFAULT_NETWORK, lambda: fit(model or Material.pretrained(), measurements, seed=seed)
        )

    def ours(name: str, compute: Callable[[], Material]) -> Path:
        return kept(name, "bsdf", lambda path: compute().save(path))

    def specialized(name: str, given: Measurements | None = None, size: int | None = None) -> Contender:
        return _ours(ours(name, lambda: specialize(Material.load(exact()), given, size=size, seed=seed)))

    def mitsuba(plugin: str) -> Contender:
        return _mitsuba(plugin, kept(plugin, "json", functools.partial(_fit_mitsuba, plugin, measurements, seed)))

    def residual() -> Contender:
        lobe = analytic("ggx")
        write = lambda path: _train_residual(path, Material.load(lobe), measurements, seed)  # noqa: E731
        return _residual(kept("residual", "npz", write), lobe)

    def trained_nbrdf() -> Contender:
        return _nbrdf(kept("nbrdf", "npz", lambda path: _train_nbrdf(path, measurements, seed)), analytic("ggx"))

    def hybrid() -> Contender:
        write = lambda path: fit_to_file(path, Material.load(analytic("ggx")), measurements, seed)  # noqa: E731
        return hybrid_of_file(kept("hybrid", "npz", write), analytic("ggx"))

    recipes: dict[str, Callable[[], Contender]] = {
        label: functools.partial(lambda name: _ours(analytic(name)), name)
        for label, name in {REFERENCE: "ggx", **ANALYTIC}.items()
    }
    recipes |= {plugin: functools.partial(mitsuba, plugin) for plugin in mitsuba_bsdfs.MITSUBA}
    recipes |= {
        EXACT: lambda: _ours(exact()),
        "specialized, max error 0.001": lambda: specialized("specialized"),
    }
    for size in SIZES if model is None or can_have_one(model.brdf) else ():
        label, file = f"specialized on the file, {size}-{size}", f"specialized_{size}"
        recipes[label] = functools.partial(specialized, file, measurements, size)
    for label, name in _NETWORKS.items():
        recipes[label] = functools.partial(lambda name: _ours(network(name)), name)
    if (mi.variant() or "").startswith("cuda"):  # on LLVM cooperative vectors cost 14 times what literals cost
        recipes[f"{EXACT}, cooperative"] = lambda: _ours(exact(), evaluators="cooperative")
        recipes[f"{_PAPER}, cooperative"] = lambda: _ours(network(_NETWORKS[_PAPER]), evaluators="cooperative")
    recipes |= {
        NBRDF: trained_nbrdf,
        HYBRID: hybrid,
        "GGX and a residual network": residual,
    }
    if truth:
        size_of_file = Path(truth["filename"]).stat().st_size
        recipes["measured"] = lambda: Contender(_load, truth, size_of_file, 0, 0, None)
    return {label: make() for label, make in recipes.items() if only is None or label in only}


def settings_of_fits(model: Material | None, n_samples: int, seed: int) -> dict[str, Any]:
    """Return what decides the fits besides the files, for :func:`mi_enhance.system.run_folder.keep_settings`."""
    settings: dict[str, Any] = {"samples": n_samples, "seed": seed}
    if model:  # of the default nothing is noted: so earlier runs go on
        settings["model"] = digest(str(model.brdf).encode(), flatten(model.brdf.networks), model.as_vector())
    return settings


def edited(contender: Contender, k: int) -> Contender:
    """The same model with other colours, as far as it has any: one of many materials of a scene."""
    share = 0.5 + 0.5 * ((k * 0.618034) % 1)  # golden ratio: no two alike
    spec = {**contender.spec}
    if spec["type"] == "enhanced":
        rho_d = Material.load(spec["filename"]).params["rho_d"]
        spec["rho_d"] = {"type": "rgb", "value": [float(v) for v in rho_d * share]}
    return contender._replace(spec=spec)


def textured(contender: Contender, size: int = 64) -> Contender:
    """The same model with a texture for rho_d and for the roughness."""
    rng = np.random.default_rng(0)
    m = Material.load(contender.spec["filename"])
    weight = np.repeat(np.repeat(rng.uniform(0.5, 1, (size // 8, size // 8, 1)), 8, 0), 8, 1)
    bitmap = lambda v: {  # noqa: E731
        "type": "bitmap",
        "data": mi.TensorXf(np.ascontiguousarray(v, np.float32)),
        "raw": True,
    }
    roughness = {
        name: bitmap(np.minimum(weight * m.params[name], 1)) for name in ("alpha_x", "alpha_y") if name in m.params
    }
    return contender._replace(spec={**contender.spec, "rho_d": bitmap(weight * m.params["rho_d"]), **roughness})


# ---------------------------------------------------------------------- how each is made from its files


def _load(spec: dict) -> mi.BSDF:
    return mi.load_dict(spec)


def _load_nbrdf(spec: dict) -> mi.BSDF:
    from ..bsdfs.function import function_bsdf

    with np.load(spec["network"], allow_pickle=False) as stored:
        f = nbrdf.nbrdf_function({k: stored[k] for k in stored if k[0] in "Wb"}, float(stored["highest"]))
    return function_bsdf(f, Material.load(spec["lobe"]))


def _load_residual(spec: dict) -> mi.BSDF:
    from ..bsdfs.function import function_bsdf

    lobe = Material.load(spec["lobe"])
    return function_bsdf(residual_network.residual_function(lobe, _layers(spec["network"])), lobe)


def _layers(file: str) -> list:
    with np.load(file, allow_pickle=False) as stored:
        return [(stored[f"W{k}"], stored[f"b{k}"]) for k in range((len(stored.files) - 1) // 2)]


def _ours(file: Path, *, evaluators: str | None = None) -> Contender:
    m = Material.load(file)
    brdf = m.brdf
    own = sum(4 * c.n_weights for c in brdf.distilled)
    return Contender(
        _load,
        {"type": "enhanced", "filename": str(file), **({"evaluators": evaluators} if evaluators else {})},
        m.n_bytes + own,
        0 if brdf.distilled else 4 * brdf.n_weights,
        brdf.multiply_adds,
        m.report["seconds"] + m.report.get("specialize_seconds", 0),
        not brdf.distilled,
    )


def _fit_mitsuba(plugin: str, measurements: Measurements, seed: int, path: Path) -> None:
    spec, seconds = mitsuba_bsdfs.fit_mitsuba(plugin, measurements, seed=seed)
    path.write_text(json.dumps({"spec": spec, "seconds": seconds}, indent=1))


def _mitsuba(plugin: str, file: Path) -> Contender:
    stored = json.loads(file.read_text())
    n = sum(n for *_, n in mitsuba_bsdfs.MITSUBA[plugin].values())
    return Contender(_load, stored["spec"], 4 * n, 0, 0, stored["seconds"])


def _train_nbrdf(path: Path, measurements: Measurements, seed: int) -> None:
    network, seconds = nbrdf.train_nbrdf(measurements, seed=seed)
    np.savez(path, **network, seconds=seconds, highest=measurements.f.max())


def _nbrdf(file: Path, lobe: Path) -> Contender:
    with np.load(file, allow_pickle=False) as stored:
        seconds = float(stored["seconds"])
        n, products = (sum(stored[k].size for k in stored if k[0] in first) for first in ("Wb", "W"))
    spec = {"type": "nbrdf", "network": str(file), "lobe": str(lobe)}
    return Contender(_load_nbrdf, spec, 4 * n, 0, products, seconds)


def _train_residual(path: Path, lobe: Material, measurements: Measurements, seed: int) -> None:
    layers, seconds = residual_network.train_residual(lobe, measurements, seed=seed)
    arrays = {f"{letter}{k}": v for k, layer in enumerate(layers) for letter, v in zip("Wb", layer, strict=True)}
    np.savez(path, **arrays, seconds=seconds + lobe.report["seconds"])


def _residual(file: Path, lobe: Path) -> Contender:
    layers = _layers(str(file))
    with np.load(file, allow_pickle=False) as stored:
        seconds = float(stored["seconds"])
    n, products = sum(w.size + b.size for w, b in layers), sum(w.size for w, _ in layers)
    spec = {"type": "residual", "network": str(file), "lobe": str(lobe)}
    return Contender(_load_residual, spec, Material.load(lobe).n_bytes + 4 * n, 0, products, seconds)
