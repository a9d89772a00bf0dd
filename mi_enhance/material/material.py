"""A material: an enhanced BRDF, its parameters, and a report of how they were found. One file each, no pickle."""

from __future__ import annotations

import dataclasses
import json
from collections import Counter
from importlib import metadata
from pathlib import Path

import mitsuba as mi
import numpy as np

from ..analytic import parameters
from ..neural.enhance import enhance
from ..neural.enhanced_brdf import EnhancedBRDF
from ..neural.mlp import flatten
from ..sampling import energy_bound, lobe_mixture
from ..sampling.lobe_mixture import Mixture
from ..system import tensor_file
from ..system.bundled_files import DEFAULT_NETWORK, network_file
from ..system.files import replacing
from . import material_file
from .old_names import OldNames


@dataclasses.dataclass(frozen=True, eq=False)
class Material(OldNames):
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
        How it is sampled, found by :func:`mi_enhance.sampling.mixture_fit.fit_mixture`; by `lobe_albedo` alone if left out.
    bound_energy : bool
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
    bound_energy: bool = False
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
    def pretrained(name: str = DEFAULT_NETWORK) -> Material:
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
        >>> Material.analytic("ward").bounded().bound_energy
        True
        """
        return dataclasses.replace(self, bound_energy=True)

    @property
    def unspecialized(self) -> Material:
        """The material that :func:`mi_enhance.specialization.specialize` made this one from; itself if it is none of those."""
        report = {key: value for key, value in self.report.items() if not key.startswith("specialize_")}
        return dataclasses.replace(self, brdf=dataclasses.replace(self.brdf, distilled=()), report=report)

    def show(self) -> str:
        """A text: equation, parameters, report."""
        lines = [str(self.brdf)]
        for p in self.brdf.parameters:
            lines.append(f"  {p.name:<8} {' '.join(f'{v:.4g}' for v in self.params[p.name])}")
        for c in self.brdf.distilled:
            lines.append(
                f"  {', '.join(c.slots)} from a network {'-'.join(map(str, c.sizes))} of {', '.join(c.inputs)}"
            )
        lines.append(
            f"  {self.brdf.n_parameters} parameters ({self.n_bytes} bytes), {self.brdf.n_weights} shared weights, "
            f"inputs: {self.brdf.inputs}"
        )
        if self.bound_energy:
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

    def as_vector(self) -> np.ndarray:
        """All parameters in order, float64."""
        return parameters.flatten(self.brdf.parameters, self.params)

    def as_drjit(self) -> dict:
        """All parameters by name as Dr.Jit arrays of one lane, as an :class:`EnhancedBRDF` takes them."""
        return parameters.unflatten(self.brdf.parameters, [mi.Float(float(v)) for v in self.as_vector()])

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
        params = self.as_drjit()
        f = self.brdf(wi, wo, params)
        if self.bound_energy:
            shares = lobe_mixture.shares(params, self.lobe_albedo, self.brdf.model)
            bound = energy_bound.table(self.brdf, params, shares)
            f = energy_bound.bounded(f, bound, wi, wo, params)
        return np.array(f).T

    def bsdf(self) -> mi.BSDF:
        """The Mitsuba BSDF, straight from memory; the same as saving and loading by ``filename``."""
        return mi.load_dict(self.to_dict())

    def to_dict(self) -> dict:
        """The dictionary that ``mi.load_dict`` takes, to be placed in a scene."""
        return {
            "type": "enhanced",
            "description": json.dumps(self._description()),
            "params": mi.Float(self.as_vector().astype(np.float32)),
            "weights": mi.Float(np.concatenate([flatten(self.brdf.modules), material_file.flat(self.brdf.distilled)])),
        }

    # ------------------------------------------------------------------ files

    def save(self, path: str | Path) -> None:
        """Write one self-contained ``.bsdf`` file: Mitsuba's tensor container with a JSON description.

        Parameters
        ----------
        path : str or Path
            Replaced as a whole or not at all.
        """
        tensors = {"params": self.as_vector().astype(np.float32)}
        for slot, mlp in self.brdf.modules.items():
            for k, (w, b) in enumerate(mlp.layers):
                tensors[f"{slot}.layers.{k}.weights"], tensors[f"{slot}.layers.{k}.bias"] = w, b
        if self.brdf.distilled:
            tensors["compact"] = material_file.flat(self.brdf.distilled)
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
        return Material(**material_file.read(path))

    @staticmethod
    def from_arrays(description: str, params, weights) -> Material:
        """Rebuild what :meth:`to_dict` took apart."""
        return Material(**material_file.from_arrays(description, params, weights))

    def _description(self) -> dict:
        brdf = self.brdf
        return {
            "kind": material_file.KIND,
            "format": material_file.FORMAT,
            "equation": str(brdf),
            "model": brdf.model.name,
            "model_text": brdf.model.text,
            "terms": dict(brdf.model.terms),
            "replace": {slot: list(mlp.sizes[1:-1]) for slot, mlp in brdf.modules.items()},
            "n_latent": brdf.n_latent,
            "inputs": brdf.inputs,
            "modulated": any(mlp.modulated for mlp in brdf.modules.values()),
            "parameters": [[p.name, p.size] for p in brdf.parameters],
            **({"compact": [c.describe() for c in brdf.distilled]} if brdf.distilled else {}),
            "lobe_albedo": self.lobe_albedo,
            "energy": self.bound_energy,
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


def load_material(path: str | Path) -> Material:
    """Read a material or a network; the same as :meth:`Material.load`.

    Examples
    --------
    >>> load_material("gold.bsdf")  # doctest: +SKIP
    """
    return Material.load(path)
