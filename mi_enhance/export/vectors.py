"""Vectors, colours and frames of recorded values, in place of Mitsuba's."""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, ClassVar

from .recorder import Value, select, value


class Vector:
    """A vector or a colour of recorded values."""

    AXES: ClassVar[str] = "xyz"

    def __init__(self, *parts: Any):
        if len(parts) == 1:
            parts = tuple(parts[0]) if hasattr(parts[0], "__len__") else parts * len(self.AXES)
        self.parts = [value(v) for v in parts]

    def __len__(self) -> int:
        return len(self.parts)

    def __iter__(self) -> Iterator[Value]:
        return iter(self.parts)

    def __getitem__(self, k: int) -> Value:
        return self.parts[k]

    x = property(lambda self: self.parts[0])
    y = property(lambda self: self.parts[1])
    z = property(lambda self: self.parts[2])
    r, g, b = x, y, z

    def __neg__(self) -> Vector:
        return type(self)(*(-v for v in self))

    def __and__(self, mask: Any) -> Vector:
        return type(self)(*(select(mask, v, 0) for v in self))

    if TYPE_CHECKING:  # made by _install()

        def __add__(self, other: Any) -> Any: ...

        def __mul__(self, other: Any) -> Any: ...


class Colour(Vector):
    """In place of ``mi.Color3f``."""

    AXES = "rgb"


class Point2(Vector):
    """In place of ``mi.Point2f``."""

    AXES = "xy"


def each(f: Callable, *operands: Any) -> Any:
    """Apply a function of scalars, component by component where there are vectors."""
    vectors = [v for v in operands if isinstance(v, Vector)]
    if not vectors:
        return f(*operands)
    rows = ([v[k] if isinstance(v, Vector) else v for v in operands] for k in range(len(vectors[0])))
    return type(vectors[0])(*(f(*row) for row in rows))


def _install(name: str) -> None:
    f = getattr(operator, name)
    setattr(Vector, f"__{name}__", lambda a, b: each(f, a, b))
    setattr(Vector, f"__r{name}__", lambda a, b: each(f, b, a))


for _name in ("add", "sub", "mul", "truediv"):
    _install(_name)


def dot(a: Any, b: Any) -> Any:
    return sum((x * y for x, y in zip(a, b, strict=True)), 0)


class Frame:
    """In place of ``mi.Frame3f``."""

    def __init__(self, s: Vector, t: Vector, n: Vector):
        self.s, self.t, self.n = s, t, n

    def to_local(self, v: Vector) -> Vector:
        return Vector(dot(self.s, v), dot(self.t, v), dot(self.n, v))

    def to_world(self, v: Vector) -> Any:
        return self.s * v.x + self.t * v.y + self.n * v.z

    @staticmethod
    def cos_theta(v: Vector) -> Value:
        return v.z
