"""The analytic terms that can take one another's place in a slot."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeVar

import numpy as np

from ...system.messages import did_you_mean
from ..lobes import of_slot
from ..parameters import Parameter

Arrays = Mapping[str, np.ndarray]
F = TypeVar("F", bound=Callable)


@dataclasses.dataclass(frozen=True)
class Alternative:
    """An analytic term, and all that it needs to take another's place.

    Parameters
    ----------
    term : callable
        A function of named quantities and parameters.
    slot : str
        The letter of the paper that it stands for: ``"B"``, ``"D"``, ``"F"``, ``"G"``, ``"1/E"``.
    parameters : tuple of Parameter
        The parameters that it brings along where a model has none of that name.
    start : callable
        ``start(values) -> dict``. From the values of the model's own parameters, arrays (M,), it computes values of
        `parameters` with which the term resembles the usual term of the slot most.
    roughness : callable, optional
        ``roughness(params) -> alpha`` of the GGX lobe that covers it, if its width is not alpha_x, alpha_y.
    around_back : bool
        The lobe lies around the direction that light came from, and is sampled there.
    """

    term: Callable
    slot: str
    parameters: tuple[Parameter, ...] = ()
    start: Callable[[Arrays], Arrays] = lambda values: {}
    roughness: Callable[[Mapping], Any] | None = None
    around_back: bool = False


ALTERNATIVES: dict[str, Alternative] = {}


def term(
    slot: str,
    *,
    parameters: Sequence[Parameter] = (),
    start: Callable[[Arrays], Arrays] = lambda values: {},
    roughness: Callable[[Mapping], Any] | None = None,
    around_back: bool = False,
) -> Callable[[F], F]:
    """Register a function as a term that can stand in a slot of any model; see :class:`Alternative`.

    A term that only makes sense in its own model, such as a D that is not normalized, is not registered.

    Examples
    --------
    >>> get("D_ggx").slot
    'D'
    """

    def register(function: F) -> F:
        ALTERNATIVES[function.__name__] = Alternative(function, slot, tuple(parameters), start, roughness, around_back)
        return function

    return register


def get(name: str, slot: str = "") -> Alternative:
    """Return the alternative called `name`.

    Raises
    ------
    KeyError
        If there is none. The message lists the choices for `slot`, or all if none is made for it.
    """
    if name not in ALTERNATIVES:
        letter = slot.removesuffix(of_slot(slot).suffix)
        choices = [n for n, a in ALTERNATIVES.items() if a.slot == letter] or list(ALTERNATIVES)
        raise KeyError(
            f'alternatives: unknown term "{name}". Choose one of: {", ".join(choices)}.{did_you_mean(name, choices)}'
        )
    return ALTERNATIVES[name]
