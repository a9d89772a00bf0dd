"""Timings that can be trusted: interleaved runs, medians, the machine in words and its best rate."""

from __future__ import annotations

import os
import platform
import statistics
import time
from collections.abc import Callable, Mapping
from importlib import metadata
from pathlib import Path
from typing import TypeVar

import numpy as np

T = TypeVar("T")


def machine(*packages: str) -> dict:
    """Return processor, cores, load, and versions of the packages that decide the figures, and of further `packages`.

    Examples
    --------
    >>> sorted(machine())[:4]
    ['cores', 'cpu', 'drjit', 'load']
    """
    names = ("mi-enhance", "mitsuba", "drjit", "numpy", *packages)
    return {
        "cpu": _cpu(),
        "cores": os.cpu_count(),
        "load": round(os.getloadavg()[0], 1),  # before the run: a busy machine makes its figures worthless
        "system": platform.platform(terse=True),
        "python": platform.python_version(),
        **{name: metadata.version(name) for name in names},
    }


def _cpu() -> str:
    info = Path("/proc/cpuinfo")  # Linux; elsewhere the standard library knows
    lines = info.read_text().splitlines() if info.exists() else []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor()


def interleaved(jobs: Mapping[str, Callable], rounds: int, warm_up: int = 2) -> dict[str, list[float]]:
    """Return the seconds of every job in every round, A B C A B C: a disturbance of the machine then meets all of them.

    Examples
    --------
    >>> {name: len(seconds) for name, seconds in interleaved({"a": list, "b": dict}, rounds=3).items()}
    {'a': 3, 'b': 3}
    """
    for job in jobs.values():
        for _ in range(warm_up):
            job()
    seconds: dict[str, list[float]] = {name: [] for name in jobs}
    for _ in range(rounds):
        for name, job in jobs.items():
            seconds[name].append(clock(job)[0])
    return seconds


def clock(job: Callable[[], T]) -> tuple[float, T]:
    """Return the seconds that `job` takes, and its result."""
    start = time.perf_counter()
    result = job()
    return time.perf_counter() - start, result


def spread(seconds: list[float]) -> dict:
    """Return median and extremes: medians are compared, extremes show how quiet the machine was.

    Examples
    --------
    >>> spread([3.0, 1.0, 2.0])
    {'seconds': 2.0, 'seconds_min': 1.0, 'seconds_max': 3.0}
    """
    return {"seconds": statistics.median(seconds), "seconds_min": min(seconds), "seconds_max": max(seconds)}


def peak_gflops(size: int = 2048, rounds: int = 5) -> float:
    """Return the GFLOP/s of a product of two float32 matrices in NumPy, the best that the cores do."""
    a = np.random.default_rng(0).random((size, size), np.float32)
    return 2 * size**3 / min(interleaved({"": lambda: a @ a}, rounds)[""]) / 1e9


def peak_megabytes() -> float | None:
    """Return the largest memory of this process, where Linux tells it; ``getrusage`` would count the parent's."""
    status = Path("/proc/self/status")
    lines = status.read_text().splitlines() if status.exists() else []
    return next((int(line.split()[1]) / 1024 for line in lines if line.startswith("VmHWM")), None)
