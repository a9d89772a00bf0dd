"""The specular lobes that a model may have, and the names of their slots and parameters."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Collection, Iterable, Mapping


@dataclasses.dataclass(frozen=True)
class Lobe:
    """One specular lobe of a model.

    Parameters
    ----------
    index : int
        Its place in the list that the function ``Model.lobes`` returns.
    suffix : str
        The names of its slots and of its own parameters end in it.

    Examples
    --------
    >>> SECOND.alpha_x, of_slot("D2") == SECOND, of_slot("1/E") == FIRST
    ('alpha_x2', True, True)
    """

    index: int
    suffix: str

    def own(self, name: str) -> str:
        """Return the name that a parameter or slot of the first lobe has in this one."""
        return name + self.suffix

    @property
    def rho_s(self) -> str:
        """Name of its specular albedo."""
        return self.own("rho_s")

    @property
    def alpha_x(self) -> str:
        """Name of its roughness along the tangent."""
        return self.own("alpha_x")

    @property
    def alpha_y(self) -> str:
        """Name of its roughness along the bitangent."""
        return self.own("alpha_y")


class AroundBack(tuple):
    """Values of a lobe, (rho_s, alpha_x, alpha_y), that lies around the direction that light came from.

    Sampling tells it by its type from a lobe around the mirror direction, a plain tuple.
    """


FIRST, SECOND = LOBES = Lobe(0, ""), Lobe(1, "2")
# The parameters that every lobe has for itself, as the first lobe calls them; lobes share all others.
OWN = ("rho_s", "alpha_x", "alpha_y")


def of_slot(slot: str) -> Lobe:
    """Return the lobe that a slot belongs to."""
    return next((lobe for lobe in LOBES[1:] if slot.endswith(lobe.suffix)), FIRST)


def rough(names: Collection[str]) -> tuple[Lobe, ...]:
    """Return the lobes whose roughness is among `names`.

    Examples
    --------
    >>> rough({"alpha_x", "alpha_y", "F0"}) == (FIRST,)
    True
    """
    return tuple(lobe for lobe in LOBES if lobe.alpha_x in names)


class _Absent:
    """A colour that is left out because it is 0: a product with it is left out, too, and a sum goes without it."""

    def __mul__(self, other):
        return self

    def __add__(self, other):
        return other

    def __rsub__(self, other):
        return other

    __rmul__ = __truediv__ = __mul__
    __radd__ = __add__

    def __sub__(self, other):
        return -other

    def __neg__(self):
        return self


_ABSENT = _Absent()


def without_absent(lobes: Callable[[Mapping], list[tuple]], colours: Iterable[str], params: Mapping) -> list:
    """Return the lobes of a model, None for one whose colour is not among `params`.

    Parameters
    ----------
    lobes : callable
        As of :class:`mi_enhance.analytic.models.model.Model`.
    colours : iterable of str
        Names of all colours of the model.
    params : dict

    Examples
    --------
    >>> two = lambda p: [(p["A"] * 4.0, 0.1, 0.1), (p["rho_s"], 0.2, 0.2)]
    >>> without_absent(two, ("A", "rho_s"), {"rho_s": 0.5})
    [None, (0.5, 0.2, 0.2)]
    """
    found = lobes({**dict.fromkeys(colours, _ABSENT), **params})
    return [None if lobe[0] is _ABSENT else lobe for lobe in found]
