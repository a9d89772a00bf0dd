"""Parts of error messages that many places need."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


def did_you_mean(word: object, choices: Iterable[str]) -> str:
    """Return a closing sentence with the closest of `choices`, or nothing if none is close.

    Examples
    --------
    >>> did_you_mean("wardd", ["ggx", "ward"])
    ' Did you mean "ward"?'
    >>> did_you_mean("phong", ["ggx", "ward"])
    ''
    """
    close = difflib.get_close_matches(str(word), list(choices), n=1)
    return f' Did you mean "{close[0]}"?' if close else ""


def shortened(value: object, length: int = 60) -> str:
    """Return the `repr` of a value, cut to `length` characters.

    Examples
    --------
    >>> shortened("a" * 100, 10)
    "'aaaaaa..."
    """
    return cut(repr(value), length)


def cut(text: str, length: int = 60) -> str:
    """Return a text, cut to `length` characters.

    Examples
    --------
    >>> cut("a + b + c + d", 10)
    'a + b +...'
    """
    return text if len(text) <= length else f"{text[: length - 3]}..."
