"""Standard output and error as they come: in any encoding, closed from the start, or closed by who reads them."""

from __future__ import annotations

import contextlib
import io
import os
import select
import sys
from collections.abc import Iterator
from typing import TextIO

CLOSED = 141  # the shell's status of a program that SIGPIPE ended, as it ends `cat` or `ls`


def accept_any() -> None:
    """Write "?" for what the encoding of a stream does not have, and nothing where there is no stream."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:  # closed before this process began
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))
        elif isinstance(stream, io.TextIOWrapper) and stream.errors in ("strict", "surrogateescape"):
            stream.reconfigure(errors="replace")


@contextlib.contextmanager
def until_closed() -> Iterator[None]:
    """End the process silently where the reader of its output has gone, as in ``mi-enhance show m.bsdf | head -1``.

    Raises
    ------
    SystemExit
        With status `CLOSED`.
    """
    try:
        try:
            yield
        finally:
            _flush()
    except BrokenPipeError:
        if not any(_reader_is_gone(stream) for stream in (sys.stdout, sys.stderr)):
            raise  # another pipe: a process that works for this one died
        for stream in (sys.stdout, sys.stderr):
            if _reader_is_gone(stream):
                _discard(stream)
        raise SystemExit(CLOSED) from None


def _flush() -> None:
    """Write what is left now: while Python shuts down nobody could handle an error."""
    try:
        sys.stdout.flush()
    except BrokenPipeError:
        raise
    except OSError as error:  # a full disk
        _discard(sys.stdout)
        print(f"mi-enhance: standard output cannot be written ({error.strerror}).", file=sys.stderr)
        raise SystemExit(2) from None


def _discard(stream: TextIO) -> None:
    """Send to nowhere what Python flushes at its end."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def _reader_is_gone(stream: TextIO) -> bool:
    if not hasattr(select, "poll"):  # Windows
        return stream is sys.stdout
    try:
        poll = select.poll()
        poll.register(stream, 0)
        return any(event & (select.POLLERR | select.POLLHUP) for _, event in poll.poll(0))
    except (OSError, ValueError):  # no file behind it, as in tests
        return False
