"""Output paths: checked before any work is done, so that no result is lost for want of a place."""

from __future__ import annotations

import contextlib
import os
import tempfile
from collections.abc import Iterable
from pathlib import Path


def output_file(name: str | Path, suffixes: tuple[str, ...], inputs: Iterable[str | Path | None] = ()) -> Path:
    """Return the path of a file to be written, once it is sure that it can be.

    Parameters
    ----------
    name : str or Path
        As the user gave it.
    suffixes : tuple of str
        Those allowed, in lower case.
    inputs : iterable of str, Path or None
        Files that the command reads; it must not write over them.

    Raises
    ------
    ValueError
        If the suffix is another, the path is a folder, or one of `inputs`.
    OSError
        If nothing can be written there.

    Examples
    --------
    >>> output_file("gold.exr", (".bsdf",))
    Traceback (most recent call last):
    ValueError: -o: "gold.exr" must end in .bsdf.
    """
    path = Path(name)
    if path.suffix.lower() not in suffixes:
        raise ValueError(f'-o: "{name}" must end in {" or ".join(suffixes)}.')
    if path.is_dir():
        raise ValueError(f'-o: "{name}" is a folder. Name a file, in it or elsewhere.')
    if any(is_same(path, other) for other in inputs):
        raise ValueError(f'-o: "{name}" is what the command reads. Choose another name.')
    if path.exists() and not os.access(path, os.W_OK):
        raise PermissionError(f'-o: "{name}" is write-protected. Choose another name.')
    _probe(path.parent, path.name)
    return path


def output_folder(name: str | Path, option: str = "-o") -> Path:
    """Return the path of a folder to be written into, once it is sure that it can be.

    Raises
    ------
    ValueError
        If there is a file of that name.
    OSError
        If nothing can be written there.

    Examples
    --------
    >>> output_folder("out").name
    'out'
    """
    path = Path(name)
    if path.exists() and not path.is_dir():
        raise ValueError(f'{option}: "{name}" is a file. Name a folder.')
    _probe(path, "result", option)
    return path


def made(path: Path) -> Path:
    """Make the folder of a file to be written now."""
    path.parent.mkdir(parents=True, exist_ok=True)
    return path


def is_same(path: Path, other: str | Path | None) -> bool:
    """Tell whether two names are of one file that exists, whatever links lie between."""
    try:
        return other is not None and os.path.samefile(path, other)
    except (OSError, ValueError):  # one of them does not exist
        return False


def _probe(folder: Path, name: str, option: str = "-o") -> None:
    """Make what writing will make, a temporary file beside the result, and take it away again."""
    missing = [p for p in (folder, *folder.parents) if not p.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(dir=folder, prefix=f".{name}.", suffix=Path(name).suffix)
        os.close(handle)
        os.unlink(temporary)
    except OSError as error:
        reason = error.strerror or str(error)
        raise type(error)(f'{option}: nothing can be written to "{folder}" ({reason}). Choose another place.') from None
    finally:
        for path in missing:
            with contextlib.suppress(OSError):  # it was not made, or somebody else uses it by now
                path.rmdir()
