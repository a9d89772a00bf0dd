"""What operations come to: NumPy's numbers for constants, and the rules by which a recorded one is left out."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from .recorder import Value

# What each operation does to numbers: `a op b` of NumPy scalars.
NUMBERS: dict[str, Callable] = {
    "add": lambda a, b: a + b,
    "sub": lambda a, b: a - b,
    "mul": lambda a, b: a * b,
    "div": lambda a, b: a / b,
    "neg": lambda a: -a,
    "fma": lambda a, b, c: a * b + c,
    "min": min,
    "max": max,
    "abs": abs,
    "floor": np.floor,
    "sqrt": np.sqrt,
    "rsqrt": lambda a: 1 / np.sqrt(a),
    "exp": np.exp,
    "exp2": np.exp2,
    "log": np.log,
    "log2": np.log2,
    "sin": np.sin,
    "cos": np.cos,
    "tan": np.tan,
    "tanh": np.tanh,
    "asin": np.arcsin,
    "acos": np.arccos,
    "atan": np.arctan,
    "atan2": np.arctan2,
    "pow": lambda a, b: a**b,
    "lt": lambda a, b: a < b,
    "le": lambda a, b: a <= b,
    "eq": lambda a, b: a == b,
    "and": lambda a, b: a and b,
    "or": lambda a, b: a or b,
    "not": lambda a: not a,
    "select": lambda m, a, b: a if m else b,
    "int": int,
    "float": np.float32,
}


def _is(x: Value, number: float) -> bool:
    return x.op == "constant" and x.kind != "bool" and x.args[0] == number


def simplified(op: str, args: tuple[Value, ...], operation: Callable[..., Value]) -> Value | None:
    """Return what an operation comes to where an operand is 0, 1, true or false; None if it stays as it is.

    Parameters
    ----------
    op : str
        A key of :data:`NUMBERS`.
    args : tuple of Value
    operation : callable
        Records the operations that it comes to.
    """
    if op in ("mul", "add"):
        neutral = 1 if op == "mul" else 0
        for x, other in (args, args[::-1]):
            if _is(x, neutral):
                return other
            if op == "mul" and _is(x, 0):
                return x
        if op == "add" and args[0].kind == "float":
            return _constant_first(args[0], args[1], operation)
    elif op == "sub" and _is(args[1], 0):
        return args[0]
    elif op == "sub" and _is(args[0], 0):
        return operation("neg", args[1])
    elif op == "div" and _is(args[1], 1):
        return args[0]
    elif op == "fma":
        a, b, c = args
        if _is(c, 0):
            return operation("mul", a, b)
        if a.op == b.op == "constant" or _is(a, 1) or _is(b, 1) or _is(a, 0) or _is(b, 0):
            return operation("add", operation("mul", a, b), c)
    elif op in ("and", "or"):
        for x, other in (args, args[::-1]):
            if x.op == "constant":
                return other if bool(x.args[0]) == (op == "and") else x
    elif op == "select":
        mask, a, b = args
        if mask.op == "constant":
            return a if mask.args[0] else b
        if a.number == b.number:
            return a
        if mask.op == "lt" and {mask.args[0].number, mask.args[1].number} == {a.number, b.number}:
            return operation("min" if mask.args[0].number == a.number else "max", a, b)
    elif op == args[0].kind:  # a conversion to what it is
        return args[0]
    return None


def _constant_first(a: Value, b: Value, operation: Callable[..., Value]) -> Value | None:
    """Return a sum of products and a constant, in the order that the constants of the sum are added at once."""
    if a.op == "constant":
        a, b = b, a
    if b.op != "constant":
        return None
    links, start = [], a
    while start.op == "fma":
        links.append(start.args[:2])
        start = start.args[2]
    if not links or start.op != "constant":
        return None
    total = operation("add", start, b)
    for x, y in reversed(links):
        total = operation("fma", x, y, total)
    return total
