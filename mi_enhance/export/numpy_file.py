"""A Python file that evaluates a material with NumPy or PyTorch alone."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from .. import __version__
from ..material.material import Material
from ..system.files import write_text
from .program import Program, name_of, record
from .recorder import Value, in_order
from .registry import exporter
from .statements import ATOM, COMPARISON, PRODUCT, SUM, Language, Statements, wrapped
from .vectorize import Vectorizer

# & and | bind more tightly than comparisons in Python.
_LANGUAGE = Language(
    functions={
        **{op: f"xp.{op}" for op in "abs floor sqrt exp exp2 log log2 sin cos tan tanh".split()},
        **{"asin": "xp.arcsin", "acos": "xp.arccos", "atan": "xp.arctan", "atan2": "xp.arctan2"},
        **{"min": "xp.minimum", "max": "xp.maximum", "clamp": "xp.clip", "int": "xp.floor"},
    },
    types={},
    infix={
        **{"add": ("+", SUM), "sub": ("-", SUM), "mul": ("*", PRODUCT), "div": ("/", PRODUCT), "pow": ("**", ATOM)},
        **{"and": ("&", COMPARISON + 0.6), "or": ("|", COMPARISON + 0.3)},
        **{"lt": ("<", COMPARISON), "le": ("<=", COMPARISON), "eq": ("==", COMPARISON)},
    },
    truth=("False", "True"),
    negation="~{0}",
    choice=("xp.where({0}, {1}, {2})", ATOM),
    statement="{name} = {text}",
    long_statement="{name} = ({text})",
    inline=frozenset({"lane", "pick", "array", "column"}),
)
_HEAD = '''"""{name}: {equation}; brackets are neural networks. Written by mi_enhance {version}.

    f = evaluate(wi, wo)                      # reflectance in 1/sr without the cosine, linear RGB, (N, 3)
    wo, density = sample(wi, u), pdf(wi, wo)  # u (N, 3) uniform in [0, 1); below the horizon f is 0
{example}

wi (towards the viewer) and wo (light) are (N, 3): unit vectors away from the surface in its frame, normal (0, 0, 1).
NumPy arrays or PyTorch tensors, through which gradients flow. A parameter is one for all, or an array of N.
"""

import base64

import numpy as np

PARAMETERS = {parameters}
_W = np.frombuffer(base64.b64decode("{weights}"), "<f4")
'''
_HELPERS = '''

def _begin(a, b, edits):
    """Return the library, both arguments as rows, the constants, and what the functions need of the parameters."""
    if unknown := set(edits) - set(PARAMETERS):
        raise ValueError(f"unknown parameters {unknown}; choose from {', '.join(PARAMETERS)}")
    if isinstance(a, (np.ndarray, list, tuple)):
        xp, a, b = np, np.asarray(a, np.float32), np.asarray(b, np.float32)
    else:
        import torch as xp
    p = {name: _like(a, edits.get(name, values[0])) for name, values in PARAMETERS.items()}
    # (3, N) and (N), or (3, 1) and (1)
    p = {
        name: v.reshape(-1, 3).T if isinstance(PARAMETERS[name][0], tuple) else v.reshape(-1) for name, v in p.items()
    }
    weights = _like(a, _W)
    return xp, a.T, b.T, weights, _prepare(xp, weights, p)


def prepare(**parameters):
    """Return what the shaders of this material hold in k for these parameters, (n, 4) float32: uniforms."""
    origin = np.zeros((1, 3), np.float32)
    k = _begin(origin, origin, parameters)[-1][:, 0]
    return np.pad(k, (0, -len(k) % 4)).reshape(-1, 4)


def _like(x, v):
    """Return `v` as an array of the kind of `x`."""
    if isinstance(x, np.ndarray):
        return np.asarray(v, x.dtype)
    return v if isinstance(v, type(x)) else x.new_tensor(v)


def _rows(xp, *parts):
    """Put scalars and vectors below one another; the last axis holds the samples."""
    parts = [v if v.ndim == 2 else v[None] for v in parts]
    n = max(v.shape[1] for v in parts)
    return xp.concatenate([xp.broadcast_to(v, (v.shape[0], n)) for v in parts])


def _linear(weights, n, x, rest):
    """Return a matrix of n rows times a vector, plus a vector."""
    y = weights.reshape(n, -1) @ x if weights.ndim == 1 else (weights.reshape(n, -1, weights.shape[1]) * x).sum(1)
    return (y if n > 1 else y[0]) + rest


def _index(x):
    return x.long() if hasattr(x, "long") else x.astype(int)
'''


@exporter(".py", about="Python: evaluate, sample and pdf with NumPy or PyTorch alone")
def write_python(material: Material, path: Path, *, editable: bool = True) -> dict:
    """Write a material as a Python file, see :func:`source`."""
    program = record(material, editable=editable)
    text = source(program, name_of(path))
    write_text(path, text)
    return {"bytes": len(text.encode()), "multiply_adds": program.multiply_adds}


def source(program: Program, name: str) -> str:
    """Return the functions of a material as a Python module.

    Examples
    --------
    >>> names = {}
    >>> exec(source(record(Material.analytic("ggx").edit(rho_s=0)), "grey"), names)
    >>> names["evaluate"]([[0, 0, 1]], [[0, 0.6, 0.8]]).round(3)
    array([[0.159, 0.159, 0.159]], dtype=float32)
    """
    writer = _Writer(program)
    functions = [writer.prepare(), *map(writer.function, program.functions)]
    values = {
        q.name: (tuple(map(_short, v)) if q.size > 1 else _short(v[0]), q.low, q.high)
        for q in program.parameters
        for v in [program.defaults[q.name]]
    }
    colours = [q.name for q in program.parameters if q.is_colour]
    edit = (
        f"    f = evaluate(wi, wo, {colours[0]}=(0.2, 0.1, 0.0))  # edited; PARAMETERS: value, least, largest"
        if colours
        else ""
    )
    weights = base64.b64encode(np.array(writer.numbers, "<f4").tobytes()).decode()
    lines = ",\n".join(f"    {k!r}: {v}" for k, v in values.items()).replace("'", '"')
    head = _HEAD.format(
        name=name,
        equation=program.equation,
        version=__version__,
        example=edit,
        parameters=f"{{\n{lines},\n}}" if lines else "{}",
        weights=weights,
    )
    return head + _HELPERS + "".join(f"\n\n{function}\n" for function in functions)


def _short(x: float) -> float:
    return float(str(np.float32(x)))


class _Writer:
    """Writes the functions; all their constants of more than one number stand in one array."""

    def __init__(self, program: Program):
        self._program = program
        self.numbers: list[float] = []

    def prepare(self) -> str:
        """Return the function of the parameters."""
        prepared, head = self._program.prepared, "def _prepare(xp, W, p):"
        if not prepared:
            return f"{head}\n    return None"
        vectors = {f'p["{name}"]': lanes for name, lanes in self._program.inputs.items() if len(lanes) > 1}
        vectorizer = Vectorizer(prepared, vectors, self._program.labels)
        lines, (text,) = self._body([vectorizer.joined(prepared)], vectorizer)
        return "\n".join([head, *lines, *wrapped(f"return {text}")])

    def function(self, name: str) -> str:
        """Return a function of the directions."""
        function = self._program.functions[name]
        vectors = {**function.inputs, "k": self._program.prepared}
        vectorizer = Vectorizer(function.outputs, vectors, self._program.labels)
        if len(function.outputs) == 3:
            lines, (text,) = self._body([vectorizer.joined(function.outputs)], vectorizer)
            text += ".T"
        else:
            lines, (text,) = self._body([vectorizer.scalar(function.outputs[0])], vectorizer)
        arguments = ", ".join(function.inputs)
        begin = f"    xp, {arguments}, W, k = _begin({arguments}, parameters)"
        shown = "evaluate" if name == "eval" else name
        return "\n".join([f"def {shown}({arguments}, **parameters):", begin, *lines, *wrapped(f"return {text}")])

    def _body(self, outputs: list[Value], vectorizer: Vectorizer) -> tuple[list[str], list[str]]:
        order = in_order(outputs)
        scalars = {q.name for q in self._program.parameters if q.size == 1}
        names = {v.number: v.args[0] for v in order if v.op == "input"}
        given = {n: f'p["{name}"]' if name in scalars else name for n, name in names.items()}
        values = [v for v in order if v.op not in ("input", "constant")]
        taken = {"k", "p", "W", "xp", "wi", "wo", "u"}
        statements = _Statements(_LANGUAGE, given, vectorizer.labels, self._slice, taken)
        return statements.lines, statements.write(values, outputs)

    def _slice(self, numbers: Sequence[float]) -> str:
        start = len(self.numbers)
        self.numbers += numbers
        return f"W[{start}:{len(self.numbers)}]"


class _Statements(Statements):
    """Statements in which values may be vectors."""

    def expression(self, v: Value) -> tuple[str, float]:
        op, args = v.op, v.args
        if op == "lane":
            return f"{self.operand(args[0], ATOM)}[{args[1]}]", ATOM
        if op == "pick":
            first, *_, last = places = args[1]
            chosen = f"{first}:{last + 1}" if places == tuple(range(first, last + 1)) else str(list(places))
            return f"{self.operand(args[0], ATOM)}[{chosen}]", ATOM
        if op == "array":
            return self.table(args[0]), ATOM
        if op == "rows":
            return f"_rows(xp, {', '.join(self.operand(a, 0) for a in args)})", ATOM
        if op == "column":
            return f"{self.table(args[0])}[:, None]", ATOM
        if op == "linear":
            weights, n, x, rest = args
            listed = (self.operand(weights, 0), str(n), self.operand(x, 0), self.operand(rest, 0))
            return f"_linear({', '.join(listed)})", ATOM
        if op == "gather":
            return f"{self.table(args[0])}[_index({self.operand(args[1], 0)})]", ATOM
        if op == "rsqrt":
            return f"1 / xp.sqrt({self.operand(args[0], 0)})", PRODUCT
        if op == "float":
            return self.operand(args[0], ATOM), ATOM
        if op in ("min", "max") and args[1].op == "constant" and not self.is_clamp(v):
            low, high = ("None", self.operand(args[1], 0))[:: 1 if op == "min" else -1]
            return f"xp.clip({self.operand(args[0], 0)}, {low}, {high})", ATOM
        return super().expression(v)
