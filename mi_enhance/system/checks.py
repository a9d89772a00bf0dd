"""Checks of arguments that many functions take."""

from __future__ import annotations

import numbers

from .messages import shortened


def positive_int(value: object, name: str, where: str) -> int:
    """Return `value` as an int, or raise unless it is a whole number of at least 1.

    Integers of NumPy are whole numbers; ``True`` and ``4.0`` are not.

    Parameters
    ----------
    value : object
    name, where : str
        Name of the argument, and of the function that has it, for the message.

    Raises
    ------
    ValueError
        If `value` is no positive integer.

    Examples
    --------
    >>> import numpy as np
    >>> positive_int(np.int64(3), "spp", "render()")
    3
    >>> positive_int(0, "spp", "render()")
    Traceback (most recent call last):
    ValueError: render(): spp is 0; it must be a positive integer.
    """
    if isinstance(value, bool) or not isinstance(value, numbers.Integral) or value < 1:
        raise ValueError(f"{where}: {name} is {shortened(value)}; it must be a positive integer.")
    return int(value)
