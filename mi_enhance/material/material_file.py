"""Materials in files: one ``.bsdf`` each, checked when read."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import mitsuba as mi
import numpy as np

from ..analytic import alternative_terms, models, parameters
from ..neural import distilled_network
from ..neural.enhance import enhance
from ..neural.enhanced_brdf import EnhancedBRDF
from ..neural.mlp import unflatten
from ..sampling import lobe_mixture
from ..sampling.lobe_mixture import Mixture
from ..system import tensor_file
from ..system.files import require_file

# Of the files; a reader refuses what is newer. Before 2, `replace` was a list and all networks had `hidden`; before 3
# there was no `energy`, which an older reader would not hold, and no `mixture`.
FORMAT = 3
KIND = "mi_enhance material"


def read(path: str | Path) -> dict:
    """Read the fields of a material; see :meth:`mi_enhance.material.material.Material.load` for the errors."""
    where = f'Material.load("{path}")'
    file = require_file(path, where)
    fields = tensor_file.fields(file, where)
    if "params" not in fields or "description" not in fields:
        if {"rgb", "spectra", "theta_i"} & set(fields):
            raise ValueError(
                f"{where}: this is a measured RGL file, not a material of mi_enhance. Fit it first: "
                f"mi-enhance fit {path} -o material.bsdf"
            )
        raise ValueError(
            f"{where}: not a material of mi_enhance: it has no params and description. Got: {list(fields)}."
        )
    arrays = {name: tensor_file.values(file, f) for name, f in fields.items()}
    for name, array in arrays.items():
        if name == "description":
            continue
        if array.dtype != np.float32:
            raise ValueError(f"{where}: {name} holds {array.dtype}; float32 is needed. Save the material again.")
        if not np.isfinite(array).all():
            raise ValueError(f"{where}: {name} holds NaN or infinity. Save the material again.")
    description = _read_description(arrays["description"].tobytes(), where)
    template = _template(description, where)
    networks = {}
    for slot, mlp in template.modules.items():
        layers = []
        for k, (w, b) in enumerate(mlp.layers):
            names = f"{slot}.layers.{k}.weights", f"{slot}.layers.{k}.bias"
            for name, expected in zip(names, (w, b), strict=True):
                if name not in arrays or arrays[name].shape != expected.shape:
                    got = arrays[name].shape if name in arrays else "nothing"
                    raise ValueError(f"{where}: {name} should have shape {expected.shape}; got {got}. Save it again.")
            layers.append(tuple(arrays[name].astype(np.float32) for name in names))
        networks[slot] = dataclasses.replace(mlp, layers=tuple(layers))
    brdf = dataclasses.replace(
        template, modules=networks, distilled=_compact(description, arrays.get("compact"), template, where)
    )
    library = arrays.get("library")
    return _assemble(brdf, arrays["params"], description, where, library)


def from_arrays(description: str, params, weights) -> dict:
    """The fields of a material from what :meth:`mi_enhance.material.material.Material.to_dict` took apart."""
    where = 'bsdf "enhanced"'
    parsed = _read_description(description.encode(), where)
    template = _template(parsed, where)
    flat = np.asarray(weights, np.float32).ravel()
    own, rest = flat[: template.n_weights], flat[template.n_weights :]
    if len(own) != template.n_weights or (len(rest) and "compact" not in parsed):
        raise ValueError(f"{where}: {len(flat)} weights given, {template.n_weights} expected for {template}.")
    brdf = dataclasses.replace(
        template,
        modules=unflatten(template.modules, own),
        distilled=_compact(parsed, rest, template, where),
    )
    return _assemble(brdf, np.asarray(params), parsed, where, None)


def _read_description(text: bytes, where: str) -> dict:
    try:
        description = json.loads(text)
        kind, version = description["kind"], description["format"]
    except (ValueError, TypeError, KeyError, RecursionError) as error:  # RecursionError: a million opening brackets
        raise ValueError(f"{where}: its description is not one of a material of mi_enhance ({error!r}).") from error
    if kind != KIND or not isinstance(version, int):
        raise ValueError(f'{where}: its description says kind "{kind}"; "{KIND}" is needed.')
    if version > FORMAT:
        raise ValueError(
            f"{where}: file format {version} is newer than this package reads ({FORMAT}). Upgrade mi_enhance."
        )
    return description


def _template(description: dict, where: str) -> EnhancedBRDF:
    """The BRDF that a description stands for, with arbitrary weights: it knows every shape."""
    try:
        replace, n_latent = description["replace"], description["n_latent"]
        if isinstance(replace, list):
            replace = dict.fromkeys(replace, description["hidden"])
        # before any array is made: a few characters must not ask for all the memory there is
        if not 0 <= n_latent <= 1024:
            raise ValueError(f"n_latent {n_latent} out of range: 0 to 1024")
        return enhance(
            alternative_terms.with_terms(_model(description), description.get("terms", {})),
            dict(replace),
            n_latent=n_latent,
            inputs=description["inputs"],
            modulated=bool(description.get("modulated", False)),
        )
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise ValueError(f"{where}: its description cannot be understood: {error}.") from error


def _model(description: dict) -> models.Model:
    """The package's own by name, another from the text that is in the file: no other file is read."""
    text = description.get("model_text", "")
    return models.from_expression(text) if text else models.get(description["model"])


def flat(networks: tuple[distilled_network.DistilledNetwork, ...]) -> np.ndarray:
    return np.concatenate([np.zeros(0, np.float32), *(c.flat for c in networks)])


def _compact(description: dict, weights: np.ndarray | None, template: EnhancedBRDF, where: str) -> tuple:
    """The compact networks of a file, of which a material need not have any."""
    if "compact" not in description:
        return ()
    try:
        result = distilled_network.restore(
            description["compact"], np.zeros(0, np.float32) if weights is None else weights
        )
        for c in result:
            for slot in c.slots:
                template.model.graph.find(slot)
        return result
    except (KeyError, TypeError, ValueError) as error:
        raise ValueError(
            f"{where}: its compact networks cannot be understood: {error}. Specialize it again."
        ) from error


def _assemble(brdf: EnhancedBRDF, params: np.ndarray, description: dict, where: str, library) -> dict:
    if params.shape != (brdf.n_parameters,):
        raise ValueError(f"{where}: params has shape {params.shape}; ({brdf.n_parameters},) is needed for {brdf}.")
    if library is not None and (library.ndim != 2 or library.shape[1] != brdf.n_parameters):
        raise ValueError(f"{where}: library has shape {library.shape}; (M, {brdf.n_parameters}) is needed.")
    values = parameters.unflatten(brdf.parameters, params.astype(np.float64))
    parameters.check(brdf.parameters, values, where)
    lobe_albedo = description.get("lobe_albedo")
    if not isinstance(lobe_albedo, (int, float)) or not 0 <= lobe_albedo < 1e30:
        raise ValueError(f"{where}: lobe_albedo must be a number of at least 0; got {lobe_albedo!r}. Save it again.")
    energy = description.get("energy", False)
    if not isinstance(energy, bool):
        raise ValueError(f"{where}: energy must be true or false; got {energy!r}. Save it again.")
    report = description.get("report", {})
    if not isinstance(report, dict):
        raise ValueError(f"{where}: report must be an object {{ ... }}; got {report!r}. Save it again.")
    mixture = _mixture(description, brdf, where)
    return {
        "brdf": brdf,
        "params": values,
        "report": report,
        "library": library,
        "lobe_albedo": float(lobe_albedo),
        "bound_energy": energy,
        "mixture": mixture,
    }


def _mixture(description: dict, brdf: EnhancedBRDF, where: str) -> Mixture | None:
    """How the material of a file is sampled; a file need not say."""
    if description.get("mixture") is None:
        return None
    initial = parameters.flatten(brdf.parameters, parameters.initial(brdf.parameters))
    lanes = parameters.unflatten(brdf.parameters, [mi.Float(float(v)) for v in initial])
    n = len(brdf.model.lobes(lanes))
    try:
        scales, albedos = (np.array(description["mixture"][key], np.float64) for key in Mixture._fields)
    except (KeyError, TypeError, ValueError) as error:
        raise ValueError(f"{where}: its mixture cannot be understood ({error!r}). Fit it again.") from error
    good = scales.shape == (n,) and albedos.shape == (n + 1, lobe_mixture.NODES)
    # 100, 1: far beyond what a fit tries, and what the largest albedo is scaled to
    if not (good and (scales > 0).all() and (scales <= 100).all() and (albedos >= 0).all() and (albedos <= 1).all()):
        raise ValueError(
            f"{where}: its mixture must be {n} scale(s) in (0, 100] and albedos {(n + 1, lobe_mixture.NODES)} in [0, 1]; "
            f"got scales {scales.tolist()} and albedos of shape {albedos.shape}. Fit it again."
        )
    return Mixture(tuple(scales.tolist()), tuple(map(tuple, albedos.tolist())))
