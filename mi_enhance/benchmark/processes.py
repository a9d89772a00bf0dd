"""One process for each thing that is timed, asked in turn.

Dr.Jit traces every BSDF that is alive in a process into each of its kernels, used or not: contenders that shared one
process would pay for each other.
"""

from __future__ import annotations

import multiprocessing
import os
import tempfile
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import ProcessPoolExecutor
from typing import Any

import mitsuba as mi

from . import timing

_job: Callable[[], Any] | None = None  # of this process


class Workers:
    """Processes by name, which live as long as the block.

    Examples
    --------
    >>> with Workers(["a", "b"]) as workers:  # doctest: +SKIP
    ...     workers.seconds({"a": (make_job, 1), "b": (make_job, 2)}, rounds=5)
    {'a': 0.12, 'b': 0.34}
    """

    def __init__(self, names: Iterable[str]):
        self._pools = {name: _pool() for name in names}

    def __enter__(self) -> Workers:
        return self

    def __exit__(self, *error: object) -> None:
        for pool in self._pools.values():
            pool.shutdown(wait=True, cancel_futures=True)

    def seconds(self, jobs: Mapping[str, tuple], rounds: int, **kwargs: Any) -> dict[str, float]:
        """Median seconds of jobs that run in turn, A B C A B C, each in its own process.

        Parameters
        ----------
        jobs : dict of str to tuple
            A function, and arguments with which it makes the job: a callable without any. Both can be pickled.
        rounds : int
            Runs of each job that count, after one that compiles.
        **kwargs
            For all the functions.
        """
        started = [self._pools[name].submit(_prepare, mi.variant() or "", *job, **kwargs) for name, job in jobs.items()]
        for future in started:
            future.result()
        own: dict[str, list[float]] = {name: [] for name in jobs}
        for _ in range(rounds):
            for name, seconds in own.items():
                seconds.append(self._pools[name].submit(_run).result())  # measured inside, without the way there
        return {name: timing.spread(s)["seconds"] for name, s in own.items()}


def first_frames(job: tuple, **kwargs: Any) -> dict[str, float | None]:
    """Seconds until a job has been made and run once in a fresh process.

    Parameters
    ----------
    job : tuple
        As for :meth:`Workers.seconds`.

    Returns
    -------
    dict
        ``cold`` with an empty kernel cache, ``warm`` with the kernels of the first process in it; the import of the
        packages is over. ``megabytes`` is the largest memory of the process.
    """
    result: dict[str, float | None] = {}
    before = os.environ.get("DRJIT_CACHE_DIR")
    with tempfile.TemporaryDirectory() as cache:
        os.environ["DRJIT_CACHE_DIR"] = cache  # read when Dr.Jit is imported, in the child
        try:
            for key in ("cold", "warm"):
                with _pool() as pool:
                    result[key], result["megabytes"] = pool.submit(_first, mi.variant() or "", *job, **kwargs).result()
        finally:
            if before is None:
                del os.environ["DRJIT_CACHE_DIR"]
            else:
                os.environ["DRJIT_CACHE_DIR"] = before
    return result


def _pool() -> ProcessPoolExecutor:
    # spawn: Dr.Jit's threads do not survive a fork
    return ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn"))


def _prepare(variant: str, make: Callable, *args: Any, **kwargs: Any) -> None:
    global _job
    if mi.variant() != variant:
        mi.set_variant(variant)
    _job = None  # what is no longer needed must not be traced
    _job = make(*args, **kwargs)
    _job()


def _run() -> float:
    assert _job is not None  # _prepare comes first
    return timing.clock(_job)[0]


def _first(variant: str, make: Callable, *args: Any, **kwargs: Any) -> tuple[float, float | None]:
    mi.set_variant(variant)
    seconds, _ = timing.clock(lambda: make(*args, **kwargs)())
    return seconds, timing.peak_megabytes()
