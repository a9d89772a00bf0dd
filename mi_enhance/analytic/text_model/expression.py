"""Arithmetic expressions from a text. They are parsed to a tree and interpreted: nothing of the text is ever executed.

Where mathematics has no value the nearest argument that has one is taken, so no NaN arises whose gradient would spoil
those of a whole fit:

- ``a / b``, ``a ** -n``: a divisor closer to 0 than 1e-15 counts as 1e-15 of its sign, so 0 / 0 is 0;
- ``sqrt(x)``, ``log(x)``, and ``x ** y`` unless y is a whole number up to 64: x counts as at least 1e-15;
- ``exp(x)``, and ``x ** y`` = exp(y log(x)): the exponent counts as at most 40; ``acos(x)``: x within 1 - 1e-6.

The derivative in the region that is cut off is 0, and outside of it within float32: 1/b^2 = 1e30, exp(40) = 2e17.
"""

from __future__ import annotations

import ast
import dataclasses
import math
import operator
import re
from collections.abc import Callable, Mapping
from typing import Any, NoReturn

import drjit as dr
import mitsuba as mi

from ...system.messages import cut, did_you_mean, shortened

# A hostile text must not ask for much time or stack: Python's own parser and the recursion below stay shallow.
_MAX_LENGTH, _MAX_DEPTH = 2000, 100
MAX_NUMBER = 1e30  # of a number in a text: its products with a few others are within float32
_TINY, _MAX_EXPONENT, _MAX_COS = 1e-15, 40.0, 1 - 1e-6
_MAX_POWER = 64  # a whole exponent is a product, of a base of any sign, up to here


# By select: dr.maximum() multiplies what comes from above by 0 where it is cut off, and infinity would become NaN.
def _maximum(a, b):
    return dr.select(a > b, a, b)


def _minimum(a, b):
    return dr.select(a < b, a, b)


def _exp(x):
    return dr.exp(_minimum(x, _MAX_EXPONENT))


def _log(x):
    return dr.log(_maximum(x, _TINY))


_FUNCTIONS: dict[str, tuple[int, Callable]] = {
    "sqrt": (1, lambda x: dr.sqrt(_maximum(x, _TINY))),
    "exp": (1, _exp),
    "log": (1, _log),
    "sin": (1, dr.sin),
    "cos": (1, dr.cos),
    "acos": (1, lambda x: dr.acos(_maximum(_minimum(x, _MAX_COS), -_MAX_COS))),
    "abs": (1, dr.abs),
    "minimum": (2, _minimum),
    "maximum": (2, _maximum),
}
RESERVED = (*_FUNCTIONS, "pi")
_SIGNS: dict[type, Callable] = {ast.UAdd: lambda a: a, ast.USub: lambda a: -a}
_OPERATORS: dict[type, str] = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.Pow: "**"}
_ALLOWED = f"Allowed: numbers, pi, names, + - * / **, parentheses, {', '.join(f'{f}()' for f in _FUNCTIONS)}."
_LINEAR = "f must stay linear in the colours: multiply or divide a colour by numbers only, in a term of its own."


@dataclasses.dataclass(frozen=True)
class Expression:
    """A function of named quantities, ``expression(**record)``.

    Parameters
    ----------
    tree : ast.expr
        A tree of :func:`parse`, which has found nothing but arithmetic in it.
    reads : tuple of str
        The names it depends on.
    is_colour : bool
        True if it is proportional to a colour.
    """

    tree: ast.expr
    reads: tuple[str, ...]
    is_colour: bool

    def __call__(self, /, **record: Any) -> Any:
        return _value(self.tree, record)


def parse(text: str, kinds: Mapping[str, str], where: str) -> Expression:
    """Check an expression and return it as a function.

    Parameters
    ----------
    text : str
        For example ``"(n + 1) / (2 * pi) * h.z ** n"``.
    kinds : dict of str to str
        The names it may read: ``"number"``, ``"colour"``, or ``"direction"``, which is read by component, ``h.x``.
    where : str
        Start of an error message.

    Returns
    -------
    Expression

    Raises
    ------
    ValueError
        If the text is not an expression, reads an unknown name, is too long or too deep, or not linear in its colours.

    Examples
    --------
    >>> f = parse("2 * h.x ** n", {"h": "direction", "n": "number"}, "example")
    >>> f.reads, f(h=mi.Vector3f(0.5, 0, 0), n=mi.Float(2))
    (('h', 'n'), [0.5])
    """
    if not isinstance(text, str) or len(text) > _MAX_LENGTH:
        raise ValueError(
            f"{where}: must be an expression in quotes, up to {_MAX_LENGTH} characters; got {shown(text)}."
        )
    text = " ".join(text.split())
    if strange := re.search(r"[^\w.+*/(), -]", text, re.ASCII):
        raise ValueError(f'{where}: "{strange[0]}" has no place in the expression "{cut(text)}". {_ALLOWED}')
    try:
        tree = ast.parse(text, mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:  # the last two: a thousand signs in a row
        reason = getattr(error, "msg", None) or type(error).__name__
        raise ValueError(f'{where}: "{cut(text)}" is not an expression ({reason}). {_ALLOWED}') from None
    reads: dict[str, None] = {}
    is_colour = _check(tree, 0, text, kinds, where, reads)
    return Expression(tree, tuple(reads), is_colour)


def shown(value: object) -> str:
    """Show a value of a text in an error message: short, and without descending into tables, which may be very deep."""
    if isinstance(value, (dict, list)):
        return f"{len(value)} entries"
    return "nothing" if value is None else shortened(value)


def _check(node: ast.expr, depth: int, text: str, kinds: Mapping[str, str], where: str, reads: dict) -> bool:
    """Tell whether `node` is proportional to a colour; note the names it reads; refuse all but arithmetic."""

    def refuse(what: str, hint: str) -> NoReturn:
        # offsets count bytes, and all characters are ASCII
        raise ValueError(f'{where}: {what} in "{cut(text[node.col_offset : node.end_col_offset])}". {hint}')

    def read(name: str, component: bool) -> bool:
        if name not in kinds:
            hint = f"Choose from: {', '.join([*kinds, 'pi'])}.{did_you_mean(name, kinds)}"
            refuse(f'unknown name "{name}"', hint)
        if component and kinds[name] != "direction":
            refuse(f'"{name}" is not a direction', f'Write "{name}" without a component.')
        if not component and kinds[name] == "direction":
            refuse(f'"{name}" is a direction', f"Write one of its components: {name}.x, {name}.y, {name}.z.")
        reads[name] = None
        return kinds[name] == "colour"

    def check(child: ast.expr) -> bool:
        return _check(child, depth + 1, text, kinds, where, reads)

    if depth > _MAX_DEPTH:
        refuse(f"more than {_MAX_DEPTH} operations inside one another", "Split the term, or use fewer parentheses.")
    match node:
        case ast.Constant(value=int() | float() as value) if not isinstance(value, bool):
            if abs(value) > MAX_NUMBER:
                refuse("a number is too large", f"Numbers reach up to {MAX_NUMBER:g}.")
            return False
        case ast.Name(id="pi"):
            return False
        case ast.Name(id=name):
            return read(name, component=False)
        case ast.Attribute(value=ast.Name(id=name), attr="x" | "y" | "z"):
            return read(name, component=True)
        case ast.UnaryOp(op=op, operand=operand) if type(op) in _SIGNS:
            return check(operand)
        case ast.BinOp(left=left, op=op, right=right) if type(op) in _OPERATORS:
            a, b, symbol = check(left), check(right), _OPERATORS[type(op)]
            if symbol in "+-" and a != b:
                refuse("a colour and a number are added", _LINEAR)
            if (symbol == "*" and a and b) or (symbol == "/" and b) or (symbol == "**" and (a or b)):
                refuse("a colour that is not a plain factor", _LINEAR)
            return a or b
        case ast.Call(func=ast.Name(id=name), args=args, keywords=[]) if name in _FUNCTIONS:
            if len(args) != _FUNCTIONS[name][0]:
                refuse(f"{name}() takes {_FUNCTIONS[name][0]} argument(s); got {len(args)}", _ALLOWED)
            if any([check(a) for a in args]):  # a list: all of them are to be checked
                refuse("a function of a colour", _LINEAR)
            return False
        case ast.Call(func=ast.Name(id=name)):
            refuse(f'unknown function "{name}"', _ALLOWED)
    refuse(f"{type(node).__name__} is not arithmetic", _ALLOWED)


def _value(node: ast.expr, record: Mapping) -> Any:
    """Compute the value of a checked tree."""
    match node:
        case ast.Constant(value=value):
            return mi.Float(value)
        case ast.Name(id="pi"):
            return mi.Float(math.pi)
        case ast.Name(id=name):
            return record[name]
        case ast.Attribute(value=ast.Name(id=name), attr=axis):
            return getattr(record[name], axis)
        case ast.UnaryOp(op=op, operand=operand):
            return _SIGNS[type(op)](_value(operand, record))
        case ast.Call(func=ast.Name(id=name), args=args):
            return _FUNCTIONS[name][1](*(_value(a, record) for a in args))
        case ast.BinOp(left=left, op=ast.Pow(), right=right):
            return _power(_value(left, record), right, record)
        case ast.BinOp(left=left, op=op, right=right):
            return _BINARY[type(op)](_value(left, record), _value(right, record))
    raise TypeError(f"{type(node).__name__} is not arithmetic")  # parse() has refused it


def _divide(a: Any, b: Any) -> Any:
    return a / dr.select(dr.abs(b) < _TINY, dr.copysign(mi.Float(_TINY), b), b)


_BINARY: dict[type, Callable] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: _divide,
}


def _power(a: Any, exponent: ast.expr, record: Mapping) -> Any:
    number, sign = exponent, 1
    while isinstance(number, ast.UnaryOp):
        sign = -sign if isinstance(number.op, ast.USub) else sign
        number = number.operand
    match number:
        case ast.Constant(value=int() | float() as n) if n <= _MAX_POWER and n == int(n):
            return a ** int(n) if sign > 0 else _divide(1, a ** int(n))
    return _exp(_value(exponent, record) * _log(a))
