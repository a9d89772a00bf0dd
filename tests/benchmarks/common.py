"""What the benchmarks share: the machine in words, interleaved medians, the end of a run."""

from __future__ import annotations

import json
import os
import platform
import statistics
import time
from collections.abc import Callable, Mapping
from importlib import metadata
from pathlib import Path


def machine(*packages: str) -> dict:
    """Processor, cores, and versions of what decides the figures."""
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
    """Seconds of every job in every round, A B C A B C: what disturbs the machine for a while disturbs all of them."""
    for job in jobs.values():
        for _ in range(warm_up):
            job()
    seconds = {name: [] for name in jobs}
    for _ in range(rounds):
        for name, job in jobs.items():
            seconds[name].append(clock(job)[0])
    return seconds


def clock(job: Callable) -> tuple[float, object]:
    """Seconds that `job` takes, and what it returns."""
    start = time.perf_counter()
    result = job()
    return time.perf_counter() - start, result


def spread(seconds: list[float]) -> dict:
    """Median and extremes: medians are compared, extremes show how quiet the machine was."""
    return {"seconds": statistics.median(seconds), "seconds_min": min(seconds), "seconds_max": max(seconds)}


def folder_name(label: str) -> str:
    """The label of a run as the name of its folder."""
    return "".join(c if c.isalnum() else "_" for c in label)


def finish(rows: list[dict], columns: dict, *, title: str, about: dict, as_json: bool) -> None:
    """Print the table and the machine; one JSON object last if asked for."""
    from mi_enhance.table import print_table

    print_table(rows, columns, title=title)
    print(", ".join(f"{key} {value}" for key, value in about.items()))
    if as_json:
        print(json.dumps({"machine": about, "rows": rows}))
