"""Settings as frozen dataclasses, and the one check of what they may be."""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Callable, Collection, Mapping
from typing import Any, ClassVar, TypeVar

from .messages import did_you_mean, shortened

_TOO_MUCH = 1e12  # no setting is that large; infinity and NaN are refused by it, too


@dataclasses.dataclass(frozen=True)
class Rule:
    """The range of a setting.

    Parameters
    ----------
    allowed : str
        Completes the sentence "it must be ...".
    holds : callable
        ``holds(value) -> bool``; it may assume nothing about the type of the value.
    """

    allowed: str
    holds: Callable[[Any], bool]


def whole(low: int = 0, high: float = _TOO_MUCH) -> Rule:
    """Return the rule of a whole number of at least `low`, and at most `high` if that is given.

    Examples
    --------
    >>> [whole(1).holds(value) for value in (1, 0, True, 2.0)]
    [True, False, False, False]
    """
    return Rule(_range("a whole number", low, high), lambda v: type(v) is int and low <= v <= high)


def number(low: float = 0.0) -> Rule:
    """Return the rule of a finite number of at least `low`.

    Examples
    --------
    >>> [number(0).holds(value) for value in (0.5, 2, True, float("nan"))]
    [True, True, False, False]
    """
    return Rule(_range("a number", low, _TOO_MUCH), lambda v: type(v) in (int, float) and low <= v <= _TOO_MUCH)


def one_of(*choices: object) -> Rule:
    """Return the rule of a value among `choices`."""
    words = [repr(c).replace("'", '"') for c in choices]
    return Rule(f"{', '.join(words[:-1])} or {words[-1]}", lambda v: type(v) in map(type, choices) and v in choices)


def of_type(allowed: str, *types: type) -> Rule:
    """Return the rule of a value of one of the `types`, in words `allowed`."""
    return Rule(allowed, lambda v: isinstance(v, types))


TEXT, FLAG, TABLE = of_type("a text", str), of_type("true or false", bool), of_type("an object {...}", Mapping)
LIST = of_type("a list [...]", list, tuple)


def setting(default: Any, rule: Rule) -> Any:
    """Return the field of a setting, for a subclass of `Settings`."""
    return dataclasses.field(default_factory=lambda: copy.copy(default), metadata={"rule": rule})


S = TypeVar("S", bound="Settings")


@dataclasses.dataclass(frozen=True)
class Settings:
    """Base of all settings: every value is checked, wherever it comes from.

    Raises
    ------
    ValueError
        If a value breaks the rule of its field.

    Examples
    --------
    >>> @dataclasses.dataclass(frozen=True)
    ... class Shot(Settings):
    ...     WHERE = "shoot()"
    ...     spp: int = setting(16, whole(1))
    >>> Shot.of({"spp": 4}).to_json()
    {'spp': 4}
    >>> Shot.of({"ssp": 4})
    Traceback (most recent call last):
    ValueError: shoot(): unknown setting "ssp". Choose from: spp. Did you mean "spp"?
    >>> Shot(spp=0)
    Traceback (most recent call last):
    ValueError: shoot(): spp is 0; it must be a whole number of at least 1.
    """

    WHERE: ClassVar[str]

    def __post_init__(self) -> None:
        check(self._entries(), self._rules(), self.WHERE)

    @classmethod
    def of(cls: type[S], given: Mapping[str, Any]) -> S:
        """Return the settings that differ from the defaults as `given`.

        Raises
        ------
        ValueError
            For an unknown name, and as the class.
        """
        refuse_unknown(given, cls._rules(), cls.WHERE)
        return cls(**given)

    def to_json(self) -> dict[str, Any]:
        """Return all settings as a dictionary that JSON can hold."""
        return copy.deepcopy(self._entries())

    def _entries(self) -> dict[str, Any]:
        return {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}

    @classmethod
    def _rules(cls) -> dict[str, Rule]:
        return {f.name: f.metadata["rule"] for f in dataclasses.fields(cls)}


def refuse_unknown(given: Mapping[str, Any], known: Collection[str], where: str) -> None:
    """Raise a ValueError if there is an entry whose name is not `known`."""
    for name in given:
        if name not in known:
            raise ValueError(
                f'{where}: unknown setting "{name}". Choose from: {", ".join(known)}.{did_you_mean(name, known)}'
            )


def check(given: Mapping[str, Any], rules: Mapping[str, Rule], where: str) -> None:
    """Raise a ValueError if an entry breaks its rule; entries without a rule may be anything."""
    for name, value in given.items():
        rule = rules.get(name)
        if rule and not rule.holds(value):
            raise ValueError(f"{where}: {name} is {shortened(value)}; it must be {rule.allowed}.")


def _range(kind: str, low: float, high: float) -> str:
    return f"{kind} of at least {low:g}" if high >= _TOO_MUCH else f"{kind} from {low:g} to {high:,.0f}"
