"""Materials in files: one ``.bsdf`` each, Mitsuba's tensor container with a JSON description; checked when read.

The plugin takes the same description, parameters and weights as arrays: :func:`from_arrays`.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterable, Mapping
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

import mitsuba as mi
import numpy as np

from ..analytic import alternative_terms, models, parameters
from ..neural import distilled_network
from ..neural.enhance import enhance, with_trunk
from ..neural.enhanced_brdf import EnhancedBRDF
from ..neural.mlp import MLP, flatten, unflatten
from ..sampling import lobe_mixture
from ..sampling.lobe_mixture import Mixture
from ..system import tensor_file
from ..system.files import replacing, require_file
from .low_rank import LowRank, with_basis

if TYPE_CHECKING:
    from .material import Material

# Of the files; a reader refuses what is newer. Before 2, `replace` was a list and all networks had `hidden`; before 3
# there was no `energy`, which an older reader would not hold, and no `mixture`; before 4 no `trunk`, and distilled
# networks were scalar; before 5 all read-outs were free.
FORMAT = 5
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
    _check_numbers(arrays, where)
    description = _read_description(arrays["description"].tobytes(), where)
    template = _template(description, where)
    networks = {slot: _module(slot, mlp, arrays, where) for slot, mlp in template.networks.items()}
    distilled = _distilled(description, arrays.get("compact"), template, where)
    brdf = dataclasses.replace(template.with_networks(networks), distilled=distilled)
    result = _fields(brdf, arrays["params"], description, where, arrays.get("library"))
    if "exact" in arrays:
        result["exact_params"] = _fields(brdf, arrays["exact"], description, where, None)["params"]
    if "low_rank" in description:
        result["low_rank"] = _low_rank(brdf, description["low_rank"], arrays, where)
    return result


def write(path: str | Path, material: Material) -> None:
    """Write what :func:`read` reads; the file is replaced as a whole or not at all."""
    tensors = {"params": material.as_vector().astype(np.float32)}
    for slot, mlp in material.brdf.networks.items():
        for k, (w, b) in enumerate(mlp.layers):
            tensors[f"{slot}.layers.{k}.weights"], tensors[f"{slot}.layers.{k}.bias"] = w, b
    if material.brdf.distilled:
        tensors["compact"] = _flat(material.brdf.distilled)
    if material.exact_params is not None:
        tensors["exact"] = parameters.flatten(material.brdf.parameters, material.exact_params).astype(np.float32)
    if material.library is not None:
        tensors["library"] = material.library.astype(np.float32)
    if material.low_rank is not None:
        basis, library = material.low_rank
        tensors["low_rank.layers.0.weights"], tensors["low_rank.layers.0.bias"] = basis.layers[0]
        tensors["low_rank.library"] = library.astype(np.float32)
    with replacing(path) as temporary:
        tensor_file.write(temporary, {"description": json.dumps(describe(material)), **tensors})


def describe(material: Material) -> dict:
    """Return the description of a material, as JSON: all but its numbers."""
    brdf = material.brdf
    return {
        "kind": KIND,
        "format": FORMAT,
        "equation": str(brdf),
        "model": brdf.model.name,
        "model_text": brdf.model.text,
        "terms": dict(brdf.model.terms),
        "replace": {slot: list(mlp.sizes[1:-1]) for slot, mlp in brdf.modules.items()},
        **({"trunk": brdf.trunk.describe()} if brdf.trunk else {}),
        **({"low_rank": _rank(material)} if material.low_rank else {}),
        "n_latent": brdf.n_latent,
        "inputs": brdf.inputs,
        "modulated": any(mlp.modulated for mlp in brdf.modules.values()),
        "parameters": [[p.name, p.size] for p in brdf.parameters],
        **({"compact": [c.describe() for c in brdf.distilled]} if brdf.distilled else {}),
        **({"reference": dict(brdf.reference)} if brdf.reference else {}),
        **({"exact_reference": material.exact_reference} if material.exact_reference else {}),
        "lobe_albedo": material.lobe_albedo,
        "energy": material.bound_energy,
        **({"mixture": material.mixture._asdict()} if material.mixture else {}),
        "versions": {name: metadata.version(name) for name in ("mi-enhance", "mitsuba", "drjit", "numpy")},
        "report": material.report,
    }


def weights(brdf: EnhancedBRDF) -> np.ndarray:
    """Return all weights as one float32 vector, as :func:`from_arrays` takes them."""
    return np.concatenate([flatten(brdf.networks), _flat(brdf.distilled)])


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
        template.with_networks(unflatten(template.networks, own)), distilled=_distilled(parsed, rest, template, where)
    )
    return _fields(brdf, np.asarray(params), parsed, where, None)


def _rank(material: Material) -> int:
    assert material.brdf.trunk is not None and material.low_rank is not None
    return material.low_rank.basis.sizes[-1] // material.brdf.trunk.n_outputs


def _low_rank(brdf: EnhancedBRDF, rank: Any, arrays: Mapping[str, np.ndarray], where: str) -> LowRank:
    """The basis and the codes that come with a network."""
    try:
        assert brdf.trunk is not None, "no trunk"
        trunk = with_trunk(brdf.model, n_latent=brdf.n_latent, **{**brdf.trunk.describe(), "rank": rank}).trunk
        assert trunk is not None and trunk.basis is not None, f"rank {rank}"
    except (AssertionError, TypeError, ValueError) as error:
        raise ValueError(f"{where}: its low_rank cannot be understood: {error}. Save it again.") from error
    basis = _module("low_rank", trunk.basis, arrays, where)
    library = arrays.get("low_rank.library", np.zeros(0))
    n = with_basis(brdf, basis).n_parameters
    if library.ndim != 2 or library.shape[1] != n:
        raise ValueError(f"{where}: low_rank.library has shape {library.shape}; (M, {n}) is needed. Save it again.")
    return LowRank(basis, library)


def _check_numbers(arrays: Mapping[str, np.ndarray], where: str) -> None:
    """Raise unless all arrays but the description hold finite float32."""
    for name, array in arrays.items():
        if name == "description":
            continue
        if array.dtype != np.float32:
            raise ValueError(f"{where}: {name} holds {array.dtype}; float32 is needed. Save the material again.")
        if not np.isfinite(array).all():
            raise ValueError(f"{where}: {name} holds NaN or infinity. Save the material again.")


def _module(slot: str, mlp: MLP, arrays: Mapping[str, np.ndarray], where: str) -> MLP:
    """The module of a slot with the weights of a file, which must have the shapes of `mlp`."""

    def array(name: str, shape: tuple[int, ...]) -> np.ndarray:
        if name not in arrays or arrays[name].shape != shape:
            got = arrays[name].shape if name in arrays else "nothing"
            raise ValueError(f"{where}: {name} should have shape {shape}; got {got}. Save it again.")
        return arrays[name]

    layers = tuple(
        (array(f"{slot}.layers.{k}.weights", w.shape), array(f"{slot}.layers.{k}.bias", b.shape))
        for k, (w, b) in enumerate(mlp.layers)
    )
    return dataclasses.replace(mlp, layers=layers)


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
        model = alternative_terms.with_terms(_model(description), description.get("terms", {}))
        brdf = enhance(
            model,
            dict(replace),
            n_latent=n_latent,
            inputs=description["inputs"],
            modulated=bool(description.get("modulated", False)),
        )
        if "trunk" in description:
            trunk = with_trunk(model, n_latent=n_latent, **description["trunk"]).trunk
            brdf = dataclasses.replace(brdf, trunk=trunk)
        return brdf
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise ValueError(f"{where}: its description cannot be understood: {error}.") from error


def _model(description: dict) -> models.Model:
    """The package's own by name, another from the text that is in the file: no other file is read."""
    text = description.get("model_text", "")
    return models.from_expression(text) if text else models.get(description["model"])


def _flat(networks: Iterable[distilled_network.DistilledNetwork]) -> np.ndarray:
    return np.concatenate([np.zeros(0, np.float32), *(c.flat for c in networks)])


def _distilled(description: dict, weights: np.ndarray | None, template: EnhancedBRDF, where: str) -> tuple:
    """The distilled networks of a file, if there are any; format and messages call them compact."""
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


def _fields(
    brdf: EnhancedBRDF, params: np.ndarray, description: Mapping, where: str, library: np.ndarray | None
) -> dict:
    """The fields of a material, checked."""
    if params.shape != (brdf.n_parameters,):
        raise ValueError(f"{where}: params has shape {params.shape}; ({brdf.n_parameters},) is needed for {brdf}.")
    if library is not None and (library.ndim != 2 or library.shape[1] != brdf.n_parameters):
        raise ValueError(f"{where}: library has shape {library.shape}; (M, {brdf.n_parameters}) is needed.")
    values = parameters.unflatten(brdf.parameters, params.astype(np.float64))
    parameters.check(brdf.parameters, values, where)
    lobe_albedo = description.get("lobe_albedo")
    if not isinstance(lobe_albedo, (int, float)) or not 0 <= lobe_albedo < 1e30:
        raise ValueError(f"{where}: lobe_albedo must be a number of at least 0; got {lobe_albedo!r}. Save it again.")
    reference = _reference(description, "reference", brdf, where)
    return {
        "brdf": dataclasses.replace(brdf, reference=reference) if reference else brdf,
        "exact_reference": _reference(description, "exact_reference", brdf, where),
        "params": values,
        "report": _typed(description, "report", {}, "an object { ... }", where),
        "library": library,
        "lobe_albedo": float(lobe_albedo),
        "bound_energy": _typed(description, "energy", False, "true or false", where),
        "mixture": _mixture(description, brdf, where),
    }


def _reference(description: Mapping, key: str, brdf: EnhancedBRDF, where: str) -> dict[str, float] | None:
    """Return the roughnesses at which factors were learned, if the material was edited since."""
    found = _typed(description, key, {}, "an object { ... }", where)
    own = {p.name: p for p in brdf.parameters if p.name.startswith("alpha_")}
    for name, v in found.items():
        if name not in own or not isinstance(v, (int, float)) or not own[name].low * 0.99 <= v <= own[name].high * 1.01:
            raise ValueError(f"{where}: {key} holds {name} {v!r}; roughnesses of the model are needed. Save it again.")
    return {name: float(v) for name, v in found.items()} or None


def _typed(description: Mapping, key: str, default: Any, what: str, where: str) -> Any:
    """An entry of the type of its default."""
    value = description.get(key, default)
    if not isinstance(value, type(default)):
        raise ValueError(f"{where}: {key} must be {what}; got {value!r}. Save it again.")
    return value


def _mixture(description: Mapping, brdf: EnhancedBRDF, where: str) -> Mixture | None:
    """Return the sampling mixture in the description of a file; None if it has none."""
    if description.get("mixture") is None:
        return None
    initial = parameters.flatten(brdf.parameters, parameters.initial(brdf.parameters))
    lanes = parameters.unflatten(brdf.parameters, [mi.Float(float(v)) for v in initial])
    n = len(brdf.model.lobes(lanes))
    try:
        scales, albedos = (np.array(description["mixture"][key], np.float64) for key in Mixture._fields)
    except (KeyError, TypeError, ValueError) as error:
        raise ValueError(f"{where}: its mixture cannot be understood ({error!r}). Fit it again.") from error
    shape = (n + 1, lobe_mixture.NODES)
    good = scales.shape == (n,) and albedos.shape == shape
    # 100, 1: far beyond what a fit tries, and what the largest albedo is scaled to
    if not (good and (scales > 0).all() and (scales <= 100).all() and (albedos >= 0).all() and (albedos <= 1).all()):
        raise ValueError(
            f"{where}: its mixture must be {n} scale(s) in (0, 100] and albedos {shape} in [0, 1]; "
            f"got scales {scales.tolist()} and albedos of shape {albedos.shape}. Fit it again."
        )
    return Mixture(tuple(scales.tolist()), tuple(map(tuple, albedos.tolist())))
