"""Work that somebody else may do: processes of this machine, a Dask cluster, or, without an executor, this process."""

from __future__ import annotations

import contextlib
import gc
import threading
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, Executor, wait
from typing import TypeVar

import drjit as dr
import mitsuba as mi

Item = TypeVar("Item", bound=Hashable)
Result = TypeVar("Result")
_lock = threading.Lock()  # a worker process may have several threads; Dr.Jit records one step at a time


def run_all(
    run: Callable[[Item], Result],
    items: Iterable[Item],
    executor: Executor | None = None,
    tell: Callable[[Mapping[Item, Result]], None] = lambda results: None,
) -> dict[Item, Result]:
    """Return the result of every item, in the order in which they are done.

    Parameters
    ----------
    run : callable
        ``run(item) -> result``. For an executor both must be what pickle takes.
    items : iterable
        All different.
    executor : concurrent.futures.Executor, optional
        Who runs them; this process, one by one, if left out.
    tell : callable
        ``tell(results)`` hears of what is done, first of nothing, then after every item, and at least once a second.

    Examples
    --------
    >>> run_all(abs, [-1, -2], tell=lambda done: print(len(done)))
    0
    1
    2
    {-1: 1, -2: 2}
    """
    results: dict[Item, Result] = {}
    tell(results)
    if executor is None:
        for item in items:
            results[item] = run(item)
            tell(results)
        return results
    futures = {executor.submit(run, item): item for item in items}
    pending = set(futures)
    while pending:
        done, pending = wait(pending, timeout=1, return_when=FIRST_COMPLETED)
        results |= {futures[future]: future.result() for future in done}
        tell(results)
    return results


@contextlib.contextmanager
def alone(variant: str, threads: int = 0) -> Iterator[None]:
    """Let one thread of this process have Dr.Jit while the block runs; what it leaves behind is collected.

    Parameters
    ----------
    variant : str
        Mitsuba variant that the block runs in.
    threads : int
        Of Dr.Jit in this process; 0 leaves them as they are.

    Examples
    --------
    >>> with alone("llvm_ad_rgb"):
    ...     mi.variant()
    'llvm_ad_rgb'
    """
    with _lock:
        if mi.variant() != variant:
            mi.set_variant(variant)
        if threads:
            dr.set_thread_count(threads)
        yield
        gc.collect()  # frozen functions refer to themselves
