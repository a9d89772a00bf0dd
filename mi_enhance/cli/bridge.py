"""Long functions that do not take the one progress callback yet: until they do."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

from ..system.progress import Callback, Progress


def call(function: Callable, *args: Any, progress: Callback, **settings: Any) -> Any:
    """Call `function` with its own kind of callback."""
    names = inspect.signature(function).parameters
    if function.__name__ == "compare_files":
        from ..evaluation.compare import compare_file

        names = inspect.signature(compare_file).parameters
    if "log" in names:
        return function(*args, log=lambda text: progress(Progress(text, 0)), **settings)
    if "callback" not in names:
        return function(*args, progress=progress, **settings)
    if function.__name__ == "train":
        settings |= {"progress": False, "callback": lambda t: progress(Progress("train", t.step))}
    elif function.__name__ == "search":
        settings |= {"progress": False, "callback": lambda s: progress(Progress("stage", s["stage"]))}
    elif function.__name__ == "check":
        settings["callback"] = lambda part: progress(Progress(part, 0))
    else:
        settings["callback"] = lambda stage, step, loss: progress(Progress(stage, step, None, {"loss": loss}))
    return function(*args, **settings)
