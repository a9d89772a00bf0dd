"""Growth of the time of a frame with pixels, depth and materials."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from ..evaluation import scenes
from .contender import Contender
from .contenders import EXACT, REFERENCE
from .jobs import MANY, frame, many, sphere
from .processes import Workers, first_frames

_GROWING = (REFERENCE, EXACT, "specialized, max error 0.001")


GROWTH_COLUMNS = {
    "what": ("what grows", ""),
    "value": ("to", "d"),
    **{label: (f"{label}, ms", ".0f") for label in _GROWING},
    "ratio": ("exact to GGX", ".2f"),
    "ratio_fast": ("specialized to GGX", ".2f"),
}


def growth(fitted: Sequence[Mapping[str, Contender]], workers: Workers, resolution: int, rounds: int) -> list[dict]:
    """Return the milliseconds of a frame as image, depth and number of materials grow."""
    rows: list[dict] = []

    def add(what: str, value: int, seconds: Mapping[str, Any]) -> None:
        exact, fast = (seconds[REFERENCE] / seconds[label] for label in _GROWING[1:])
        ms = {label: 1e3 * s for label, s in seconds.items()}
        rows.append({"what": what, "value": value, **ms, "ratio": exact, "ratio_fast": fast})

    def measure(what: str, value: int, load: Callable, given: Callable, **size) -> None:
        jobs = {label: (frame, load, given(label)) for label in _GROWING}
        add(what, value, workers.seconds(jobs, rounds, spp=16, **size))

    one = fitted[0].get
    for n in (resolution // 2, resolution, 2 * resolution):
        measure("pixels on a side", n, sphere, one, resolution=n)
    for n in (2, 4, 8, 16):
        measure("depth", n, sphere, one, resolution=resolution, max_depth=n)
    for frozen in (False, True):
        for n in (1, 5, MANY):
            given = lambda label, n=n: many(fitted, label, n)  # noqa: E731
            what = "materials, dr.freeze" if frozen else "materials"
            measure(what, n, scenes.spheres, given, resolution=resolution, frozen=frozen)
    for n in (1, MANY):
        jobs = {label: (frame, scenes.spheres, many(fitted, label, n)) for label in _GROWING}
        cold = {label: first_frames(job, resolution=resolution, spp=1)["cold"] for label, job in jobs.items()}
        add("materials, first frame", n, cold)
    return rows
