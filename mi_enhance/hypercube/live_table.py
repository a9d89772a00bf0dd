"""What one sees while a search runs: a live table of the candidates of a stage, a line for each finished stage."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path

from ..system.files import read_json
from . import states
from .setup import Setup, candidate_folder


class Silent:
    """No view: what a caller gets that wants none."""

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass

    def started(self, number: int, current: states.State, around: Sequence[states.State]) -> None:
        """A stage begins."""

    def update(self) -> None:
        """A candidate may have gone on."""

    def finished(self, stages: list[dict]) -> None:
        """The last of `stages` is over."""


class LiveTable(Silent):
    """A table that rewrites itself on a terminal; elsewhere only the lines of finished stages.

    Candidates run anywhere: what they did is read from their folders.

    Parameters
    ----------
    folder : Path
        Of the search.
    setup : Setup
    """

    def __init__(self, folder: Path, setup: Setup):
        from rich.console import Console
        from rich.live import Live

        self._folder, self._setup = folder, setup
        self._console = Console()
        self._live = Live(console=self._console, refresh_per_second=2, transient=True)
        self._around, self._number, self._begun = [], 0, time.perf_counter()

    def __enter__(self):
        self._live.start()
        return self

    def __exit__(self, *_):
        self._live.stop()

    def started(self, number: int, current: states.State, around: Sequence[states.State]) -> None:
        self._number, self._current, self._around = number, current, around
        self._begun = time.perf_counter()
        self._before = self._n_finished()
        self.update()

    def update(self) -> None:
        self._live.update(self._table(), refresh=True)

    def finished(self, stages: list[dict]) -> None:
        s = stages[-1]
        gain = 1 - s["loss"] / s["unchanged"]
        text = f"stage {s['stage']}: {s['change']:<12} loss {s['loss']:.5f}, {gain:.1%} below unchanged"
        text += f"  validation {s['validation']:.5f}" if "validation" in s else ""
        self._console.print(
            f"{text}  {s['seconds']:.0f} s  {s['equation']}", markup=False, highlight=False, soft_wrap=True
        )

    def _n_finished(self) -> int:
        return sum((self._path(d) / "result.json").exists() for d in self._around)

    def _path(self, digits: states.State) -> Path:
        return candidate_folder(self._folder, self._number, digits)

    def _table(self):
        from rich import box
        from rich.table import Table
        from rich.text import Text

        done = self._n_finished()
        elapsed = time.perf_counter() - self._begun
        left = ""
        if done > self._before:
            left = f", {elapsed / (done - self._before) * (len(self._around) - done):.0f} s left in this stage"
        table = Table(title=f"stage {self._number}: {done} of {len(self._around)} candidates{left}", box=box.SIMPLE)
        for header in ("state", "change", "step", "loss", "of unchanged"):
            table.add_column(header, justify="left" if header in ("state", "change") else "right")
        unchanged = None
        for digits in self._around:
            result, progress = (_read(self._path(digits) / f"{name}.json") for name in ("result", "progress"))
            loss = result["loss"] if result else None
            unchanged = loss if digits == self._current else unchanged
            table.add_row(
                states.state_digits(digits),
                # [F] is no markup
                Text(states.describe_change(self._current, digits, self._setup.choices)),
                f"{progress['step']}/{self._setup.steps}" if progress else "waiting",
                f"{loss:.5f}" if result else (f"({progress['loss']:.5f})" if progress else ""),
                f"{loss / unchanged:.3f}" if result and unchanged else "",
            )
        return table


def _read(path: Path) -> dict | None:
    return read_json(path, "search()", ("loss",)) if path.exists() else None
