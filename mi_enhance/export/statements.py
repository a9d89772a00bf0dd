"""Recorded values as text: statements of a language whose expressions look like C's."""

from __future__ import annotations

import dataclasses
import math
import textwrap
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence

import numpy as np

from .recorder import Table, Value

# How tightly what an operation prints as binds: what binds less stands in parentheses.
ATOM, SIGN, PRODUCT, SUM, COMPARISON, AND, OR, CHOICE = range(8, 0, -1)
_WIDTH = 116
_LONGEST = 90  # of an expression that is not given a name

_INFIX = {
    "add": ("+", SUM),
    "sub": ("-", SUM),
    "mul": ("*", PRODUCT),
    "div": ("/", PRODUCT),
    "lt": ("<", COMPARISON),
    "le": ("<=", COMPARISON),
    "eq": ("==", COMPARISON),
    "and": ("&&", AND),
    "or": ("||", OR),
}


@dataclasses.dataclass(frozen=True)
class Language:
    """What a language calls the operations.

    Parameters
    ----------
    functions : dict of str to str
        Operation to the name of its function; operations that are left out have the name they have in the recorder.
    types : dict of str to str
        Of a ``"float"``, ``"int"``, ``"bool"``, ``"vector"`` (three floats), ``"packed"`` (four).
    reserved : frozenset of str
        Words that cannot be names.
    infix : dict of str to (str, float)
        Sign of an operation with two operands, and how tightly it binds.
    truth : (str, str)
        False and true.
    negation : str
        Template.
    choice : (str, float)
        Template, and how tightly it binds.
    statement : str
        Template of the statement that gives an expression a name.
    long_statement : str
        The same where it needs several lines, if that differs.
    inline : frozenset of str
        Operations that never get a name.
    """

    functions: Mapping[str, str]
    types: Mapping[str, str]
    reserved: frozenset[str] = frozenset()
    infix: Mapping[str, tuple[str, float]] = dataclasses.field(default_factory=lambda: dict(_INFIX))
    truth: tuple[str, str] = ("false", "true")
    negation: str = "!{0}"
    choice: tuple[str, float] = ("{0} ? {1} : {2}", CHOICE)
    statement: str = "{type} {name} = {text};"
    long_statement: str = ""
    inline: frozenset[str] = frozenset()


def number(x: float) -> str:
    """Return the shortest literal of a float32.

    Examples
    --------
    >>> number(1 / 3), number(1), number(1e-20)
    ('0.33333334', '1.0', '1e-20')
    """
    if not math.isfinite(x):
        raise ValueError(f"export: a constant of the material is {x}; it must be finite.")
    return str(np.float32(x))


class Statements:
    """The body of one function.

    Parameters
    ----------
    language : Language
    given : dict of int to str
        Text of the values that are at hand, by their number.
    labels : dict of Value to str
        Names of values.
    table : callable
        ``table(numbers) -> str``, the name of a table.
    taken : collection of str
        Names that stand for something else.
    """

    def __init__(
        self,
        language: Language,
        given: Mapping[int, str],
        labels: Mapping[Value, str],
        table: Callable[[Sequence[float]], str],
        taken: Collection[str],
    ):
        self._language, self._labels, self.table = language, labels, table
        self._texts: dict[int, tuple[str, float]] = {n: (text, ATOM) for n, text in given.items()}
        self._taken = {*taken, *language.reserved}

        self._unnamed = 0  # how many values have a number for a name
        self.lines: list[str] = []

    def write(self, values: Sequence[Value], outputs: Iterable[Value]) -> list[str]:
        """Add the statements that compute `values`; return the text of the outputs."""
        outputs = list(outputs)
        uses = Counter(a.number for v in values for a in v.args if isinstance(a, Value))
        uses.update(v.number for v in outputs)
        last = {v.number for v in outputs}
        chain = {v.args[2].number for v in values if v.op == "fma"}
        for v in values:
            text, binds = self.expression(v)
            once = uses[v.number] == 1
            short = v not in self._labels and (len(text) <= _LONGEST or v.number in last)
            link = v.op == "fma" and v.number in chain
            if v.op in self._language.inline or once and (short or link):
                self._texts[v.number] = text, binds
            else:
                name = self._name(v)
                self.lines += self._statement(v, name, text)
                self._texts[v.number] = name, ATOM
        return [self.operand(v, 0) for v in outputs]

    def _statement(self, v: Value, name: str, text: str) -> list[str]:
        language = self._language
        fields = {"type": language.types.get(v.kind), "name": name, "text": text}
        lines = wrapped(language.statement.format(**fields))
        longer = len(lines) > 1 and language.long_statement
        return wrapped(longer.format(**fields)) if longer else lines

    def _name(self, v: Value) -> str:
        own = self._labels.get(v)
        name, k = own or f"t{self._unnamed}", 1
        self._unnamed += own is None
        while name in self._taken:
            k += 1
            name = f"{own}_{k}"
        self._taken.add(name)
        return name

    @staticmethod
    def is_clamp(v: Value) -> bool:
        """Tell whether a value is held between two constants."""
        a = v.args[0]
        return v.op == "min" and v.args[1].op == "constant" and a.op == "max" and a.args[1].op == "constant"

    def operand(self, v: Value, binds: float) -> str:
        """Return the text of an operand, in parentheses unless it binds at least so tightly."""
        if v.op == "constant":
            x = v.args[0]
            text = number(x) if v.kind == "float" else self._language.truth[x] if v.kind == "bool" else str(x)
            own: float = SIGN if text.startswith("-") else ATOM
        else:
            text, own = self._texts[v.number]
        return text if own >= binds else f"({text})"

    def expression(self, v: Value) -> tuple[str, float]:
        """Return the text of an operation, and how tightly it binds."""
        language, op, args = self._language, v.op, v.args
        if op == "gather":
            return f"{self.table(args[0])}[{self.operand(args[1], 0)}]", ATOM
        if op == "fma":
            a, b, c = args
            sign = "+"
            if b.op == "constant" and b.args[0] < 0:
                sign, factor = "-", number(-b.args[0])
            else:
                factor = self.operand(b, SIGN)
            return f"{self.operand(c, SUM)} {sign} {self.operand(a, PRODUCT)} * {factor}", SUM
        if op in language.infix:
            sign, binds = language.infix[op]
            if op in ("lt", "le") and args[0].op == "constant":
                sign, args = sign.replace("<", ">"), args[::-1]
            return f"{self.operand(args[0], binds)} {sign} {self.operand(args[1], binds + 0.1)}", binds
        if op == "neg":
            return f"-{self.operand(args[0], ATOM)}", SIGN
        if op == "not":
            return language.negation.format(self.operand(args[0], ATOM)), SIGN
        if op == "select":
            template, own = language.choice
            return template.format(*(self.operand(a, OR if own == CHOICE else 0) for a in args)), own
        if self.is_clamp(v):
            inner, high = args
            args, op = (*inner.args, high), "clamp"
        return f"{language.functions.get(op, op)}({', '.join(self.operand(a, 0) for a in args)})", ATOM


def wrapped(line: str, indent: str = "    ") -> list[str]:
    """Return a statement as lines that are not too long."""
    return textwrap.wrap(
        line,
        _WIDTH,
        initial_indent=indent,
        subsequent_indent=indent + "    ",
        break_long_words=False,
        break_on_hyphens=False,
    )


__all__ = ["Language", "Statements", "Table", "number", "wrapped"]
