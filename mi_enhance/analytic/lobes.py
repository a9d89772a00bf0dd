"""The specular lobes that a model may have, and the names of their slots and parameters."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection


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
