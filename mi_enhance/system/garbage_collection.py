"""Garbage collection while Dr.Jit records."""

from __future__ import annotations

import contextlib
import gc
from collections.abc import Iterator


@contextlib.contextmanager
def no_collection() -> Iterator[None]:
    """Keep Python's garbage collector from freeing the frozen function of an earlier run while Dr.Jit records another.

    It is part of a reference cycle inside Dr.Jit, so only the collector frees it; during a recording that aborts
    the process.
    """
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()
