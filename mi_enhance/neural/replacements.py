"""The functions that take the place of terms and operators of a graph, made of the outputs of modules."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any

import drjit as dr
import mitsuba as mi

from ..analytic import lobes
from ..analytic.graph import Node
from ..analytic.parameters import MAX_LOG
from .evaluator import Evaluator

# The output of a module is the logarithm of a factor, so every term stays positive and a product of terms is a sum that
# is easy to learn. Products must stay within float32's 3e38: two modules of MAX_LOG beside S, D and 1/E, which reach
# 10, 3e7 and 2.5e7, come to 2e33; three beside D and 1/E, four beside A, which reaches 1e5, or all five (S, D, F, G,
# 1/E) would overflow, and have less room each: 4e35, 1e31 and 4e32.
_MAX_LOG_OF_MANY = 15.0
# Floor of an operand before its logarithm is taken: an analytic operand may be exactly 0 (rho_s = 0, F0 = 0).
_MIN_OPERAND = 1e-6


def factor(y: Any, limit: float) -> Any:
    """Return the factor of which `y` is the logarithm, held within `limit` of either sign."""
    return dr.exp(dr.clip(y, -limit, limit))


def max_logs(graph: Node, slots: Collection[str]) -> dict[str, float]:
    """Return the largest logarithm, of either sign, of the module in each slot: less where three or more are factors.

    Examples
    --------
    >>> from mi_enhance import models
    >>> max_logs(models.get("ggx").graph, ["D", "F", "G"])
    {'D': 15.0, 'F': 15.0, 'G': 15.0}
    """
    result: dict[str, float] = {}

    def close(factors: list[str]) -> None:
        result.update(dict.fromkeys(factors, MAX_LOG if len(factors) < 3 else _MAX_LOG_OF_MANY))

    def factors(node: Node) -> list[str]:
        """Return modules that are multiplied with one another; the one of an operator takes its operands' place."""
        below = [factors(a) for a in node.args]
        if node.symbol == "*" and node.name not in slots:
            return [name for names in below for name in names]
        for names in below:
            close(names)
        return [node.name] if node.name in slots else []

    close(factors(graph))
    return result


def term(values: Sequence[mi.Float], record: Mapping, norm: str, limit: float) -> Any:
    """Return the value of a term, of the outputs of its module plus the number `norm` of the record, if it has one."""
    return _colour([factor(y + record[norm] if norm in record else y, limit) for y in values], record)


def scaled(
    graph: Node, slots: Sequence[str], y: Sequence[mi.Float], record: Mapping | None = None
) -> dict[str, Callable]:
    """Return the functions that scale the terms in some slots by exp(y): a number for each, or one per channel.

    The ``norm`` of a slot in the record, if there is one, is added to y.
    """
    n, functions = len(y) // len(slots), {}
    for k, slot in enumerate(slots):
        norms = (record or {}).get(f"norm_{slot}", [])
        norms = norms if isinstance(norms, list) else [norms]
        logs = y[k * n : (k + 1) * n]
        factors = [factor(v, MAX_LOG) for v in ([a + b for a, b in zip(logs, norms, strict=True)] if norms else logs)]
        # The term stays: f is linear in the colours, and a factor of 1 is the analytic model.
        node = graph.find(slot)
        functions[slot] = lambda record, node=node, factors=factors: node(record) * _colour(factors, record)
    return functions


def operator(evaluator: Evaluator, bias: Sequence, a: Any, b: Any, limit: float) -> Any:
    """Apply a module to the logarithms of two operands; colours go through it one channel after the other."""

    def one(a, b):
        (y,) = evaluator([dr.log(dr.maximum(v, _MIN_OPERAND)) for v in (a, b)], bias)
        return factor(y, limit)

    n = max(dr.size_v(a) if dr.depth_v(a) > 1 else 1, dr.size_v(b) if dr.depth_v(b) > 1 else 1)
    if n == 1:
        return one(a, b)
    channel = lambda v, k: v[k] if dr.depth_v(v) > 1 else v  # noqa: E731
    return (type(a) if dr.depth_v(a) > 1 else type(b))(*(one(channel(a, k), channel(b, k)) for k in range(n)))


def as_learned(record: Mapping, node: Node, reference: Mapping[str, float]) -> Mapping:
    """Return the record as the slot of `node` saw it at the roughnesses `reference`, before they were edited.

    Viewer and light turn with the half vector: a narrow lobe holds only pairs that are almost mirror images, and
    networks have learned no others in it.
    """
    known = {name: mi.Float(v) for name, v in reference.items() if name in record}
    lobe, h = lobes.of_slot(node.name), record["h"]
    # Only terms of a lobe move with it, and only where it became wider (1): a narrower one holds no new angles.
    if lobe.alpha_x in known and any(n.startswith("alpha") for n in node.inputs):
        x, y = (c * dr.minimum(known[a] / record[a], 1) for c, a in ((h.x, lobe.alpha_x), (h.y, lobe.alpha_y)))
        h = mi.Vector3f(x, y, dr.safe_sqrt(1 - x * x - y * y))
        wi, wo = (_turned(record[name], record["h"], h, record["cos_theta_d"]) for name in ("wi", "wo"))
        cosines = {"cos_theta_i": wi.z, "cos_theta_o": wo.z, "cos_theta_h": h.z}
        record = {**record, **cosines, "wi": wi, "wo": wo}
    return {**record, **known, "h": h}


def _turned(v: Any, h: Any, to: Any, cos: Any) -> Any:
    """Return a direction at the cosine `cos` from h, turned as the shortest way takes h to `to`, above the horizon."""
    middle = h + to
    v = v - middle * (dr.dot(middle, v) / (1 + dr.dot(h, to))) + to * (2 * cos)
    return mi.Vector3f(v.x, v.y, dr.maximum(v.z, 0))  # 0: rounding


def _colour(v: Sequence[mi.Float], record: Mapping) -> Any:
    """Return one number, or three as a colour: RGB, or what the record's ``of_rgb`` makes of it for a renderer."""
    if len(v) == 1:
        return v[0]
    return record["of_rgb"](mi.Color3f(*v)) if "of_rgb" in record else mi.Color3f(*v)
