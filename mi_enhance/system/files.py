"""Files that are there, and writing that never leaves half a file: shared by all readers and writers."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any


def require_file(path: str | Path, where: str) -> Path:
    """Return `path` as Path, or say what is there instead of a file."""
    path = Path(path)
    if path.is_dir():
        raise ValueError(f"{where}: this is a folder. Give one file in it.")
    if not path.exists():
        raise FileNotFoundError(f"{where}: no such file. Check the name; a relative path starts in {Path.cwd().name}/.")
    return path


def material_name(path: str | Path) -> str:
    """Name of the material in a file that holds one; RGL appends `_rgb` or `_spec`, which is no part of the name."""
    return Path(path).stem.removesuffix("_rgb").removesuffix("_spec")


def digest(*parts: Any) -> str:
    """Return the first 16 hexadecimal digits of the SHA-256 of bytes and arrays, for the name of a cached file."""
    result = hashlib.sha256()
    for part in parts:
        result.update(part)
    return result.hexdigest()[:16]


def read_json(path: str | Path, where: str, needed: Iterable[str] = (), *, lines: bool = False) -> Any:
    """Return the object in a JSON file, or (`lines`) the list of those on its lines, each with the entries `needed`.

    Raises
    ------
    ValueError
        If the file is no JSON, an object is none, or an entry is missing.
    """
    where = f"{where}: {path}"
    try:
        text = Path(path).read_text(encoding="utf-8-sig")
        found = [json.loads(line) for line in text.splitlines()] if lines else [json.loads(text)]
    except (ValueError, RecursionError) as error:  # not JSON, not UTF-8, or nested to break the parser
        raise ValueError(f"{where} is no JSON ({error}). It is damaged; remove it, or choose another folder.") from None
    for k, value in enumerate(found):
        missing = sorted(set(needed) - set(value)) if isinstance(value, dict) else ["everything"]
        if missing:
            at = f", line {k + 1}," if lines else ""
            raise ValueError(
                f"{where}{at} is no object with the entries {', '.join(needed)}: {missing[0]} is missing. It is "
                "damaged; remove it, or choose another folder."
            )
    return found if lines else found[0]


@contextlib.contextmanager
def replacing(path: str | Path) -> Iterator[str]:
    """Yield the name of a temporary file beside `path` that takes its place when the block ends without error."""
    path = Path(path)
    if path.is_dir():
        raise IsADirectoryError(f'cannot write "{path}": this is a folder. Give the name of a file.')
    if not path.parent.is_dir():
        raise FileNotFoundError(f'cannot write "{path}": there is no folder "{path.parent}". Make it first.')
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.", suffix=path.suffix)
    os.close(handle)
    try:
        yield temporary
        os.chmod(temporary, 0o666 & ~_umask())  # mkstemp makes it private; a data file has the usual rights
        os.replace(temporary, path)
    except BaseException:
        os.unlink(temporary)
        raise


def write_text(path: str | Path, text: str) -> None:
    """Write a text file in UTF-8, whole or not at all.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "a.json"
    >>> write_text(path, "[]")
    >>> path.read_text()
    '[]'
    """
    with replacing(path) as temporary:
        Path(temporary).write_text(text, encoding="utf-8")


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
