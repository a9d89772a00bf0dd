"""Files that may be replaced in a folder: those that this package has written there, unless somebody changed them."""

from __future__ import annotations

import contextlib
import json
import os
import re
from collections.abc import Iterator
from pathlib import Path, PurePosixPath

from ..system.files import digest, replacing

# One line for each file written: its name and a digest. Nothing is ever taken out.
_LIST = ".mi_enhance_files.jsonl"
_LONGEST = 1 << 24  # bytes of it that are read: a list of 100,000 files
_DRIVE = re.compile(r"[A-Za-z]:")
_SUFFIX = re.compile(r"\.(exr|png|jsonl?)$", re.IGNORECASE)  # of what is written: no folder has one, so none is a file
_MOST_BYTES, _MOST_PARTS = 200, 8  # of a name, and of a path: systems have 255, and 260 or 4096 for all
_FORBIDDEN = re.compile(r'[<>:"|?*\x00-\x1f]')  # in names on some system
_DEVICES = re.compile(r"(con|prn|aux|nul|com\d|lpt\d)(\.|$)", re.IGNORECASE)  # files of that name are none on Windows


class OwnFiles:
    """A folder in which only own files are replaced.

    Parameters
    ----------
    folder : Path
        Made if missing.
    where : str
        What an error begins with.
    """

    def __init__(self, folder: Path, where: str):
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except (FileExistsError, NotADirectoryError):
            raise ValueError(f"{where}: {folder} is no folder: a file or a link is there. Choose another.") from None
        if os.path.lexists(folder / _LIST) and not _is_file(folder / _LIST):
            raise ValueError(f"{where}: {folder / _LIST} is no file of mi_enhance. Choose another folder.")
        self.folder, self.where = folder, where
        self._written = _read(folder / _LIST)

    def check(self, name: str) -> Path:
        """Return the path of a file that may be written.

        Raises
        ------
        ValueError
            If it lies outside the folder (through a link, for example), or if somebody else's file has that name.
        """
        path = self.folder / name
        try:
            is_inside = path.parent.resolve().is_relative_to(self.folder.resolve())
        except (OSError, RuntimeError):  # links in a circle
            is_inside = False
        if not is_inside:
            raise ValueError(
                f'{self.where}: "{name}" lies outside {self.folder}, through a link. Choose another folder.'
            )
        between = [self.folder / p for p in PurePosixPath(name).parents]
        wrong = next((p for p in between if os.path.lexists(p) and not p.is_dir()), None)
        if wrong or (os.path.lexists(path) and not self._is_own(path, name)):
            raise ValueError(
                f"{self.where}: {wrong or path} exists, and was not written by mi_enhance or has been changed since. "
                "It stays as it is. Choose another folder."
            )
        return path

    def _is_own(self, path: Path, name: str) -> bool:
        return _is_file(path) and (name, digest(path.read_bytes())) in self._written

    @contextlib.contextmanager
    def replacing(self, name: str) -> Iterator[str]:
        """Yield the name of a temporary file that takes the place of `name` when the block ends without error."""
        path = self.check(name)
        path.parent.mkdir(parents=True, exist_ok=True)
        with replacing(path) as temporary:
            yield temporary
            entry = name, digest(Path(temporary).read_bytes())
            # before the file takes its place: if the process ends between, the list has one line too many
            if entry not in self._written:
                with (self.folder / _LIST).open("a", encoding="utf-8") as lines:
                    lines.write(json.dumps(entry) + "\n")
                self._written.add(entry)


def _read(path: Path) -> set[tuple[str, str]]:
    if not path.exists():
        return set()
    with path.open(encoding="utf-8", errors="replace") as opened:
        lines = opened.read(_LONGEST).splitlines()
    found = set()
    for line in lines:
        with contextlib.suppress(ValueError, RecursionError):  # a line cut off: its file counts as not ours
            entry = json.loads(line)
            if isinstance(entry, list) and len(entry) == 2 and all(isinstance(e, str) for e in entry):
                found.add((entry[0], entry[1]))
    return found


def _is_file(path: Path) -> bool:
    """False for a link: writing would lead to what it shows."""
    return path.is_file() and not path.is_symlink()


def inner_name(name: str) -> str:
    """Return a relative path inside a folder for any name: without drive, root and parent folders.

    Examples
    --------
    >>> inner_name("../images/a"), inner_name("/data/a"), inner_name(r"C:\\\\photos\\\\a"), inner_name("left/a")
    ('images/a', 'data/a', 'photos/a', 'left/a')
    """
    parts = [p for p in re.split(r"[\\/]", name) if p not in ("", ".", "..") and not _DRIVE.fullmatch(p)]
    parts = [p.encode("utf-8", "replace")[:_MOST_BYTES].decode(errors="ignore") for p in parts[-_MOST_PARTS:]]
    parts = [_FORBIDDEN.sub("_", p).rstrip(". ") or "_" for p in parts]  # Windows drops dots and spaces at the end
    parts[:-1] = [_SUFFIX.sub(r"_\1", p) for p in parts[:-1]]
    parts = [f"_{p}" if _DEVICES.match(p) else p for p in parts]
    return PurePosixPath(*parts).as_posix() if parts else "view"
