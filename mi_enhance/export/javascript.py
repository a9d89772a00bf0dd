"""JavaScript: what the page of the viewer works out outside of its shader."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from .program import Program
from .recorder import Value
from .statements import ATOM, Language, Statements, number, wrapped

_MATH = "abs floor sqrt exp log log2 sin cos tan tanh asin acos atan atan2 pow min max".split()
_LANGUAGE = Language(
    functions={**{op: f"Math.{op}" for op in _MATH}, "clamp": "clamp", "int": "Math.floor", "float": ""},
    types={},
    reserved=frozenset("in new function var let const this default delete".split()),
    statement="const {name} = {text};",
)


def source(program: Program) -> str:
    """Return an object with ``prepare(p)`` and ``eval(k, wi, wo)``, both of which return arrays.

    Examples
    --------
    >>> from mi_enhance import Material
    >>> from mi_enhance.export.program import record
    >>> source(record(Material.analytic("ggx"))).splitlines()[:2]
    ['{', 'prepare(p) {']
    """
    function = program.functions["eval"]
    lanes = {v.number: f"k[{k}]" for k, v in enumerate(program.prepared)}
    vectors = {v.number: f"{a}[{k}]" for a, lane in function.inputs.items() for k, v in enumerate(lane)}
    scalars = {v.number: f"p.{a}[{k}]" for a, lane in program.inputs.items() for k, v in enumerate(lane)}
    tables: list[str] = []
    bodies = [
        *_function("prepare(p)", program.values_of_parameters(), program.prepared, scalars, program.labels, tables),
        *_function(
            "eval(k, wi, wo)", program.values("eval"), function.outputs, lanes | vectors, program.labels, tables
        ),
    ]
    return "\n".join(["{", *bodies, f"tables: [{', '.join(tables)}],", "}"])


def _function(
    head: str,
    values: Sequence[Value],
    outputs: Sequence[Value],
    given: Mapping[int, str],
    labels: Mapping[Value, str],
    tables: list[str],
) -> list[str]:
    def table(numbers: Sequence[float]) -> str:
        tables.append(f"[{', '.join(map(number, numbers))}]")
        return f"this.tables[{len(tables) - 1}]"

    body = _Statements(_LANGUAGE, given, labels, table, {"p", "k", "wi", "wo"})
    texts = body.write(values, outputs)
    return [f"{head} {{", *body.lines, *wrapped(f"return [{', '.join(texts)}];"), "},"]


class _Statements(Statements):
    def expression(self, v: Value) -> tuple[str, float]:
        if v.op in ("rsqrt", "exp2"):
            x = self.operand(v.args[0], 0)
            return (f"(1 / Math.sqrt({x}))" if v.op == "rsqrt" else f"Math.pow(2, {x})"), ATOM
        return super().expression(v)
