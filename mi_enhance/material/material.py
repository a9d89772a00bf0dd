"""A material: an enhanced BRDF, its parameters, and a report of how they were found. One file each, no pickle."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from pathlib import Path

import drjit as dr
import mitsuba as mi
import numpy as np

from ..analytic import parameters
from ..analytic.models import Model
from ..neural.enhance import enhance
from ..neural.enhanced_brdf import EnhancedBRDF
from ..neural.trainable import fused
from ..numerics.arrays import vector3f
from ..sampling import energy_bound, lobe_mixture
from ..sampling.lobe_mixture import Mixture
from ..system.bundled_files import DEFAULT_NETWORK, network_file
from ..system.checks import direction_pairs
from . import material_file
from .description import describe
from .low_rank import LowRank, of_free, of_low_rank
from .old_names import OldNames
from .reports import of_edited, of_shared
from .text import text_of


@dataclasses.dataclass(frozen=True, eq=False)
class Material(OldNames):
    """A material: the record that is saved, loaded, edited, shown and rendered.

    Parameters
    ----------
    brdf : EnhancedBRDF
        Model, state and network weights.
    params : dict of str to array
        Parameter values, float64; completed with the starting values if some are left out.
    report : dict
        How it was made: errors, seconds, settings. JSON types only; see :mod:`mi_enhance.material.reports`.
    library : array (M, n_parameters), optional
        Parameters of the training materials: where fits start. Only networks carry one, fitted materials do not.
    lobe_albedo : float
        Albedo of the lobes for rho_s = 1: how often quadratures draw them, see :mod:`mi_enhance.sampling.albedo`.
    mixture : Mixture, optional
        How it is sampled, found by :func:`mi_enhance.sampling.mixture_fit.fit_mixture`; made of `lobe_albedo` if left
        out.
    bound_energy : bool
        Hold the directional albedo at 1 or below, whatever the parameters are edited to, see
        :mod:`mi_enhance.sampling.energy_bound`.
    exact_params : dict of str to array, optional
        Parameters before the material got a network of its own, whose training moves them: :attr:`unspecialized` has
        them.
    exact_reference : dict of str to float, optional
        `brdf.reference` of that material.
    low_rank : LowRank, optional
        Of a network with free read-outs: the basis, and the training materials with codes.

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
    exact_params: dict | None = None
    exact_reference: Mapping[str, float] | None = None
    low_rank: LowRank | None = None

    def __post_init__(self):
        values = {**parameters.initial(self.brdf.parameters), **self.params}
        object.__setattr__(self, "params", parameters.check(self.brdf.parameters, values, "Material"))

    def __reduce__(self):
        raise TypeError(
            "Material: not to be pickled, a pickle would run code when it is read and break with the next version. "
            "Give other processes the file: material.save(path) here, Material.load(path) there."
        )

    def __copy__(self, memo: dict | None = None) -> Material:  # else the copy module would pickle
        return self.edit()

    __deepcopy__ = __copy__

    # ------------------------------------------------------------------ where they come from

    @staticmethod
    def analytic(model: Model | str) -> Material:
        """Return an analytic model, or the one of that name, without modules and at its starting values."""
        return Material(enhance(model, replace=()), {})

    @staticmethod
    def pretrained(name: str = DEFAULT_NETWORK, *, low_rank: bool = False) -> Material:
        """A network shipped with the package, ready to be fitted.

        Parameters
        ----------
        name : str
            Of the network.
        low_rank : bool
            Give a material a code of a few numbers in place of hundreds of its own, see
            :mod:`mi_enhance.material.low_rank`: for texels, textures and photographs.
        """
        material = Material.load(network_file(name))
        return of_low_rank(material, f'Material.pretrained("{name}")') if low_rank else material

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

        Notes
        -----
        Roughness and F0 mean what they mean to the analytic model: factors in RGB are scaled so that every term
        reflects, to its analytic one, as much as before. That needs a JIT variant. Latent numbers and read-outs of a
        material with a network of its own show in `unspecialized`. ``report["edited"]`` names what has been edited.
        """
        from . import colour_normalization  # which makes materials itself

        changed = parameters.check(self.brdf.parameters, {**self.params, **values}, "Material.edit()")
        edited = dataclasses.replace(self, params=changed, report=of_edited(self.report, values))
        if self.exact_params:
            exact = self.unspecialized.edit(**values)
            edited = dataclasses.replace(edited, exact_params=exact.params, exact_reference=exact.brdf.reference)
        return colour_normalization.reshaped(edited, self) if self.factors_in_rgb else edited

    @property
    def factors_in_rgb(self) -> bool:
        """True if terms are scaled in RGB, by read-outs of a trunk or by a network of the material's own."""
        brdf = self.brdf
        return any(c.channels == 3 for c in brdf.distilled) or (brdf.trunk is not None and brdf.trunk.channels == 3)

    def bounded(self) -> Material:
        """A copy whose directional albedo is at most 1 for every view, also when it is edited.

        Examples
        --------
        >>> Material.analytic("ward").bounded().bound_energy
        True
        """
        return dataclasses.replace(self, bound_energy=True)

    @property
    def free(self) -> Material:
        """The same material with a read-out of its own in place of a code; the same if it has no code."""
        return of_free(self)

    @property
    def unspecialized(self) -> Material:
        """The material that a specialized one was made from; the same if it is not specialized."""
        params, reference = self.params, self.brdf.reference
        if self.exact_params:
            params, reference = self.exact_params, self.exact_reference
            reference = None if reference == roughnesses(params) else reference
        brdf = dataclasses.replace(self.brdf, distilled=(), reference=reference)
        changed = dataclasses.replace(self, brdf=brdf, params=params, report=of_shared(self.report))
        return dataclasses.replace(changed, exact_params=None, exact_reference=None)

    def _repr_html_(self) -> str:
        from .portrait import page

        return page(self)

    def show(self) -> str:
        """A text: equation, parameters, report."""
        return text_of(self)

    @property
    def n_bytes(self) -> int:
        """Bytes that belong to this material alone, as float32; the weights are shared."""
        return 4 * self.brdf.n_parameters

    @property
    def reciprocal(self) -> bool:
        """True if f(wi, wo) = f(wo, wi) by construction: the networks, if any, do not tell viewer from light."""
        asymmetric = self.brdf.inputs != "reciprocal" and self.params.get("asymmetry", np.zeros(1)).any()
        return self.brdf.inputs != "directions" and not asymmetric

    @property
    def sampled_by(self) -> Mixture:
        """The mixture that draws directions: :attr:`mixture`, or one of `lobe_albedo`; needs a JIT variant."""
        return self.mixture or lobe_mixture.of_lobe_albedo(
            len(self.brdf.model.lobes(self.as_drjit())), self.lobe_albedo
        )

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
            Linear RGB, float32; 0 below the horizon.

        Raises
        ------
        ValueError
            If the shapes are not both (N, 3), or a direction is not finite or not of length 1.

        Examples
        --------
        >>> Material.analytic("ggx").edit(rho_s=0).evaluate([[0, 0, 1]], [[0, 0.6, 0.8]]).round(3)
        array([[0.159, 0.159, 0.159]], dtype=float32)
        """
        view, light = map(vector3f, direction_pairs(wi, wo, "Material.evaluate()"))
        params = self.as_drjit()
        dr.make_opaque(params)  # data: all materials of one network share a kernel
        f = self.brdf(view, light, params, fused(self.brdf.networks))
        if self.bound_energy:
            bound = energy_bound.table(self.brdf, params, self.lobe_albedo)
            f = energy_bound.bounded(f, bound, view, light, params)
        return np.array(f).T

    def bsdf(self) -> mi.BSDF:
        """The Mitsuba BSDF, straight from memory; the same as saving and loading by ``filename``."""
        return mi.load_dict(self.to_dict())

    def to_dict(self) -> dict:
        """The dictionary that ``mi.load_dict`` takes, to be placed in a scene."""
        return {
            "type": "enhanced",
            "description": json.dumps(describe(self)),
            "params": mi.Float(self.as_vector().astype(np.float32)),
            "weights": mi.Float(material_file.weights(self.brdf)),
        }

    # ------------------------------------------------------------------ files

    def save(self, path: str | Path) -> None:
        """Write one self-contained ``.bsdf`` file: Mitsuba's tensor container with a JSON description.

        Parameters
        ----------
        path : str or Path
            Replaced as a whole or not at all.
        """
        material_file.write(path, self)

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


def load_material(path: str | Path) -> Material:
    """Read a material or a network; the same as :meth:`Material.load`.

    Examples
    --------
    >>> load_material("gold.bsdf")  # doctest: +SKIP
    """
    return Material.load(path)


def roughnesses(params: Mapping[str, np.ndarray]) -> dict[str, float]:
    """Return the numbers among parameter values that are roughnesses."""
    return {name: float(v[0]) for name, v in params.items() if name.startswith("alpha_")}
