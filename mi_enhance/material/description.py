"""The description of a material: all but its numbers, as JSON; checked when it is read."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from importlib import metadata
from typing import TYPE_CHECKING, Any

import mitsuba as mi
import numpy as np

from ..analytic import alternative_terms, models, parameters
from ..neural.enhance import enhance, with_trunk
from ..neural.enhanced_brdf import EnhancedBRDF
from ..sampling import lobe_mixture
from ..sampling.lobe_mixture import Mixture

if TYPE_CHECKING:
    from .material import Material

# Of the files; a reader refuses what is newer. Before 2, `replace` was a list and all networks had `hidden`; before 3
# there was no `energy`, which an older reader would not hold, and no `mixture`; before 4 no `trunk`, and distilled
# networks were scalar; before 5 all read-outs were free.
FORMAT = 5
KIND = "mi_enhance material"


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


def _rank(material: Material) -> int:
    assert material.brdf.trunk is not None and material.low_rank is not None
    return material.low_rank.basis.sizes[-1] // material.brdf.trunk.n_outputs


def parse(text: bytes | str, where: str, kind: str = KIND, newest: int = FORMAT) -> dict:
    """Return a description, or raise unless it is one of this kind, of a format that this package reads."""
    try:
        description = json.loads(text)
        found, version = description["kind"], description["format"]
    except (ValueError, TypeError, KeyError, RecursionError) as error:  # RecursionError: a million opening brackets
        raise ValueError(f"{where}: its description is not one of mi_enhance ({error!r}).") from error
    if found != kind or not isinstance(version, int):
        raise ValueError(f'{where}: its description says kind "{found}"; "{kind}" is needed.')
    if version > newest:
        raise ValueError(f"{where}: format {version} is newer than this package reads ({newest}). Upgrade mi_enhance.")
    return description


def template_of(description: dict, where: str) -> EnhancedBRDF:
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


def fields_of(description: Mapping, brdf: EnhancedBRDF, where: str) -> dict:
    """Return the fields of a material that its description holds, checked."""
    lobe_albedo = description.get("lobe_albedo")
    if not isinstance(lobe_albedo, (int, float)) or not 0 <= lobe_albedo < 1e30:
        raise ValueError(f"{where}: lobe_albedo must be a number of at least 0; got {lobe_albedo!r}. Save it again.")
    reference = _reference(description, "reference", brdf, where)
    return {
        "brdf": dataclasses.replace(brdf, reference=reference) if reference else brdf,
        "exact_reference": _reference(description, "exact_reference", brdf, where),
        "report": _typed(description, "report", {}, "an object { ... }", where),
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
