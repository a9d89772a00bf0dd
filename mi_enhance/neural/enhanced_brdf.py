"""A graph with some slots replaced by modules: the enhanced BRDF (paper, section 3)."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import mitsuba as mi

from ..analytic import geometry, parameters
from ..analytic.graph import Node
from ..analytic.models.model import Model
from ..analytic.parameters import MAX_LOG
from . import baked, replacements
from .distilled_network import DistilledNetwork
from .evaluator import Evaluator, Evaluators
from .inputs import COLOURLESS, InputKind, of_directions
from .mlp import MLP
from .parameter_inputs import names_of_parameters, of_parameters
from .trunk import BASIS, NAME, Trunk


@dataclasses.dataclass(frozen=True)
class EnhancedBRDF:
    """An analytic model with modules in some slots. Immutable; prints as its equation.

    Parameters
    ----------
    model : Model
        The analytic model.
    modules : dict of str to MLP
        Neural modules by slot; an empty one is the analytic model itself.
    n_latent : int
        Number of neural parameters per material.
    inputs : {"symmetric", "shape", "reciprocal", "own", "directions"}
        The inputs of the modules, see :mod:`mi_enhance.neural.inputs`.
    trunk : Trunk, optional
        One network for several slots, which the material reads out by weights of its own.
    distilled : tuple of DistilledNetwork
        Small networks that replace `modules` for one set of parameters, see
        :mod:`mi_enhance.specialization.specialize`.
    reference : dict of str to float, optional
        Roughnesses at which factors in RGB were learned, if the material was edited to others: networks then see the
        half vector where it stood, relative to the lobe of their slot, and never an angle that they have not learned.
    """

    model: Model
    modules: Mapping[str, MLP]
    n_latent: int = 27
    inputs: InputKind = "symmetric"
    trunk: Trunk | None = None
    distilled: tuple[DistilledNetwork, ...] = ()
    reference: Mapping[str, float] | None = None

    @property
    def parameters(self) -> tuple[parameters.Parameter, ...]:
        """The model's parameters, and those of the networks: ``asymmetry``, ``latent``, ``norm_B``..., ``read_out``."""
        reads_latent = self.n_latent and any(m.n_folded for m in self.networks.values())
        networks = self.networks or self.distilled
        asymmetry = (parameters.ASYMMETRY,) if self.inputs in COLOURLESS and networks else ()
        latent: tuple[parameters.Parameter, ...] = (parameters.latent(self.n_latent),) if reads_latent else ()
        if self.trunk and self.trunk.basis:
            latent += tuple(parameters.norm(slot, self.trunk.channels) for slot in self.trunk.slots)
            latent += (parameters.code(self.trunk.n_codes),)
        elif self.trunk:
            latent += (parameters.read_out(self.trunk.size),)
        norms = (parameters.norm(slot) for slot, mlp in self.modules.items() if mlp.n_folded) if asymmetry else ()
        return (*self.model.parameters, *asymmetry, *latent, *norms)

    @property
    def networks(self) -> dict[str, MLP]:
        """All networks with shared weights: the modules by slot, and the trunk."""
        return {**self.modules, **(self.trunk.networks if self.trunk else {})}

    def with_networks(self, networks: Mapping[str, MLP]) -> EnhancedBRDF:
        """Return the BRDF with other weights, of the same shapes as :attr:`networks`."""
        modules = {slot: networks[slot] for slot in self.modules}
        trunk = self.trunk.with_networks(networks) if self.trunk else None
        return dataclasses.replace(self, modules=modules, trunk=trunk)

    @property
    def evaluated(self) -> dict[str, MLP]:
        """Networks that are evaluated, i.e. not replaced by a distilled one; one in RGB scales the analytic model."""
        if any(c.channels == 3 for c in self.distilled):
            return {}
        covered = {slot for c in self.distilled for name in c.slots for slot in self.model.graph.find(name).slots}
        read = self.trunk.networks if self.trunk and set(self.read_slots) - covered else {}
        return {**{slot: mlp for slot, mlp in self.modules.items() if slot not in covered}, **read}

    @property
    def read_slots(self) -> tuple[str, ...]:
        """Slots of the trunk that the model still has: :mod:`mi_enhance.neural.simplify` may have left some out."""
        return tuple(slot for slot in self.trunk.slots if slot in self.model.graph.slots) if self.trunk else ()

    @property
    def has_free_read_out(self) -> bool:
        """True if a material has the hundreds of numbers of a read-out of its own."""
        return self.trunk is not None and self.trunk.basis is None

    @property
    def read_by_modules(self) -> tuple[str, ...]:
        """Names of the parameters that are folded into the networks."""
        folding = {name for name, m in self.evaluated.items() if m.n_folded}
        analytic = names_of_parameters(self.model, self.inputs) if folding - {NAME} else ()
        return (*analytic, *(["latent"] if self.n_latent and folding else []))

    @property
    def n_weights(self) -> int:
        """Floats in all networks."""
        return sum(m.n_weights for m in self.networks.values())

    @property
    def n_parameters(self) -> int:
        """Floats per material."""
        return parameters.count(self.parameters)

    @property
    def state(self) -> tuple[int, ...]:
        """Enhancement state: one digit per slot, 1 where a network stands (section 4.1)."""
        return tuple(int(slot in self._slots) for slot in self.model.graph.slots)

    @property
    def _slots(self) -> tuple[str, ...]:
        evaluated = self.evaluated
        read = self.read_slots if NAME in evaluated else ()
        return (*(evaluated.keys() & self.modules.keys()), *read, *(slot for c in self.distilled for slot in c.slots))

    @property
    def multiply_adds(self) -> int:
        """Multiply-adds of all modules in one evaluation, after the inputs that are constant for a material are folded.

        Examples
        --------
        >>> from mi_enhance import enhance
        >>> enhance("ggx").multiply_adds
        4480
        """
        evaluated, colours = self.evaluated, parameters.colours(self.model.parameters)
        total = sum(c.multiply_adds for c in self.distilled)
        total += self.trunk.multiply_adds if self.trunk and NAME in evaluated else 0
        for slot in self.modules.keys() & evaluated.keys():
            node = self.model.graph.find(slot)
            total += evaluated[slot].multiply_adds * (3 if node.args and node.reads(colours) else 1)  # by channel
        return total

    def __str__(self) -> str:
        return str(self.model.graph.replace(dict.fromkeys(self._slots, repr)))  # any function: brackets are printed

    def evaluators(self, kind: Callable[[MLP], Evaluator] = baked.Baked) -> dict[str, Evaluator]:
        """Return an evaluator of that kind for each slot."""
        return {slot: kind(mlp) for slot, mlp in self.evaluated.items()}

    def fold(self, params: Mapping, evaluators: Evaluators, begun: Mapping | None = None) -> dict[str, list[mi.Float]]:
        """Compute all that the modules need of the parameters, see :meth:`mi_enhance.neural.evaluator.Evaluator.fold`.

        Parameters
        ----------
        params : dict
            Parameter values as Dr.Jit arrays, 1 lane for a uniform material or N lanes; colours RGB.
        evaluators : dict of str to Evaluator, or Trainable
            See :meth:`evaluators`.
        begun : dict, optional
            Result of :meth:`begin_fold`, of the values that are None in `params`.

        Returns
        -------
        dict of str to list of mi.Float
            By slot: first bias and modulated last layer, or the outputs of a module without directions.
        """
        folded = self._fold(params, evaluators, begun)
        return {slot: v if self.networks[slot].varies else evaluators[slot]([], v) for slot, v in folded.items()}

    def begin_fold(self, params: Mapping, evaluators: Evaluators) -> dict[str, list[mi.Float]]:
        """Do the part of :meth:`fold` that is the same everywhere; values that vary over the surface are None."""
        return self._fold(params, evaluators, None)

    def _fold(self, params: Mapping, evaluators: Evaluators, begun: Mapping | None) -> dict[str, list[mi.Float]]:
        # Operators see their operands only: with no other module the material has no latent numbers to read.
        folding = {slot for slot, mlp in self.evaluated.items() if mlp.n_folded}
        constant = of_parameters(params, self.inputs, self.model) if folding - {NAME} else []
        result = {}
        for slot in (s for s in self.evaluated if s != BASIS):  # which has no constant inputs
            features = (list(params["latent"]) if slot == NAME else constant) if slot in folding else []
            result[slot] = evaluators[slot].fold(features, None if begun is None else begun[slot])
        return result

    def __call__(
        self, wi: Any, wo: Any, params: Mapping, evaluators: Evaluators | None = None, folded: Mapping | None = None
    ) -> Any:
        """Evaluate the reflectance f_r.

        Parameters
        ----------
        wi, wo : mi.Vector3f, N lanes
            Directions towards viewer and light, surface frame.
        params : dict
            Parameter values by name, 1 or N lanes each; ``rho_d``, ``rho_s`` may be spectra if `folded` is given.
        evaluators : dict of str to Evaluator, or Trainable, optional
            ``Baked`` ones by default.
        folded : dict, optional
            Result of :meth:`fold`, if it is at hand.

        Returns
        -------
        mi.Color3f or mi.Spectrum, N lanes
            1/sr, without the cosine; 0 below the horizon.

        Examples
        --------
        >>> from mi_enhance import enhance
        >>> brdf = enhance("ggx", replace=())
        >>> vector = parameters.flatten(brdf.parameters, parameters.initial(brdf.parameters))
        >>> params = parameters.unflatten(brdf.parameters, [mi.Float(v) for v in vector])
        >>> f = brdf(mi.Vector3f(0, 0, 1), mi.Vector3f(0, 0, 1), params)
        """
        graph, record, active = self.prepare(wi, wo, params, evaluators, folded)
        return graph(record) & active

    def prepare(
        self, wi: Any, wo: Any, params: Mapping, evaluators: Evaluators | None = None, folded: Mapping | None = None
    ) -> tuple[Node, dict[str, Any], Any]:
        """Return the graph to evaluate, its record, and the lanes above the horizon; arguments as :meth:`__call__`."""
        quantities, active = geometry.local_quantities(wi, wo, params)
        record = {**quantities, **params}
        graph = self.model.graph
        if self.networks or self.distilled:
            evaluators = self.evaluators() if evaluators is None else evaluators
            folded = self.fold(params, evaluators) if folded is None else folded
            graph = graph.replace(self.replacements(record, wi, wo, evaluators, folded))
        return graph, record, active

    def replacements(
        self, record: Mapping, wi: Any, wo: Any, evaluators: Evaluators, folded: Mapping
    ) -> dict[str, Callable]:
        """Return the functions that replace the slots with modules.

        Parameters
        ----------
        record : dict
            Quantities in the material's frame, and parameters.
        wi, wo : mi.Vector3f
            Directions in the frame of the surface.
        evaluators : dict of str to Evaluator, or Trainable
        folded : dict
            Result of :meth:`fold`.

        Returns
        -------
        dict of str to callable
            A function of the record for a term, of the two operands for an operator.
        """
        graph, slots = self.model.graph, [slot for slot in self.evaluated if slot in self.modules]
        x = of_directions(record, self.inputs, wi, wo, map(graph.find, slots))
        limits = replacements.max_logs(graph, self.modules) if self.modules else {}
        functions = {
            slot: self._function(slot, x[slot], evaluators[slot], folded[slot], limits[slot]) for slot in slots
        }
        if self.trunk and NAME in self.evaluated:
            for group, seen in self._seen(self.read_slots, record):
                units = self.units(seen, wi, wo, evaluators, folded)
                logs = self.trunk.logs(group, units, record, evaluators)
                functions |= replacements.scaled(graph, group, logs, record)
        for c in self.distilled:
            if c.channels == 3:
                for group, seen in self._seen(c.slots, record):
                    part = c.without(set(c.slots) - set(group), ())
                    functions |= replacements.scaled(graph, group, part(seen)) if part else {}
                continue
            for slot, y in zip(c.slots, c(record), strict=True):
                factor = replacements.factor(y, limits.get(slot, MAX_LOG))
                functions[slot] = lambda *_, factor=factor: factor
        return functions

    def _seen(self, slots: Sequence[str], record: Mapping) -> list[tuple[Sequence[str], Mapping]]:
        """Return the slots, and the record that they see: each has its own where the roughness was edited."""
        if self.reference is None:
            return [(slots, record)]
        graph = self.model.graph
        return [((slot,), replacements.as_learned(record, graph.find(slot), self.reference)) for slot in slots]

    def units(self, record: Mapping, wi: Any, wo: Any, evaluators: Evaluators, folded: Mapping) -> list[mi.Float]:
        """Return the units of the trunk before the leaky ReLU; arguments as :meth:`replacements`."""
        node = self.model.graph.find(self.read_slots[0])
        x = of_directions(record, self.inputs, wi, wo, [node])[node.name]
        return evaluators[NAME](x, folded[NAME])

    def _function(self, slot: str, x: Sequence, evaluator: Evaluator, bias: Sequence, limit: float) -> Callable:
        """Return the function that replaces `slot`."""
        node, mlp = self.model.graph.find(slot), self.modules[slot]
        if node.args:
            return lambda a, b: replacements.operator(evaluator, bias, a, b, limit)

        def term(record):
            return replacements.term(evaluator(x, bias) if mlp.varies else bias, record, f"norm_{slot}", limit)

        if self.inputs in COLOURLESS and mlp.sizes[-1] == 3:
            # Colours are no inputs: such a module scales the term in its slot, and f stays linear in its colour.
            return lambda record: node(record) * term(record)
        return term
