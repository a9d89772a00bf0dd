"""A graph with some slots replaced by networks: the enhanced BRDF (paper, section 3)."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import drjit as dr
import mitsuba as mi

from ..analytic import geometry, parameters
from ..analytic.graph import Node
from ..analytic.models.model import Model
from . import baked
from .distilled_network import DistilledNetwork
from .inputs import COLOURLESS, names_of_parameters, of_directions, of_parameters
from .mlp import MLP

# Outputs of a network are logarithms of what they stand for, so every term stays positive and a product of terms is
# a sum that is easy to learn. Products must stay within float32's 3e38: two networks beside S, D and 1/E, which reach
# 10, 3e7 and 2.5e7, come to 2e33; three beside D and 1/E, four beside A, which reaches 1e5, or all five (S, D, F, G,
# 1/E) would overflow, and have less room each: 4e35, 1e31 and 4e32.
_MAX_LOG, _MAX_LOG_OF_MANY = 20.0, 15.0
# Floor of an operand before its logarithm is taken: an analytic operand may be exactly 0 (rho_s = 0, F0 = 0).
_MIN_OPERAND = 1e-6


@dataclasses.dataclass(frozen=True)
class EnhancedBRDF:
    """An analytic model, some of whose slots are networks. Immutable; prints as its equation.

    Parameters
    ----------
    model : Model
        The analytic model.
    modules : dict of str to MLP
        Neural modules by slot; an empty one is the analytic model itself.
    n_latent : int
        Number of neural parameters per material.
    inputs : {"symmetric", "shape", "own", "directions"}
        What the networks see, see :mod:`mi_enhance.neural.inputs`.
    distilled : tuple of DistilledNetwork
        Small networks that stand in for `modules`, for one set of parameters, see :mod:`mi_enhance.specialization.specialize`.
    """

    model: Model
    modules: Mapping[str, MLP]
    n_latent: int = 27
    inputs: str = "symmetric"
    distilled: tuple[DistilledNetwork, ...] = ()

    @property
    def parameters(self) -> tuple[parameters.Parameter, ...]:
        """The model's parameters, and those of the networks: ``asymmetry``, ``latent``, ``norm_B``, ..."""
        reads_latent = self.n_latent and any(m.n_folded for m in self.modules.values())
        asymmetry = (parameters.ASYMMETRY,) if self.inputs in COLOURLESS and self.modules else ()
        latent = (parameters.latent(self.n_latent),) if reads_latent else ()
        norms = (parameters.norm(slot) for slot, mlp in self.modules.items() if mlp.n_folded) if asymmetry else ()
        return (*self.model.parameters, *asymmetry, *latent, *norms)

    @property
    def evaluated(self) -> dict[str, MLP]:
        """Those of the networks that no compact one stands in for."""
        covered = {slot for c in self.distilled for name in c.slots for slot in self.model.graph.find(name).slots}
        return {slot: mlp for slot, mlp in self.modules.items() if slot not in covered}

    @property
    def read_by_networks(self) -> tuple[str, ...]:
        """Names of the parameters that are folded into the networks."""
        if not any(m.n_folded for m in self.evaluated.values()):
            return ()
        return (*names_of_parameters(self.model, self.inputs), *(("latent",) if self.n_latent else ()))

    @property
    def n_weights(self) -> int:
        """Floats in all networks."""
        return sum(m.n_weights for m in self.modules.values())

    @property
    def n_parameters(self) -> int:
        """Floats per material."""
        return parameters.count(self.parameters)

    @property
    def state(self) -> tuple[int, ...]:
        """Enhancement state: one digit per slot, 1 where a network stands (section 4.1)."""
        return tuple(int(slot in self.modules) for slot in self.model.graph.slots)

    @property
    def multiply_adds(self) -> int:
        """Multiply-adds of all networks in one evaluation, once what is constant for a material is folded.

        Examples
        --------
        >>> enhance("ggx").multiply_adds
        4480
        """
        total = sum(c.multiply_adds for c in self.distilled)
        colours = parameters.colours(self.model.parameters)
        for slot, mlp in self.evaluated.items():
            sizes = (mlp.sizes[0] - mlp.n_folded, *mlp.sizes[1:])
            once = sum(a * b for a, b in zip(sizes, sizes[1:], strict=False)) if mlp.varies else 0
            node = self.model.graph.find(slot)
            total += once * (3 if node.args and node.reads(colours) else 1)  # channel by channel
        return total

    def __str__(self) -> str:
        return str(self.model.graph.replace(dict.fromkeys(self.modules)))

    def evaluators(self, kind: type = baked.Baked) -> dict:
        """One evaluator per slot: ``nn.Baked`` or ``nn.Cooperative``."""
        return {slot: kind(mlp) for slot, mlp in self.evaluated.items()}

    def fold(self, params: Mapping, evaluators: Mapping, begun: Mapping | None = None) -> dict[str, list[mi.Float]]:
        """What the networks need of the parameters: first biases, last layers, or all there is without directions.

        Parameters
        ----------
        params : dict
            Parameter values as Dr.Jit arrays, 1 lane for a uniform material or N lanes; colours RGB.
        evaluators : dict
            From :meth:`evaluators`, or ``nn.Trainable``.
        begun : dict, optional
            Result of :meth:`begin_fold`, of the values that are None in `params`.

        Returns
        -------
        dict of str to list of mi.Float
        """
        folded = self._fold(params, evaluators, begun)
        # A network without directions is constant, too, up to its output.
        return {slot: v if self.modules[slot].varies else evaluators[slot]([], v) for slot, v in folded.items()}

    def begin_fold(self, params: Mapping, evaluators: Mapping) -> dict[str, list[mi.Float]]:
        """The part of :meth:`fold` that is the same everywhere; values that vary over the surface are None."""
        return self._fold(params, evaluators, None)

    def _fold(self, params: Mapping, evaluators: Mapping, begun: Mapping | None) -> dict[str, list[mi.Float]]:
        # Operators see their operands only: with no other network the material has no latent numbers to read.
        constant = (
            of_parameters(params, self.inputs, self.model) if any(m.n_folded for m in self.evaluated.values()) else []
        )
        more = (lambda slot: ()) if begun is None else (lambda slot: (begun[slot],))
        return {
            slot: evaluators[slot].fold(constant if mlp.n_folded else [], *more(slot))
            for slot, mlp in self.evaluated.items()
        }

    def __call__(self, wi, wo, params: Mapping, evaluators: Mapping | None = None, folded: Mapping | None = None):
        """Reflectance f_r.

        Parameters
        ----------
        wi, wo : mi.Vector3f, N lanes
            Directions towards viewer and light, surface frame.
        params : dict
            Parameter values by name, 1 or N lanes each; ``rho_d``, ``rho_s`` may be spectra if `folded` is given.
        evaluators : dict, optional
            Network evaluators; ``nn.Baked`` by default.
        folded : dict, optional
            Result of :meth:`fold`, if it is at hand.

        Returns
        -------
        mi.Color3f or mi.Spectrum, N lanes
            1/sr, without the cosine; 0 below the horizon.

        Examples
        --------
        >>> brdf = enhance("ggx", replace=())
        >>> vector = parameters.flatten(brdf.parameters, parameters.initial(brdf.parameters))
        >>> params = parameters.unflatten(brdf.parameters, [mi.Float(v) for v in vector])
        >>> f = brdf(mi.Vector3f(0, 0, 1), mi.Vector3f(0, 0, 1), params)
        """
        graph, record, active = self.prepare(wi, wo, params, evaluators, folded)
        return graph(record) & active

    def prepare(self, wi, wo, params: Mapping, evaluators: Mapping | None = None, folded: Mapping | None = None):
        """The graph to evaluate, the record to evaluate it on, and the lanes above the horizon; as :meth:`__call__`."""
        quantities, active = geometry.local_quantities(wi, wo, params)
        record = {**quantities, **params}
        graph = self.model.graph
        if self.modules:
            evaluators = self.evaluators() if evaluators is None else evaluators
            folded = self.fold(params, evaluators) if folded is None else folded
            stand_ins = self._functions(record, wi, wo, evaluators, folded)
            graph = graph.replace(stand_ins)
        return graph, record, active

    def imitation_error(self, wi, wo, params: Mapping, evaluators: Mapping):
        """Mean squared difference of the logarithms of each network and the term or operator it replaces.

        Same arguments as :meth:`__call__`; the operands of an operator are those of the analytic model.
        """
        frame = geometry.frame_of(params)
        up = mi.Vector3f(0, 0, 1)
        local_i, local_o = (dr.select(v.z > 0.01, v, up) for v in (frame.to_local(wi), frame.to_local(wo)))
        record = {**geometry.quantities(local_i, local_o), **params}
        folded = self.fold(params, evaluators)
        functions = self._functions(record, wi, wo, evaluators, folded)
        # 1e-3: a Fresnel term or an albedo below it is dark; its logarithm need not be met
        log = lambda v: dr.log(v + 1e-3)  # noqa: E731
        error = 0
        for slot in self.modules:
            node = self.model.graph.find(slot)
            value = functions[slot](*(a(record) for a in node.args)) if node.args else functions[slot](record)
            error += dr.mean(dr.square(log(value) - log(node(record))), axis=None)
        return error

    def _functions(self, record: Mapping, wi, wo, evaluators: Mapping, folded: Mapping) -> dict:
        """The callables that stand in for the slots with networks."""
        nodes = [self.model.graph.find(slot) for slot in self.evaluated]
        x, limits = of_directions(record, self.inputs, wi, wo, nodes), self._max_logs()
        functions = {
            slot: self._function(slot, x[slot], evaluators[slot], folded[slot], limits[slot]) for slot in self.evaluated
        }
        for c in self.distilled:
            values = [_exp(y, limits.get(slot, _MAX_LOG)) for slot, y in zip(c.slots, c(record), strict=True)]
            functions |= {slot: lambda *_, y=y: y for slot, y in zip(c.slots, values, strict=True)}
        return functions

    def _max_logs(self) -> dict[str, float]:
        """Largest logarithm, of either sign, that each network stands for: fewer digits where three are factors."""
        result = {}

        def close(factors: list[str]) -> None:
            result.update(dict.fromkeys(factors, _MAX_LOG if len(factors) < 3 else _MAX_LOG_OF_MANY))

        def factors(node: Node) -> list[str]:
            """Networks that are multiplied with one another in `node`; one of an operator takes its operands' place."""
            below = [factors(a) for a in node.args]
            if node.symbol == "*" and node.name not in self.modules:
                return [name for names in below for name in names]
            for names in below:
                close(names)
            return [node.name] if node.name in self.modules else []

        close(factors(self.model.graph))
        return result

    def _function(self, slot: str, x: Sequence, evaluator, bias: Sequence, limit: float):
        """The callable that stands in for `slot`."""
        if self.model.graph.find(slot).args:
            return lambda a, b: _operator(evaluator, bias, a, b, limit)
        mlp, name = self.modules[slot], f"norm_{slot}"

        def term(record):
            values = evaluator(x, bias) if mlp.varies else bias
            out = [_exp(y + record[name] if name in record else y, limit) for y in values]
            return out[0] if len(out) == 1 else mi.Color3f(*out)

        if self.inputs in COLOURLESS and mlp.sizes[-1] == 3:
            # Colours are no inputs: such a network scales the term it stands for, and f stays linear in its colour.
            node = self.model.graph.find(slot)
            return lambda record: node(record) * term(record)
        return term


def _exp(y, limit: float):
    return dr.exp(dr.clip(y, -limit, limit))


def _operator(evaluator, bias, a, b, limit: float):
    """A network of the two operands' logarithms; colours go through it one channel after the other."""

    def one(a, b):
        (y,) = evaluator([dr.log(dr.maximum(v, _MIN_OPERAND)) for v in (a, b)], bias)
        return _exp(y, limit)

    n = max(dr.size_v(a) if dr.depth_v(a) > 1 else 1, dr.size_v(b) if dr.depth_v(b) > 1 else 1)
    if n == 1:
        return one(a, b)
    channel = lambda v, k: v[k] if dr.depth_v(v) > 1 else v  # noqa: E731
    return (type(a) if dr.depth_v(a) > 1 else type(b))(*(one(channel(a, k), channel(b, k)) for k in range(n)))
