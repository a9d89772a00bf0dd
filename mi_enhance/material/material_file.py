"""Materials in files: one ``.bsdf`` each, checked when read."""

from __future__ import annotations

import json

import numpy as np

from ..analytic import alternative_terms, models, parameters
from ..neural import distilled_network
from ..neural.enhance import enhance
from ..neural.enhanced_brdf import EnhancedBRDF
from ..sampling import energy_bound, lobe_mixture
from ..sampling.lobe_mixture import Mixture
from .material import Material

# Of the files; a reader refuses what is newer. Before 2, `replace` was a list and all networks had `hidden`; before 3
# there was no `energy`, which an older reader would not hold, and no `mixture`.
FORMAT = 3


_KIND = "mi_enhance material"


def _read_description(text: bytes, where: str) -> dict:
    try:
        description = json.loads(text)
        kind, version = description["kind"], description["format"]
    except (ValueError, TypeError, KeyError, RecursionError) as error:  # RecursionError: a million opening brackets
        raise ValueError(f"{where}: its description is not one of a material of mi_enhance ({error!r}).") from error
    if kind != _KIND or not isinstance(version, int):
        raise ValueError(f'{where}: its description says kind "{kind}"; "{_KIND}" is needed.')
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
        for slot, hidden in replace.items():
            if not 1 <= len(hidden) <= 8 or any(not 0 < int(n) <= 1024 for n in hidden):
                raise ValueError(f"hidden layers {hidden[:8]} of {slot} out of range: 1 to 8 layers of 1 to 1024")
        if not 0 <= n_latent <= 1024:
            raise ValueError(f"n_latent {n_latent} out of range: 0 to 1024")
        return enhance(
            alternative_terms.with_terms(_model(description), description.get("terms", {})),
            {slot: [int(n) for n in hidden] for slot, hidden in replace.items()},
            n_latent=n_latent,
            inputs=description["inputs"],
            modulated=bool(description.get("modulated", False)),
        )
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise ValueError(f"{where}: its description cannot be understood: {error}.") from error


def _model(description: dict) -> models.Model:
    """The package's own by name, another from the text that is in the file: no other file is read."""
    text = description.get("model_text", "")
    return models.from_expression(text) if text else models.registered(description["model"])


def _flat(networks: tuple[distilled_network.Compact, ...]) -> np.ndarray:
    return np.concatenate([np.zeros(0, np.float32), *(c.flat for c in networks)])


def _compact(description: dict, flat: np.ndarray | None, template: EnhancedBRDF, where: str) -> tuple:
    """The compact networks of a file, of which a material need not have any."""
    if "compact" not in description:
        return ()
    try:
        result = distilled_network.restore(description["compact"], np.zeros(0, np.float32) if flat is None else flat)
        for c in result:
            for slot in c.slots:
                template.model.graph.find(slot)
        return result
    except (KeyError, TypeError, ValueError) as error:
        raise ValueError(
            f"{where}: its compact networks cannot be understood: {error}. Specialize it again."
        ) from error


def _assemble(brdf: EnhancedBRDF, params: np.ndarray, description: dict, where: str, library) -> Material:
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
    if not isinstance(energy_bound, bool):
        raise ValueError(f"{where}: energy must be true or false; got {energy_bound!r}. Save it again.")
    report = description.get("report", {})
    if not isinstance(report, dict):
        raise ValueError(f"{where}: report must be an object {{ ... }}; got {report!r}. Save it again.")
    mixture = _mixture(description, brdf, where)
    return Material(brdf, values, report, library, float(lobe_albedo), energy_bound, mixture)


def _mixture(description: dict, brdf: EnhancedBRDF, where: str) -> Mixture | None:
    """How the material of a file is sampled; a file need not say."""
    if description.get("mixture") is None:
        return None
    n = len(brdf.model.lobes(Material(brdf, {}).lanes()))
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
