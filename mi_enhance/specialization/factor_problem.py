"""The factors of a material that a small network has to reproduce."""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from ..analytic import parameters
from ..analytic.graph import Node
from ..analytic.parameters import MAX_LOG
from ..fitting.losses import log_l1
from ..material.material import Material
from ..neural import inputs as inputs_module
from ..neural import trainable
from ..neural.distilled_network import DistilledNetwork
from ..neural.enhanced_brdf import EnhancedBRDF
from ..numerics.arrays import vector3f
from . import distillation

# Weight of a factor without effect on f, as the diffuse one of a black metal: an edit of its colour can bring it to
# light.
_MIN_WEIGHT = 1e-3


class FactorProblem:
    """The exact material on pairs of directions: features, logarithms of the factors, and their effect on f.

    Parameters
    ----------
    material : Material
    slots : tuple of str
        The factors, as :func:`factors_of` finds them.
    wi, wo : array (N, 3)
        Unit vectors.
    """

    def __init__(self, material: Material, slots: tuple[str, ...], wi: np.ndarray, wo: np.ndarray):
        brdf, self.slots, n = material.brdf, slots, len(wi)
        params = material.as_drjit()
        evaluators = trainable.Trainable(brdf.modules)  # baked weights take long to compile outside of a virtual call
        dr.disable_grad(evaluators.weights)
        graph, record, active = brdf.prepare(vector3f(wi), vector3f(wo), params, evaluators)
        named, factors = inputs_module.named(record), [graph.find(slot)(record) for slot in slots]
        dr.eval(named, factors)
        self.features = {
            name: np.array(named[name], np.float64) for name in inputs_module.names_of(brdf.inputs) if name in named
        }
        # 1e-20: an analytic operand may be 0
        self.logs = np.stack([np.log(np.maximum(np.array(v, np.float64), 1e-20)) for v in factors], 1)
        # f = rest + the sum of coefficients times factors: the graph with 0 and 1 in the place of the factors
        rest, *ones = (self._f(graph, record, active, n, slot) for slot in (None, *slots))
        self.rest, self.coefficients = rest, np.stack([f - rest for f in ones], 1)
        self.cos, self.exact = wo[:, 2:].astype(np.float64), rest + self._sum(self.logs)
        # derivative of log(1 + f cos), mean over the channels, with respect to the logarithm of a factor
        slopes = self._slopes(self.logs, self.exact, slice(None))
        self.weights = (slopes.mean(1) + _MIN_WEIGHT).astype(np.float32)

    def _f(self, graph: Node, record: dict, active: Any, n: int, one: str | None) -> np.ndarray:
        stand_ins = {slot: lambda *_, v=float(slot == one): mi.Float(v) for slot in self.slots}
        f = mi.Color3f(graph.replace(stand_ins)(record)) & active
        return np.array(f + dr.zeros(mi.Color3f, n), np.float64).T

    def columns(self, inputs: tuple[str, ...]) -> np.ndarray:
        """Return the features named `inputs`, (N, inputs)."""
        return np.stack([self.features[name] for name in inputs], 1)

    def _sum(self, logs: np.ndarray, index: slice = slice(None)) -> np.ndarray:
        return np.einsum("nmc,nm->nc", self.coefficients[index], np.exp(np.clip(logs, -MAX_LOG, MAX_LOG)))

    def _slopes(self, logs: np.ndarray, f: np.ndarray, index: slice) -> np.ndarray:
        """Derivatives (n, channels, factors) of log(1 + f cos)."""
        factor = np.exp(np.clip(logs, -MAX_LOG, MAX_LOG))
        cos = self.cos[index]
        return np.einsum("nmc,nm,nc->ncm", self.coefficients[index], factor, cos / (1 + f * cos))

    def error(self, compact: tuple[DistilledNetwork, ...]) -> float:
        """Return the mean absolute difference of log(1 + f cos) of small networks to the exact material."""
        logs = np.concatenate([distillation.forward(c.layers, self.columns(c.inputs)) for c in compact], 1)
        order = [slot for c in compact for slot in c.slots]
        f = self.rest + self._sum(logs[:, [order.index(slot) for slot in self.slots]])
        return log_l1(f, self.exact, self.cos[:, 0])

    def of_factors(self, logs: np.ndarray, index: slice) -> tuple[np.ndarray, np.ndarray]:
        """Return residuals of the factors' logarithms, weighted by their effect on f, and their slopes."""
        w = self.weights[: len(logs)] if index == slice(None) else self.weights[index]
        target = self.logs[: len(logs)] if index == slice(None) else self.logs[index]
        return w * (logs - target), w[:, :, None] * np.eye(w.shape[1], dtype=np.float32)


def factors_of(brdf: EnhancedBRDF) -> tuple[str, ...]:
    """Return the slots that one small network can stand in for: of each additive term the part with all its modules.

    Raises
    ------
    ValueError
        If a module sees colours, or there is none that sees directions.
    """
    colours = parameters.colours(brdf.model.parameters)
    wanted = {slot for slot, mlp in brdf.modules.items() if mlp.varies}
    result = _covers(brdf.model.graph, wanted)
    for node in result:
        if node.reads(colours):
            raise ValueError(
                f"specialize(): a network of {brdf} sees colours ({node.name}), so none of the directions alone can "
                "stand in for it. Specialize a material whose networks see none, such as one of ggx2."
            )
    if not result:
        raise ValueError(f"specialize(): {brdf} has no network of the directions: there is nothing to be made cheaper.")
    return tuple(node.name for node in result)


def _covers(node: Node, wanted: set[str]) -> list[Node]:
    """Return the smallest subgraphs that hold all of `wanted`: one for each operand of a sum."""
    if not wanted & set(node.slots):
        return []
    if not node.args or node.name in wanted:
        return [node]
    parts = [part for a in node.args for part in _covers(a, wanted)]
    return parts if node.symbol == "+" or len(parts) < 2 else [node]
