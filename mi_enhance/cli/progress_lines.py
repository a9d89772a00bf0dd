"""Progress of a long command as lines of text: for files, for pipes, and beside ``--json``."""

from __future__ import annotations

import sys
import time

from ..system.progress import Callback, Progress

_EVERY = 20.0  # seconds


def progress_lines(title: str) -> Callback:
    """Return what a long function calls; it writes a line to stderr when a stage begins and every 20 seconds.

    Where the function tells how many seconds are ``left``, the line says so, and the first line that can is written at
    once: it is the estimate of how long all takes.

    Examples
    --------
    >>> tell = progress_lines("fit")
    >>> tell(Progress("stage 1 of 1", 1, 10, {"loss": 0.5, "left": 90.0}))
    """
    stage, was_told, has_estimate = "", 0.0, False

    def tell(progress: Progress) -> None:
        nonlocal stage, was_told, has_estimate
        is_estimate = "left" in progress.values and not has_estimate
        now = time.monotonic()
        if progress.stage == stage and not is_estimate and now - was_told < _EVERY:
            return
        stage, was_told, has_estimate = progress.stage, now, has_estimate or is_estimate
        print(f"{title}: {line(progress)}", file=sys.stderr, flush=True)

    return tell


def line(progress: Progress) -> str:
    """Return one state in words.

    Examples
    --------
    >>> line(Progress("stage 1 of 2", 40, 150, {"loss": 0.0312, "left": 200.0}))
    'stage 1 of 2, 40 of 150, loss 0.0312, about 3 min left'
    """
    parts = [progress.stage]
    if progress.step:
        parts.append(f"{progress.step} of {progress.total}" if progress.total else str(progress.step))
    parts += [f"{name} {value:.4g}" for name, value in progress.values.items() if name != "left"]
    if "left" in progress.values:
        parts.append(f"about {duration(progress.values['left'])} left")
    return ", ".join(parts)


def duration(seconds: float) -> str:
    """Return a time in words.

    Examples
    --------
    >>> duration(12), duration(200), duration(9000)
    ('12 s', '3 min', '2.5 h')
    """
    if seconds < 100:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 6000 else f"{seconds / 3600:.1f} h"
