"""A graph of scalar operations, recorded while a function runs on stand-ins for Dr.Jit's arrays.

A :class:`Value` behaves like ``mi.Float``, ``mi.UInt32`` or ``mi.Mask`` of one lane, and remembers how it came about.
Equal operations on equal values are one value, so common subexpressions are shared; operations on constants are done at
once, in float32 as Dr.Jit does them.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, Literal, Union

import numpy as np

from ..system.messages import shortened
from .identities import NUMBERS, simplified

Kind = Literal["float", "int", "bool"]
Operand = Union["Value", float, bool]
_TYPES: dict[str, Callable] = {"float": np.float32, "int": int, "bool": bool}

_COMMUTATIVE = ("add", "mul", "min", "max", "and", "or", "eq")
_BOOLEAN = ("lt", "le", "eq", "and", "or", "not")


class Value:
    """One scalar of the recorded function.

    Attributes
    ----------
    op : str
        A key of :data:`NUMBERS`, or ``"constant"``, ``"input"``, ``"gather"``.
    args : tuple
        Operands; of a constant its number, of an input its name, of a gather the table and the index.
    kind : {"float", "int", "bool"}
    varying : bool
        True if it depends on an input that varies from one evaluation to the next.
    """

    __slots__ = ("args", "kind", "number", "op", "varying")
    __array_ufunc__ = None  # a NumPy number to the left leaves the operation to us

    def __init__(self, op: str, args: tuple, kind: Kind, varying: bool, number: int):
        self.op, self.args, self.kind, self.varying, self.number = op, args, kind, varying, number

    def __repr__(self) -> str:
        # Operands by number: written out, what shares its parts is exponentially longer than its graph.
        args = (f"%{a.number}" if isinstance(a, Value) else shortened(a) for a in self.args)
        return f"%{self.number} = {self.op}({', '.join(args)})"

    def __bool__(self) -> bool:
        if self.op == "constant":
            return bool(self.args[0])
        raise TypeError("export: a term branches on a value that is not known while it is recorded; use dr.select().")

    def __hash__(self) -> int:
        return self.number

    def __add__(self, other: Operand) -> Value:
        return operation("add", self, other)

    def __sub__(self, other: Operand) -> Value:
        return operation("sub", self, other)

    def __rsub__(self, other: Operand) -> Value:
        return operation("sub", other, self)

    def __mul__(self, other: Operand) -> Value:
        return operation("mul", self, other)

    def __truediv__(self, other: Operand) -> Value:
        return operation("div", self, other)

    def __rtruediv__(self, other: Operand) -> Value:
        return operation("div", other, self)

    __radd__, __rmul__ = __add__, __mul__

    def __pow__(self, other: Operand) -> Value:
        return power(self, other)

    def __neg__(self) -> Value:
        return operation("neg", self)

    def __abs__(self) -> Value:
        return operation("abs", self)

    def __lt__(self, other: Operand) -> Value:
        return operation("lt", self, other)

    def __le__(self, other: Operand) -> Value:
        return operation("le", self, other)

    def __gt__(self, other: Operand) -> Value:
        return operation("lt", other, self)

    def __ge__(self, other: Operand) -> Value:
        return operation("le", other, self)

    def __eq__(self, other: object) -> Any:
        return operation("eq", self, other)

    def __ne__(self, other: object) -> Any:
        return operation("not", operation("eq", self, other))

    def __and__(self, other: Operand) -> Value:
        # a number & a mask is the number where the mask is true
        return operation("and", self, other) if self.kind == "bool" else select(other, self, 0)

    def __or__(self, other: Operand) -> Value:
        return operation("or", self, other)

    __rand__, __ror__ = __and__, __or__

    def __invert__(self) -> Value:
        return operation("not", self)


class Table(Sequence):
    """An array of constants that :func:`gather` reads, in place of an ``mi.Float`` of many entries."""

    def __init__(self, numbers: Iterable[float]):
        self.numbers = tuple(float(np.float32(v)) for v in numbers)

    def __len__(self) -> int:
        return len(self.numbers)

    def __getitem__(self, k: Any) -> Any:
        return self.numbers[k]


class Recorder:
    """All values of one recording."""

    def __init__(self) -> None:
        self._values: dict[tuple, Value] = {}
        self.labels: dict[Value, str] = {}

    def make(self, op: str, args: tuple, kind: Kind, varying: bool) -> Value:
        """Return the value of an operation, the one of before if there was the same."""
        key = (op, kind, *(a.number if isinstance(a, Value) else (repr(a),) for a in args))
        if key not in self._values:
            self._values[key] = Value(op, args, kind, varying, len(self._values))
        return self._values[key]

    def input(self, name: str, *, varying: bool) -> Value:
        """Return an argument of the recorded function."""
        return self.make("input", (name,), "float", varying)

    def label(self, value: Any, name: str) -> None:
        """Have a value printed under a name, unless it has one; components of a vector get theirs."""
        if isinstance(value, Value):
            if value.op not in ("constant", "input"):
                self.labels.setdefault(value, name)
        elif hasattr(value, "parts"):
            for part, axis in zip(value.parts, value.AXES, strict=True):
                self.label(part, f"{name}_{axis}")


_active: list[Recorder] = []


@contextlib.contextmanager
def active(recorder: Recorder) -> Iterator[Recorder]:
    """Record into `recorder` while the block runs."""
    _active.append(recorder)
    try:
        yield recorder
    finally:
        _active.pop()


def constant(number: Any, kind: Kind = "float") -> Value:
    """Return a constant."""
    return _active[-1].make("constant", (_TYPES[kind](number),), kind, False)


def value(x: Any, kind: Kind | None = None) -> Value:
    """Return `x`, a value or a Python number, as a value."""
    if isinstance(x, Value):
        return x
    if kind is None:
        kind = "bool" if isinstance(x, (bool, np.bool_)) else "float"
    return constant(x, kind)


def operation(op: str, *operands: Any) -> Any:
    """Return the value of an operation on values and Python numbers."""
    if any(hasattr(x, "parts") for x in operands):
        return NotImplemented  # the vector's own operator takes over
    kinds = [x.kind for x in operands if isinstance(x, Value)]
    whole = "int" in kinds and "float" not in kinds and not any(isinstance(x, float) for x in operands)
    args = tuple(value(x, "int" if whole and not isinstance(x, bool) else None) for x in operands)
    kind: Kind = "bool" if op in _BOOLEAN else "int" if whole and op != "float" or op == "int" else "float"
    if op == "select":
        kind = args[1].kind
    if all(a.op == "constant" for a in args):
        with np.errstate(all="ignore"):
            return constant(NUMBERS[op](*(a.args[0] for a in args)), kind)
    simpler = simplified(op, args, operation)
    if simpler is not None:
        return simpler
    if op in _COMMUTATIVE and _place(args[0]) > _place(args[1]):
        args = args[::-1]
    return _active[-1].make(op, args, kind, any(a.varying for a in args))


def _place(x: Value) -> tuple[bool, int]:
    """Operands whose order does not matter stand in the order in which they came about, constants last."""
    return x.op == "constant", x.number


def select(mask: Any, a: Any, b: Any) -> Any:
    """Return `a` where the mask is true, else `b`."""
    return operation("select", value(mask, "bool"), a, b)


def power(a: Any, exponent: Any) -> Any:
    """Return a power; a whole exponent is a product, for a base of any sign."""
    if isinstance(exponent, (int, float)) and exponent == int(exponent) and abs(exponent) <= 64:
        n, result, square = abs(int(exponent)), constant(1), value(a)
        while n:
            if n & 1:
                result = result * square
            n >>= 1
            square = square * square if n else square
        return result if exponent >= 0 else 1 / result
    return operation("pow", a, exponent)


def gather(table: Table, index: Any) -> Value:
    """Return an entry of a table."""
    if isinstance(index, Value) and index.op != "constant":
        return _active[-1].make("gather", (table.numbers, index), "float", index.varying)
    return constant(table.numbers[int(index.args[0] if isinstance(index, Value) else index)])


def in_order(outputs: Iterable[Value], stop: Callable[[Value], bool] = lambda v: False) -> list[Value]:
    """Return all values that `outputs` are made of, each after its operands; those where `stop` holds have none."""
    order: dict[Value, None] = {}
    seen: set[int] = set()
    for output in outputs:
        stack = [(output, False)]
        while stack:
            v, done = stack.pop()
            if done:
                order[v] = None
            elif v.number not in seen:
                seen.add(v.number)
                stack.append((v, True))
                if not stop(v):
                    stack += [(a, False) for a in reversed(v.args) if isinstance(a, Value)]
    return list(order)
