"""Materials in files: one ``.bsdf`` each, Mitsuba's tensor container with a JSON description; checked when read.

The plugin takes the same description, parameters and weights as arrays: :func:`from_arrays`.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..analytic import parameters
from ..neural import distilled_network
from ..neural.enhance import with_trunk
from ..neural.enhanced_brdf import EnhancedBRDF
from ..neural.mlp import MLP, flatten, unflatten
from ..system import tensor_file
from ..system.files import replacing, require_file
from .description import describe, fields_of, parse, template_of
from .low_rank import LowRank, with_basis

if TYPE_CHECKING:
    from .material import Material


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
    parsed = parse(arrays["description"].tobytes(), where)
    template = template_of(parsed, where)
    networks = {slot: _module(slot, mlp, arrays, where) for slot, mlp in template.networks.items()}
    distilled = _distilled(parsed, arrays.get("compact"), template, where)
    brdf = dataclasses.replace(template.with_networks(networks), distilled=distilled)
    result = _fields(brdf, arrays["params"], parsed, where, arrays.get("library"))
    if "exact" in arrays:
        result["exact_params"] = _values(brdf, arrays["exact"], where)
    if "low_rank" in parsed:
        result["low_rank"] = _low_rank(brdf, parsed["low_rank"], arrays, where)
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


def weights(brdf: EnhancedBRDF) -> np.ndarray:
    """Return all weights as one float32 vector, as :func:`from_arrays` takes them."""
    return np.concatenate([flatten(brdf.networks), _flat(brdf.distilled)])


def from_arrays(text: str, params, weights) -> dict:
    """The fields of a material from what :meth:`mi_enhance.material.material.Material.to_dict` took apart."""
    where = 'bsdf "enhanced"'
    parsed = parse(text.encode(), where)
    template = template_of(parsed, where)
    flat = np.asarray(weights, np.float32).ravel()
    own, rest = flat[: template.n_weights], flat[template.n_weights :]
    if len(own) != template.n_weights or (len(rest) and "compact" not in parsed):
        raise ValueError(f"{where}: {len(flat)} weights given, {template.n_weights} expected for {template}.")
    brdf = dataclasses.replace(
        template.with_networks(unflatten(template.networks, own)), distilled=_distilled(parsed, rest, template, where)
    )
    return _fields(brdf, np.asarray(params), parsed, where)


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


def _flat(networks: Iterable[distilled_network.DistilledNetwork]) -> np.ndarray:
    return np.concatenate([np.zeros(0, np.float32), *(c.flat for c in networks)])


def _distilled(parsed: dict, weights: np.ndarray | None, template: EnhancedBRDF, where: str) -> tuple:
    """The distilled networks of a file, if there are any; format and messages call them compact."""
    if "compact" not in parsed:
        return ()
    try:
        result = distilled_network.restore(parsed["compact"], np.zeros(0, np.float32) if weights is None else weights)
        for c in result:
            for slot in c.slots:
                template.model.graph.find(slot)
        return result
    except (KeyError, TypeError, ValueError) as error:
        raise ValueError(
            f"{where}: its compact networks cannot be understood: {error}. Specialize it again."
        ) from error


def _fields(
    brdf: EnhancedBRDF, params: np.ndarray, parsed: Mapping, where: str, library: np.ndarray | None = None
) -> dict:
    """The fields of a material, checked."""
    values = _values(brdf, params, where)
    if library is not None and (library.ndim != 2 or library.shape[1] != brdf.n_parameters):
        raise ValueError(f"{where}: library has shape {library.shape}; (M, {brdf.n_parameters}) is needed.")
    return {"brdf": brdf, "params": values, "library": library, **fields_of(parsed, brdf, where)}


def _values(brdf: EnhancedBRDF, params: np.ndarray, where: str) -> dict:
    """Parameter values, checked."""
    if params.shape != (brdf.n_parameters,):
        raise ValueError(f"{where}: params has shape {params.shape}; ({brdf.n_parameters},) is needed for {brdf}.")
    values = parameters.unflatten(brdf.parameters, params.astype(np.float64))
    parameters.check(brdf.parameters, values, where)
    return values
