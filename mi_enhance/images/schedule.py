"""The order of a fit: several starts go down a way, the best goes on; and a run that was killed does where it was."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Container, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import mitsuba as mi
import numpy as np

from ..numerics.schedules import cosine_decay
from ..system.files import digest
from ..system.progress import Callback, Progress
from . import checkpoint
from .descent import Descent
from .survey import Survey

TRIAL = 25  # iterations of a start before the best is taken
_LATE = 0.2  # of the first stage's iterations without the latent numbers
_LAST_RATE = 0.05  # learning rate at the end, as a share of that at the start
_TIMED = 3  # iterations from which the time that is left is told
_KEEP_EVERY = 20.0  # seconds between two states on disk

Way = Mapping[str, np.ndarray]


class _Leg(NamedTuple):
    """Some iterations in a row."""

    label: str
    stage: int
    first: int  # of the stage's pixels
    rates: list[float]
    late: int
    way: int | None  # the start it begins with; None: where the descent is, or the best of the starts


def stable_names(descent: Descent) -> dict[str, str]:
    """Return a name of every scene parameter that is the same in the next process.

    Mitsuba's keys of a shape without an id hold its address.
    """
    return {key: str(k) for k, key in enumerate(descent.params.keys())}


def contents(params: mi.SceneParameters, sought: Container[str]) -> str:
    """Return a digest of shapes, lights and materials of a scene, but for what is sought."""
    values = [getattr(params[k], "matrix", params[k]) for k in params.keys() if k not in sought]  # noqa: SIM118
    return digest(*(np.ascontiguousarray(np.array(v, np.float32)) for v in values))


class Schedule:
    """All iterations of a fit.

    Parameters
    ----------
    descent : Descent
    book : Survey
    stages : sequence of (int, int, int)
        1 / size, samples per pixel, iterations.
    lr : float
    settings : mapping
        What decides the run: a state of other settings is not gone on from.
    path : Path, optional
        The state on disk.
    """

    def __init__(
        self,
        descent: Descent,
        book: Survey,
        stages: Sequence[tuple[int, int, int]],
        lr: float,
        settings: Mapping[str, Any],
        path: Path | None,
    ):
        self.descent, self.book, self.stages, self.lr = descent, book, stages, lr
        self.settings, self.path = settings, path
        self.ways: list[dict[str, np.ndarray]] = []
        self.ends: list[tuple[float, dict[str, np.ndarray]]] = []
        self.done = 0

    def resume(self) -> bool:
        """Go on from the state on disk; return False if there is none."""
        kept = checkpoint.load(self.path, self.settings) if self.path else None
        if kept is None:
            if self.path and self.path.exists():
                warnings.warn(
                    f"fit_images(): {self.path} is of a run with other settings, photographs or another scene, or is "
                    "damaged. This fit begins anew.",
                    stacklevel=3,
                )
            return False
        about, arrays = kept
        keys = {name: key for key, name in stable_names(self.descent).items()}
        pick = lambda start: {  # noqa: E731
            keys.get(own, own): v for k, v in arrays.items() for own in [k.removeprefix(start)] if k.startswith(start)
        }
        self.ways = [pick(f"way{k}.") for k in range(about["ways"])]
        self.ends = [(loss, pick(f"end{k}.")) for k, loss in enumerate(about["ends"])]
        self.done, self.descent.curve = about["done"], about["curve"]
        is_trial = 1 < len(self.ways) > len(self.ends)
        self.descent.put(self.ways[len(self.ends)] if is_trial else self._best())  # also what is no unknown
        self.descent.restore({part: pick(f"{part}.") for part in ("moved", "adam", "counts")})
        self.descent.start = time.perf_counter() - about["seconds"]
        return True

    def keep(self) -> None:
        """Write the state."""
        if not self.path:
            return
        parts: dict[str, Way] = {**self.descent.state()}
        parts |= {f"way{k}": way for k, way in enumerate(self.ways)}
        parts |= {f"end{k}": values for k, (_, values) in enumerate(self.ends)}
        names = stable_names(self.descent)
        arrays = {f"{part}.{names.get(k, k)}": v for part, values in parts.items() for k, v in values.items()}
        about = {
            "ways": len(self.ways),
            "ends": [loss for loss, _ in self.ends],
            "done": self.done,
            "curve": self.descent.curve,
            "seconds": time.perf_counter() - self.descent.start,
        }
        checkpoint.save(self.path, self.settings, about, arrays)

    def run(self, progress: Callback, every: Callable[[int], None], kept: Callable[[], None]) -> None:
        """Take all iterations that are left.

        Parameters
        ----------
        progress : callable
            Told of every iteration, with the ``loss`` and the seconds ``left``.
        every : callable
            ``every(step)`` after each.
        kept : callable
            Called from time to time, when this is the best so far; the state is written then, too.
        """
        legs = self._legs()
        total = sum(len(leg.rates) for leg in legs)
        begun = last_kept = time.perf_counter()
        first = before = 0
        for leg in legs:
            start = self.done - before
            if start < len(leg.rates):
                self._begin(leg, is_new=start == 0)
                for k in self._steps(leg, start):
                    now, values = time.perf_counter(), {"loss": self.descent.curve[-1]["loss"]}
                    if not first:
                        begun, first = now, self.done  # the first one compiles
                    elif self.done >= first + _TIMED:
                        values["left"] = (now - begun) / (self.done - first) * (total - self.done)
                    progress(Progress(leg.label, k + 1, len(leg.rates), values))
                    every(self.done)
                    if leg.way is not None and k + 1 == len(leg.rates):
                        self.ends.append((self.descent.loss(), {**self.ways[leg.way], **self.descent.values()}))
                    if now - last_kept > _KEEP_EVERY or self.done == 1:
                        self.keep()
                        # during the starts only if none that has ended was better
                        if not self.ends or leg.way is None or self.descent.loss() <= min(e for e, _ in self.ends):
                            kept()
                        last_kept = time.perf_counter()
            before += len(leg.rates)
        self.descent.settle()

    def _legs(self) -> list[_Leg]:
        n_trials = len(self.ways) if len(self.ways) > 1 else 0
        legs = [_Leg(f"start {k + 1} of {n_trials}", 0, k * TRIAL, [self.lr] * TRIAL, 0, k) for k in range(n_trials)]
        n = sum(steps for *_, steps in self.stages)
        rates = [self.lr * cosine_decay(k, n, low=_LAST_RATE) for k in range(n)]
        for k, (_, _, steps) in enumerate(self.stages):
            label, late = f"stage {k + 1} of {len(self.stages)}", round(_LATE * steps) if k == 0 else 0
            legs.append(_Leg(label, k, n_trials * TRIAL if k == 0 else 0, rates[:steps], late, None))
            rates = rates[steps:]
        return legs

    def _begin(self, leg: _Leg, is_new: bool) -> None:
        if not is_new:
            return
        if leg.way is not None:
            self.descent.put(self.ways[leg.way])
        elif leg.stage == 0:
            self.descent.put(self._best())

    def _best(self) -> Way:
        return min(self.ends, key=lambda end: end[0])[1] if self.ends else self.ways[0]

    def _steps(self, leg: _Leg, start: int) -> Iterator[int]:
        pixels, spp = self.book.stages[leg.stage], self.stages[leg.stage][1]
        for k, target in enumerate(pixels.batches(leg.first + start, leg.first + len(leg.rates)), start):
            self.descent.step(target, spp, leg.rates[k], hold_late=k < leg.late)
            self.done += 1
            yield k
