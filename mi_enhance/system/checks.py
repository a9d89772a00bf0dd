"""Checks of arguments that many functions take."""

from __future__ import annotations

import numbers

import numpy as np
from numpy.typing import ArrayLike

from .messages import shortened

UNIT_TOLERANCE = 1e-3  # directions may be off unit length by this much: float32 and short decimals, not mistakes


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


def instance_of(value: object, kind: type, name: str, where: str, get_by: str) -> None:
    """Raise unless `value` is of a class; `get_by` says how one gets such an object.

    Raises
    ------
    TypeError

    Examples
    --------
    >>> instance_of("0.5", float, "spp", "render()", "float(text)")
    Traceback (most recent call last):
    TypeError: render(): spp is '0.5', of type str; it must be a float. Get one by float(text).
    """
    if not isinstance(value, kind):
        raise TypeError(
            f"{where}: {name} is {shortened(value)}, of type {type(value).__name__}; it must be a {kind.__name__}. "
            f"Get one by {get_by}."
        )


def unit_vectors(w: np.ndarray, name: str, where: str) -> None:
    """Raise unless all rows of `w`, (N, 3), have length 1; NaN and infinity have not.

    Raises
    ------
    ValueError
        The message names the first bad row.

    Examples
    --------
    >>> unit_vectors(np.array([[0, 0.6, 0.8], [0, 0, 2]]), "wo", "fit()")
    Traceback (most recent call last):
    ValueError: fit(): wo[1] is [0.0, 0.0, 2.0]; it must have length 1. 1 of 2 directions are like this. Divide them ...
    """
    bad = ~(np.abs(np.linalg.norm(w.astype(np.float64), axis=1) - 1) <= UNIT_TOLERANCE)
    if bad.any():
        k = int(np.argmax(bad))
        raise ValueError(
            f"{where}: {name}[{k}] is {w[k].tolist()}; it must have length 1. {int(bad.sum())} of {len(w)} directions "
            "are like this. Divide them by their length."
        )


def direction_pairs(wi: ArrayLike, wo: ArrayLike, where: str) -> tuple[np.ndarray, np.ndarray]:
    """Return directions towards viewer and light as float32 arrays (N, 3), or raise unless they are N unit vectors.

    Raises
    ------
    ValueError

    Examples
    --------
    >>> direction_pairs([[0, 0, 1]], [[0, 0.6, 0.8]], "fit()")[1].shape
    (1, 3)
    """
    wi, wo = np.asarray(wi, np.float32), np.asarray(wo, np.float32)
    if wi.shape != wo.shape or wi.ndim != 2 or wi.shape[1] != 3 or not len(wi):
        raise ValueError(f"{where}: wi and wo have shapes {wi.shape} and {wo.shape}; both must be (N, 3).")
    unit_vectors(wi, "wi", where)
    unit_vectors(wo, "wo", where)
    return wi, wo
