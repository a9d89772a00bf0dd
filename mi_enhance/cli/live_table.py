"""The view of a running search: a live table of the candidates of a stage, a line for each finished stage."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

from ..hypercube import states
from ..hypercube.setup import Setup, candidate_folder
from ..hypercube.stages import candidates_of, current_of, is_over, read_stages
from ..system.files import read_json
from ..system.progress import Progress


class LiveTable:
    """A progress callback that draws a table on a terminal; elsewhere it prints only the lines of finished stages.

    Candidates run anywhere, so the table reads what they have written into the folder of the search.

    Parameters
    ----------
    folder : str or Path
        Of the search.

    Examples
    --------
    >>> with LiveTable("out/search") as tell:  # doctest: +SKIP
    ...     search("ggx", materials, "out/search", progress=tell)
    """

    def __init__(self, folder: str | Path):
        from rich.console import Console
        from rich.live import Live

        self._folder = Path(folder).resolve()
        self._console = Console()
        self._live = Live(console=self._console, refresh_per_second=2, transient=True)
        self._n_shown, self._number = 0, 0

    def __enter__(self) -> LiveTable:
        self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._live.stop()

    def __call__(self, progress: Progress) -> None:
        stages = read_stages(self._folder)
        for stage in stages[self._n_shown :]:
            self._console.print(_line(stage), markup=False, highlight=False, soft_wrap=True)
        self._n_shown = len(stages)
        if (self._folder / "samples.npz").exists():  # before, materials are decoded
            self._live.update("" if is_over(stages) else self.table(stages), refresh=True)

    def table(self, stages: list[dict]) -> Any:
        """Return the table of the stage after `stages`, for Rich to print."""
        from rich import box
        from rich.table import Table
        from rich.text import Text

        setup, number = Setup.of(self._folder), len(stages) + 1
        current, around = current_of(setup, stages), candidates_of(setup, stages)
        folders = [candidate_folder(self._folder, number, digits) for digits in around]
        done = sum((folder / "result.json").exists() for folder in folders)
        if number != self._number:
            self._number, self._before, self._begun = number, done, time.perf_counter()
        left = ""
        if done > self._before:
            seconds = (time.perf_counter() - self._begun) / (done - self._before) * (len(around) - done)
            left = f", {seconds:.0f} s left in this stage"
        table = Table(title=f"stage {number}: {done} of {len(around)} candidates{left}", box=box.SIMPLE)
        for header in ("state", "change", "step", "loss", "of unchanged"):
            table.add_column(header, justify="left" if header in ("state", "change") else "right")
        unchanged = None
        for digits, folder in zip(around, folders, strict=True):
            result, progress = (_read(folder / f"{name}.json") for name in ("result", "progress"))
            loss = result["loss"] if result else None
            unchanged = loss if digits == current else unchanged
            table.add_row(
                states.state_digits(digits),
                Text(states.describe_change(current, digits, setup.choices)),  # [F] is no markup
                f"{progress['step']}/{setup.steps}" if progress else "waiting",
                f"{loss:.5f}" if loss is not None else (f"({progress['loss']:.5f})" if progress else ""),
                f"{loss / unchanged:.3f}" if loss is not None and unchanged else "",
            )
        return table


def _line(stage: dict) -> str:
    gain = 1 - stage["loss"] / stage["unchanged"]
    text = f"stage {stage['stage']}: {stage['change']:<12} loss {stage['loss']:.5f}, {gain:.1%} below unchanged"
    text += f"  validation {stage['validation']:.5f}" if "validation" in stage else ""
    return f"{text}  {stage['seconds']:.0f} s  {stage['equation']}"


def _read(path: Path) -> dict | None:
    return read_json(path, "search()", ("loss",)) if path.exists() else None
