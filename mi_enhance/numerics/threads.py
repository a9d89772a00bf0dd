"""Matrix products of many parts at once, one thread each.

The products of a fit are tall and thin: a BLAS that divides each of them among its threads takes longer than with one.
"""

from __future__ import annotations

import functools
import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager
from typing import TypeVar

from threadpoolctl import ThreadpoolController

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")


def one_thread() -> AbstractContextManager:
    """Return a context in which BLAS uses one thread: for many small products and systems of some hundred unknowns."""
    return _blas().limit(limits=1, user_api="blas")


def in_threads(function: Callable[[_Item], _Result], items: Iterable[_Item]) -> list[_Result]:
    """Return ``[function(item) for item in items]``, computed side by side; NumPy frees the lock while it computes.

    Examples
    --------
    >>> in_threads(abs, [-1, 2, -3])
    [1, 2, 3]
    """
    with one_thread():
        return list(_pool().map(function, items))


@functools.cache
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(os.cpu_count())


@functools.cache
def _blas() -> ThreadpoolController:
    return ThreadpoolController()
