"""Stand-ins for ``drjit`` and ``mitsuba`` that record what a BRDF computes.

:func:`recording` puts them in the place of both modules wherever those are known by a name, so that terms, modules and
sampling run as they are and a new term needs nothing. Where no recorded value is involved they hand on to Dr.Jit.
"""

from __future__ import annotations

import contextlib
import functools
import math
import sys
import threading
from collections.abc import Callable, Iterator
from typing import Any

import drjit
import mitsuba

from .recorder import Recorder, Table, Value, active, gather, operation, power, select, value
from .vectors import Colour, Frame, Point2, Vector, dot, each

# ---------------------------------------------------------------------- functions of drjit


def _cross(a: Any, b: Any) -> Vector:
    return Vector(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x)


def _scalar(op: str) -> Callable:
    return lambda *operands: each(functools.partial(operation, op), *operands)


def _clip(x: Any, low: Any, high: Any) -> Any:
    return each(lambda v, a, b: operation("min", operation("max", v, a), b), x, low, high)


def _mean(x: Any) -> Any:
    return sum(x, 0) * (1 / len(x)) if isinstance(x, Vector) else x


def _rsqrt(x: Any) -> Any:
    return each(functools.partial(operation, "rsqrt"), x)


FUNCTIONS: dict[str, Callable] = {
    **{name: _scalar(name) for name in ("fma", "abs", "floor", "sqrt", "rsqrt", "exp", "exp2", "log", "log2")},
    **{name: _scalar(name) for name in ("sin", "cos", "tan", "tanh", "asin", "acos", "atan", "atan2")},
    "minimum": _scalar("min"),
    "maximum": _scalar("max"),
    "clip": _clip,
    "select": lambda mask, a, b: each(select, mask, a, b),
    "rcp": lambda x: 1 / x,
    "square": lambda x: x * x,
    "power": lambda a, b: each(power, a, b),
    "safe_sqrt": lambda x: each(lambda v: operation("sqrt", operation("max", v, 0)), x),
    "safe_acos": lambda x: each(lambda v: operation("acos", v), _clip(x, -1, 1)),
    "sincos": lambda x: (operation("sin", x), operation("cos", x)),
    "sign": lambda x: each(lambda v: select(v < 0, -1, 1), x),
    "copysign": lambda a, b: each(lambda x, y: select(value(y) < 0, -abs(x), abs(x)), a, b),
    "lerp": lambda a, b, t: each(lambda x, y, s: x + (y - x) * s, a, b, t),
    "dot": dot,
    "cross": _cross,
    "squared_norm": lambda v: dot(v, v),
    "norm": lambda v: operation("sqrt", dot(v, v)),
    "normalize": lambda v: v * _rsqrt(dot(v, v)),
    "mean": _mean,
    "sum": lambda x: sum(x, 0),
    "max": lambda x: functools.reduce(functools.partial(operation, "max"), x),
    "min": lambda x: functools.reduce(functools.partial(operation, "min"), x),
    "gather": lambda kind, table, index: gather(table, index),
    "detach": lambda x: x,
    "grad_enabled": lambda *x: False,
    "make_opaque": lambda *x: None,
    "eval": lambda *x: None,
    "depth_v": lambda x: 2 if isinstance(x, Vector) else 1,
    "size_v": len,
}


def _recorded(x: Any) -> bool:
    """Tell whether anything in `x` is recorded."""
    if isinstance(x, (list, tuple)):
        return any(map(_recorded, x))
    return isinstance(x, (Value, Vector, Table))


class _DrJit:
    """In place of the module ``drjit``."""

    def __getattr__(self, name: str) -> Any:
        own = getattr(drjit, name)
        if not callable(own) or isinstance(own, type):
            return own
        stand_in = FUNCTIONS.get(name)

        def call(*args: Any, **keywords: Any) -> Any:
            if not _recorded((args, *keywords.values())):
                return own(*args, **keywords)
            if stand_in is None:
                raise NotImplementedError(
                    f"export: drjit.{name}() cannot be translated. Terms may use: {', '.join(sorted(FUNCTIONS))}."
                )
            return stand_in(*args, **keywords)

        return call


# ---------------------------------------------------------------------- mitsuba


def _cosine_hemisphere(u: Point2) -> Vector:
    """Malley's method: a point of the unit disc, and the height above it."""
    r, phi = operation("sqrt", u.x), u.y * (2 * math.pi)
    height = operation("sqrt", operation("max", 1 - u.x, 0))
    return Vector(r * operation("cos", phi), r * operation("sin", phi), height)


class _Warp:
    """In place of ``mi.warp``."""

    square_to_cosine_hemisphere = staticmethod(_cosine_hemisphere)
    square_to_cosine_hemisphere_pdf = staticmethod(lambda w: w.z * (1 / math.pi))


class _Microfacets:
    """In place of ``mi.MicrofacetDistribution`` for GGX: its visible normals.

    Dupuy and Benyoub 2023, *Sampling Visible GGX Normals with Spherical Caps*, listing 3. The density is Mitsuba's, the
    map from random numbers to normals another.
    """

    def __init__(self, kind: Any, alpha_x: Value, alpha_y: Value, sample_visible: bool):
        if kind != mitsuba.MicrofacetType.GGX or not sample_visible:
            raise NotImplementedError("export: only visible normals of GGX can be translated.")
        self.alpha_x, self.alpha_y = alpha_x, alpha_y

    def sample(self, wi: Vector, u: Point2) -> tuple[Any, None]:
        normalize = FUNCTIONS["normalize"]
        view = normalize(Vector(wi.x * self.alpha_x, wi.y * self.alpha_y, wi.z))
        phi, z = u.x * (2 * math.pi), (1 - u.y) * (1 + view.z) - view.z
        r = operation("sqrt", operation("max", 1 - z * z, 0))
        h = Vector(r * operation("cos", phi), r * operation("sin", phi), z) + view
        return normalize(Vector(h.x * self.alpha_x, h.y * self.alpha_y, operation("max", h.z, 1e-12))), None


def _of_kind(kind: Any) -> Callable:
    return lambda x=0: x if isinstance(x, Table) else operation(kind, value(x)) if kind != "bool" else value(x, "bool")


_MITSUBA: dict[str, Any] = {
    "Float": _of_kind("float"),
    "UInt32": _of_kind("int"),
    "Int32": _of_kind("int"),
    "Mask": _of_kind("bool"),
    "Bool": _of_kind("bool"),
    "Vector3f": Vector,
    "Normal3f": Vector,
    "Point3f": Vector,
    "Color3f": Colour,
    "Spectrum": Colour,
    "Point2f": Point2,
    "Vector2f": Point2,
    "Frame3f": Frame,
    "warp": _Warp,
    "MicrofacetDistribution": _Microfacets,
}


class _Mitsuba:
    """In place of the module ``mitsuba``."""

    def __getattr__(self, name: str) -> Any:
        return _MITSUBA[name] if name in _MITSUBA else getattr(mitsuba, name)


_LOCK = threading.Lock()


@contextlib.contextmanager
def recording() -> Iterator[Recorder]:
    """Record all that is computed while the block runs.

    No other thread may evaluate a BRDF meanwhile; it takes a fraction of a second.

    Examples
    --------
    >>> from mi_enhance import terms
    >>> with recording() as recorder:
    ...     F = terms.F_schlick(recorder.input("cos_theta_d", varying=True), 0.04)
    >>> F.op, F.varying
    ('add', True)
    """
    stand_ins = {id(drjit): _DrJit(), id(mitsuba): _Mitsuba()}
    with _LOCK, active(Recorder()) as recorder:
        places: list[tuple[dict, str, Any]] = [(sys.modules, m.__name__, m) for m in (drjit, mitsuba)]
        places += [
            (module.__dict__, name, found)
            for key, module in list(sys.modules.items())
            if not key.startswith(("drjit", "mitsuba", __package__))
            for name, found in list(getattr(module, "__dict__", {}).items())
            if found is drjit or found is mitsuba
        ]
        try:
            for names, name, found in places:
                names[name] = stand_ins[id(found)]
            yield recorder
        finally:
            for names, name, found in places:
                names[name] = found
