"""A material: an enhanced BRDF, its parameters, and a report of how they were found. One file each, no pickle."""

from __future__ import annotations

import dataclasses
import json
from collections import Counter
from importlib import metadata
from pathlib import Path

import mitsuba as mi
import numpy as np

from .analytic import alternative_terms, models, parameters
from .neural import distilled_network
from .neural.enhance import enhance
from .neural.enhanced_brdf import EnhancedBRDF
from .neural.mlp import flatten, unflatten
from .sampling import energy_bound, lobe_mixture
from .sampling.lobe_mixture import Mixture
from .system import tensor_file
from .system.bundled_files import DEFAULT_NETWORK, network_file
from .system.files import replacing, require_file

# Of the files; a reader refuses what is newer. Before 2, `replace` was a list and all networks had `hidden`; before 3
# there was no `energy`, which an older reader would not hold, and no `mixture`.
FORMAT = 3
_KIND = "mi_enhance material"


@dataclasses.dataclass(frozen=True, eq=False)
class Material:
    """What is saved, loaded, edited, shown and rendered.

    Parameters
    ----------
    brdf : EnhancedBRDF
        Model, state and network weights.
    params : dict of str to array
        Parameter values, float64; completed with the starting values if some are left out.
    report : dict
        How it was made: errors, seconds, settings. JSON types only.
    library : array (M, n_parameters), optional
        Parameters of the training materials: where fits start. Only networks carry one, fitted materials do not.
    lobe_albedo : float
        Albedo of the specular lobe for rho_s = 1; decides how often it is sampled, see :mod:`mi_enhance.sampling.importance`.
    mixture : Mixture, optional
        How it is sampled, found by :func:`mi_enhance.sampling.mixture_fit.mixture`; by `lobe_albedo` alone if left out.
    energy : bool
        Hold the directional albedo at 1 or below, whatever the parameters are edited to, see :mod:`mi_enhance.sampling.energy_bound`.

    Examples
    --------
    >>> m = Material.analytic("ggx").edit(rho_d=(0.2, 0.1, 0.0))
    >>> print(m.brdf, m.params["rho_d"])
    M + S * D * F * G * 1/E [0.2 0.1 0. ]
    """

    brdf: EnhancedBRDF
    params: dict
    report: dict = dataclasses.field(default_factory=dict)
    library: np.ndarray | None = None
    lobe_albedo: float = 0.1
    energy: bool = False
    mixture: Mixture | None = None

    def __post_init__(self):
        values = {**parameters.initial(self.brdf.parameters), **self.params}
        object.__setattr__(self, "params", parameters.check(self.brdf.parameters, values, "Material"))

    def __reduce__(self):
        raise TypeError(
            "Material: not to be pickled, a pickle would run code when it is read and break with the next version. "
            "Give other processes the file: material.save(path) here, Material.load(path) there."
        )

    def __copy__(self) -> Material:  # else the copy module would pickle
        return self.edit()

    def __deepcopy__(self, memo: dict) -> Material:
        return self.edit()

    # ------------------------------------------------------------------ where they come from

    @staticmethod
    def analytic(name: str) -> Material:
        """An analytic model without networks, at its starting values; by name, or from a ``.toml`` file."""
        return Material(enhance(name, replace=()), {})

    @staticmethod
    def network(name: str = DEFAULT_NETWORK) -> Material:
        """A network shipped with the package, ready to be fitted."""
        return Material.load(network_file(name))

    # ------------------------------------------------------------------ what one does with them

    def edit(self, **values) -> Material:
        """A copy with other parameter values.

        Parameters
        ----------
        **values
            By name, e.g. ``rho_d=(0.2, 0.1, 0.0)``, ``alpha_x=0.1``; a single number fills a colour.

        Raises
        ------
        ValueError
            For an unknown name, a wrong length or a value out of range.
        """
        changed = parameters.check(self.brdf.parameters, {**self.params, **values}, "Material.edit()")
        return dataclasses.replace(self, params=changed)

    def bounded(self) -> Material:
        """A copy whose directional albedo is at most 1 for every view, also when it is edited.

        Examples
        --------
        >>> Material.analytic("ward").bounded().energy
        True
        """
        return dataclasses.replace(self, energy=True)

    @property
    def exact(self) -> Material:
        """The material that :func:`mi_enhance.specialize` made this one from; itself if it is none of those."""
        report = {key: value for key, value in self.report.items() if not key.startswith("specialize_")}
        return dataclasses.replace(self, brdf=dataclasses.replace(self.brdf, compact=()), report=report)

    def show(self) -> str:
        """A text: equation, parameters, report."""
        lines = [str(self.brdf)]
        for p in self.brdf.parameters:
            lines.append(f"  {p.name:<8} {' '.join(f'{v:.4g}' for v in self.params[p.name])}")
        for c in self.brdf.compact:
            lines.append(
                f"  {', '.join(c.slots)} from a network {'-'.join(map(str, c.sizes))} of {', '.join(c.inputs)}"
            )
        lines.append(
            f"  {self.brdf.n_parameters} parameters ({self.n_bytes} bytes), {self.brdf.n_weights} shared weights, "
            f"inputs: {self.brdf.inputs}"
        )
        if self.energy:
            lines.append("  energy: directional albedo at most 1")
        undetermined = self.report.get("undetermined")
        if undetermined and isinstance(undetermined, list):
            lines.append(f"  not determined by the samples: {', '.join(_by_name(undetermined))}")
        for key, value in self.report.items():
            if isinstance(value, (int, float, str)):
                lines.append(f"  {key}: {value:.6g}" if isinstance(value, float) else f"  {key}: {value}")
        return "\n".join(lines)

    @property
    def n_bytes(self) -> int:
        """Bytes that belong to this material alone, as float32; the weights are shared."""
        return 4 * self.brdf.n_parameters

    @property
    def reciprocal(self) -> bool:
        """True if f(wi, wo) = f(wo, wi) by construction: the networks, if any, do not tell viewer from light."""
        return self.brdf.inputs != "directions" and not self.params.get("asymmetry", np.zeros(1)).any()

    def vector(self) -> np.ndarray:
        """All parameters in order, float64."""
        return parameters.flatten(self.brdf.parameters, self.params)

    def lanes(self) -> dict:
        """All parameters by name as Dr.Jit arrays of one lane, as an :class:`EnhancedBRDF` takes them."""
        return parameters.unflatten(self.brdf.parameters, [mi.Float(float(v)) for v in self.vector()])

    def evaluate(self, wi: np.ndarray, wo: np.ndarray) -> np.ndarray:
        """Reflectance f_r in 1/sr without the cosine.

        Parameters
        ----------
        wi, wo : array (N, 3)
            Unit vectors towards viewer and light.

        Returns
        -------
        array (N, 3)
            Linear RGB; 0 below the horizon.
        """
        wi, wo = (mi.Vector3f(np.ascontiguousarray(np.asarray(w, np.float32).T)) for w in (wi, wo))
        params = self.lanes()
        f = self.brdf(wi, wo, params)
        if self.energy:
            shares = lobe_mixture.shares(params, self.lobe_albedo, self.brdf.model)
            bound = energy_bound.table(self.brdf, params, shares)
            f *= energy_bound.factor(bound, wi, params) * energy_bound.factor(bound, wo, params)
        return np.array(f).T

    def bsdf(self) -> mi.BSDF:
        """The Mitsuba BSDF, straight from memory; the same as saving and loading by ``filename``."""
        return mi.load_dict(self.to_dict())

    def to_dict(self) -> dict:
        """The dictionary that ``mi.load_dict`` takes, to be placed in a scene."""
        return {
            "type": "enhanced",
            "description": json.dumps(self._description()),
            "params": mi.Float(self.vector().astype(np.float32)),
            "weights": mi.Float(np.concatenate([flatten(self.brdf.networks), _flat(self.brdf.compact)])),
        }

    # ------------------------------------------------------------------ files

    def save(self, path: str | Path) -> None:
        """Write one self-contained ``.bsdf`` file: Mitsuba's tensor container with a JSON description.

        Parameters
        ----------
        path : str or Path
            Replaced as a whole or not at all.
        """
        tensors = {"params": self.vector().astype(np.float32)}
        for slot, mlp in self.brdf.networks.items():
            for k, (w, b) in enumerate(mlp.layers):
                tensors[f"{slot}.layers.{k}.weights"], tensors[f"{slot}.layers.{k}.bias"] = w, b
        if self.brdf.compact:
            tensors["compact"] = _flat(self.brdf.compact)
        if self.library is not None:
            tensors["library"] = self.library.astype(np.float32)
        with replacing(path) as temporary:
            tensor_file.write(temporary, {"description": json.dumps(self._description()), **tensors})

    @staticmethod
    def load(path: str | Path) -> Material:
        """Read a material or a network.

        Raises
        ------
        FileNotFoundError, ValueError
            If the file is missing, damaged, newer than this package, or of another kind (such as a measured file).
        """
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
        for slot, mlp in template.networks.items():
            layers = []
            for k, (w, b) in enumerate(mlp.layers):
                names = f"{slot}.layers.{k}.weights", f"{slot}.layers.{k}.bias"
                for name, expected in zip(names, (w, b), strict=True):
                    if name not in arrays or arrays[name].shape != expected.shape:
                        got = arrays[name].shape if name in arrays else "nothing"
                        raise ValueError(
                            f"{where}: {name} should have shape {expected.shape}; got {got}. Save it again."
                        )
                layers.append(tuple(arrays[name].astype(np.float32) for name in names))
            networks[slot] = dataclasses.replace(mlp, layers=tuple(layers))
        brdf = dataclasses.replace(
            template, networks=networks, compact=_compact(description, arrays.get("compact"), template, where)
        )
        library = arrays.get("library")
        return _assemble(brdf, arrays["params"], description, where, library)

    @staticmethod
    def from_arrays(description: str, params, weights) -> Material:
        """Rebuild what :meth:`to_dict` took apart."""
        where = 'bsdf "enhanced"'
        parsed = _read_description(description.encode(), where)
        template = _template(parsed, where)
        flat = np.asarray(weights, np.float32).ravel()
        own, rest = flat[: template.n_weights], flat[template.n_weights :]
        if len(own) != template.n_weights or (len(rest) and "compact" not in parsed):
            raise ValueError(f"{where}: {len(flat)} weights given, {template.n_weights} expected for {template}.")
        brdf = dataclasses.replace(
            template,
            networks=unflatten(template.networks, own),
            compact=_compact(parsed, rest, template, where),
        )
        return _assemble(brdf, np.asarray(params), parsed, where, None)

    def _description(self) -> dict:
        brdf = self.brdf
        return {
            "kind": _KIND,
            "format": FORMAT,
            "equation": str(brdf),
            "model": brdf.model.name,
            "model_text": brdf.model.text,
            "terms": dict(brdf.model.terms),
            "replace": {slot: list(mlp.sizes[1:-1]) for slot, mlp in brdf.networks.items()},
            "n_latent": brdf.n_latent,
            "inputs": brdf.inputs,
            "modulated": any(mlp.modulated for mlp in brdf.networks.values()),
            "parameters": [[p.name, p.size] for p in brdf.parameters],
            **({"compact": [c.describe() for c in brdf.compact]} if brdf.compact else {}),
            "lobe_albedo": self.lobe_albedo,
            "energy": self.energy,
            **({"mixture": self.mixture._asdict()} if self.mixture else {}),
            "versions": {name: metadata.version(name) for name in ("mi-enhance", "mitsuba", "drjit", "numpy")},
            "report": self.report,
        }


def _by_name(components: list[str]) -> list[str]:
    """Names of parameters, with the number of their components where there are several.

    Examples
    --------
    >>> _by_name(["F0", "latent.03", "latent.07"])
    ['F0', 'latent (2)']
    """
    counts = Counter(str(name).partition(".")[0] for name in components)
    return [name if n == 1 else f"{name} ({n})" for name, n in counts.items()]


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
