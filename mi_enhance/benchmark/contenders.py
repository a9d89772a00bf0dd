"""The models of a benchmark: every one fitted to one measured material and ready to render.

Fits are kept as files, so an interrupted benchmark goes on where it was. Everything here can be sent to another
process: the first frame of a fresh one is measured, too.
"""

from __future__ import annotations

import functools
import json
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import mitsuba as mi
import numpy as np

from ..data.measurements import Measurements
from ..fitting.fit import fit
from ..material.material import Material
from ..specialization.specialize import SIZES, specialize
from ..system.bundled_files import DEFAULT_NETWORK
from ..system.cache import cached
from ..system.progress import Callback, Progress, silent
from . import mitsuba_bsdfs, nbrdf, residual_network

REFERENCE = "GGX in Python"
EXACT = "enhanced, exact"
_PAPER = "the paper's network"
_NETWORKS = {"enhanced, small network": "ggx2_small", "enhanced ggx": "ggx", _PAPER: "paper"}


class Contender(NamedTuple):
    """A model that was fitted to one material."""

    make: Callable  # (spec) -> mi.BSDF, a function of this module
    spec: dict  # JSON
    n_bytes: int  # that belong to this material alone
    shared_bytes: int  # of the networks that all materials have in common
    multiply_adds: int  # of all networks in one evaluation
    seconds: float | None  # of the fit and all that followed it
    can_be_textured: bool = False

    def bsdf(self) -> mi.BSDF:
        """The BSDF, of the active variant."""
        return self.make(self.spec)


def contenders(
    truth: dict | None,
    measurements: Measurements,
    folder: Path,
    *,
    model: Material | None = None,
    seed: int = 0,
    progress: Callback = silent,
) -> dict[str, Contender]:
    """Fit every model to one measured material, or take what an earlier call has left.

    Parameters
    ----------
    truth : dict, optional
        The measured file as Mitsuba's ``measured`` renders it, if it can.
    measurements : Measurements
        Samples of it, which the models are fitted to.
    folder : Path
        Keeps the fits.
    model : Material, optional
        The enhanced model in the place of the shipped default.
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

    n_done = 0

    def kept(name: str, suffix: str, write: Callable[[Path], None]) -> Path:
        """Return the file of a fit; `write` makes it where no earlier call has."""
        nonlocal n_done
        n_done += 1
        file = folder / f"{name}.{suffix}"
        begin = functools.partial(progress, Progress(f"{measurements.name}: {name}", n_done))
        cached(file, begin, lambda _: None, lambda path, _: write(path))
        return file

    def ours(name: str, compute: Callable[[], Material]) -> Path:
        return kept(name, "bsdf", lambda path: compute().save(path))

    ggx = ours("ggx_analytic", lambda: fit(Material.analytic("ggx"), measurements, seed=seed))
    lobe = Material.load(ggx)
    name = "model" if model else DEFAULT_NETWORK
    exact = ours(name, lambda: fit(model or Material.pretrained(), measurements, seed=seed))
    m = Material.load(exact)
    result = {REFERENCE: _ours(ggx)}
    for plugin in mitsuba_bsdfs.MITSUBA:
        result[plugin] = _mitsuba(
            plugin, kept(plugin, "json", functools.partial(_fit_mitsuba, plugin, measurements, seed))
        )
    result |= {
        EXACT: _ours(exact),
        f"{EXACT}, cooperative": _ours(exact, evaluators="cooperative"),
        "specialized, max error 0.001": _ours(ours("specialized", lambda: specialize(m, seed=seed))),
    }
    for size in SIZES:
        file = ours(f"specialized_{size}", functools.partial(specialize, m, measurements, size=size, seed=seed))
        result[f"specialized on the file, {size}-{size}"] = _ours(file)
    for label, network in _NETWORKS.items():
        file = ours(network, functools.partial(fit, Material.pretrained(network), measurements, seed=seed))
        result[label] = _ours(file)
    result[f"{_PAPER}, cooperative"] = _ours(file, evaluators="cooperative")
    result["NBRDF"] = _nbrdf(kept("nbrdf", "npz", lambda path: _train_nbrdf(path, measurements, seed)), ggx)
    file = kept("residual", "npz", lambda path: _train_residual(path, lobe, measurements, seed))
    result["GGX and a residual network"] = _residual(file, ggx)
    if truth:
        result["measured"] = Contender(_load, truth, Path(truth["filename"]).stat().st_size, 0, 0, None)
    return result


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
    roughness = {name: bitmap(np.minimum(weight * m.params[name], 1)) for name in ("alpha_x", "alpha_y")}
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
