"""A reflectance model as a computational graph: one immutable record and a few verbs (paper, section 3).

A graph knows no optics and no modules. A term is a function whose arguments are picked *by name* from the record it is
evaluated on; an operator joins two graphs. Either can be exchanged for another function with :meth:`Node.replace`.
"""

from __future__ import annotations

import dataclasses
import functools
import inspect
import operator
from collections.abc import Callable, Collection, Iterator, Mapping


@dataclasses.dataclass(frozen=True)
class Node:
    """One slot of a graph: a term (no `args`) or an operator (two `args`).

    Parameters
    ----------
    name : str
        ``"D"``, ``"1/E"`` for a term; operators are named after their neighbours in the formula, ``"F*G"``.
    fn : callable
        A term's function of named quantities, or an operator's function of its two operands.
    args : tuple of Node
        The two operands of an operator, empty for a term.
    symbol : str
        ``"+"`` or ``"*"`` for an operator, empty for a term.
    inputs : tuple of str, optional
        Names of the quantities a term depends on; by default the arguments of `fn`. Replacing `fn` keeps them.
    replaced : bool
        True once :meth:`replace` has exchanged `fn`; such a slot prints in brackets.
    label : str
        What a term prints as, if not as its name.

    Examples
    --------
    >>> a, b = Node("A", lambda x: x), Node("B", lambda y: 2 * y)
    >>> g = a + b
    >>> print(g, g({"x": 1, "y": 2}))
    A + B 5
    >>> print(g.replace({"B": lambda record: 10}))
    A + [B]
    """

    name: str
    fn: Callable
    args: tuple[Node, ...] = ()
    symbol: str = ""
    inputs: tuple[str, ...] = None  # type: ignore[assignment]  # never None once made
    replaced: bool = False
    label: str = ""

    def __post_init__(self):
        if self.inputs is None:
            names = () if self.args else tuple(inspect.signature(self.fn).parameters)
            object.__setattr__(self, "inputs", names)

    def __add__(self, other: Node) -> Node:
        return _join("+", operator.add, self, other)

    def __mul__(self, other: Node) -> Node:
        return _join("*", operator.mul, self, other)

    def __call__(self, record: Mapping):
        """Evaluate on `record`, a mapping from quantity names to values.

        A replaced term is handed the whole record: a module may look at more than the term it replaces.
        """
        if self.args:
            return self.fn(*(a(record) for a in self.args))
        if self.replaced:
            return self.fn(record)
        return self.fn(**{name: record[name] for name in self.inputs})

    def walk(self) -> Iterator[Node]:
        """Yield every slot in the order of the formula: left operand, operator, right operand."""
        if self.args:
            yield from self.args[0].walk()
            yield self
            yield from self.args[1].walk()
        else:
            yield self

    @functools.cached_property
    def slots(self) -> tuple[str, ...]:
        """Names of all slots, in the order of the formula: one digit of the enhancement state each (section 4.1)."""
        return tuple(node.name for node in self.walk())

    def reads(self, names: Collection[str]) -> bool:
        """Tell whether any slot depends on one of the quantities `names`."""
        return any(name in names for node in self.walk() for name in node.inputs)

    def find(self, name: str) -> Node:
        """Return the slot called `name`; KeyError with the choices if there is none."""
        if name not in self._nodes:
            raise KeyError(f'graph: "{name}" is not a slot of {self}. Slots: {", ".join(self.slots)}.')
        return self._nodes[name]

    @functools.cached_property
    def _nodes(self) -> dict[str, Node]:
        """The slots by name, the first of a name: looked up many times whenever a renderer traces a material."""
        return {node.name: node for node in reversed(list(self.walk()))}

    def replace(self, functions: Mapping[str, Callable]) -> Node:
        """Return a copy in which the slots named in `functions` evaluate those functions instead.

        Raises
        ------
        KeyError
            If a name is not a slot of this graph; the message lists the slots.
        """
        for name in functions:
            self.find(name)
        return self._replace(functions)

    def _replace(self, functions: Mapping[str, Callable]) -> Node:
        args = tuple(a._replace(functions) for a in self.args)
        replaced = self.name in functions
        if not replaced and all(a is b for a, b in zip(args, self.args, strict=True)):
            return self
        # Not dataclasses.replace, which takes five times as long: renderers trace this for every material of a scene.
        fn = functions.get(self.name, self.fn)
        return Node(self.name, fn, args, self.symbol, self.inputs, self.replaced or replaced, self.label)

    def exchange(self, term: Node) -> Node:
        """Return a copy with another analytic term in the place of the one of that name."""
        if self.args:
            return dataclasses.replace(self, args=tuple(a.exchange(term) for a in self.args))
        return term if self.name == term.name else self

    def without(self, zero: Collection[str], modules: Collection[str] = ()) -> Node | None:
        """Return a copy without the terms named in `zero`, whose value is 0, and without all that they multiply.

        Parameters
        ----------
        zero : collection of str
            Terms.
        modules : collection of str
            Slots that modules will replace: one in the place of an operator makes something of 0, too.

        Returns
        -------
        Node or None
            None if nothing is left.

        Examples
        --------
        >>> a, b, c = (Node(name, lambda: 1) for name in "abc")
        >>> print((a * b + c).without(["b"]))
        c
        """
        if not self.args:
            return None if self.name in zero and self.name not in modules else self
        if self.name in modules:
            return self
        left = tuple(a for a in (arg.without(zero, modules) for arg in self.args) if a is not None)
        if len(left) == 2:
            return dataclasses.replace(self, args=left)
        return left[0] if left and self.symbol == "+" else None

    def __str__(self) -> str:
        label = self.symbol or self.label or self.name
        label = f"[{label}]" if self.replaced else label
        if not self.args:
            return label
        # a sum inside of a product needs its parentheses
        return f" {label} ".join(f"({a})" if (self.symbol, a.symbol) == ("*", "+") else str(a) for a in self.args)


def _join(symbol: str, fn: Callable, a: Node, b: Node) -> Node:
    """Join two graphs; the operator is named after the terms that stand left and right of it in the formula."""
    left = [n.name for n in a.walk() if not n.args][-1 if symbol == "*" else 0]
    right = [n.name for n in b.walk() if not n.args][0]
    return Node(left + symbol + right, fn, (a, b), symbol)
