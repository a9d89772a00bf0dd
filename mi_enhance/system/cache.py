"""Compute something once and keep it in a file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from .files import replacing

T = TypeVar("T")


def cached(path: Path, compute: Callable[[], T], read: Callable[[Path], T], write: Callable[[Path, T], None]) -> T:
    """Return what `path` holds, or compute it and keep it there.

    The file appears whole or not at all, so a killed run never leaves half of one.

    Parameters
    ----------
    path : Path
        The file. Its name must say everything that decides the value, for example by
        :func:`mi_enhance.system.files.digest`. Its folder is made if it is missing.
    compute : callable
        ``compute() -> value``, called only if there is no such file.
    read : callable
        ``read(path) -> value``.
    write : callable
        ``write(path, value)``. It gets the name of a temporary file in the same folder, with the same suffix.

    Returns
    -------
    The value: the computed one the first time, the one in the file from then on.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "kept.txt"
    >>> def answer(value):
    ...     return cached(path, lambda: value, Path.read_text, Path.write_text)
    >>> answer("first"), answer("second")
    ('first', 'first')
    """
    path = Path(path)
    if path.exists():
        return read(path)
    value = compute()
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as temporary:
        write(Path(temporary), value)
    return value
