"""Text files of keywords and numbers, read word by word: what optics programs write."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ..system.messages import shortened

_LONGEST = 1 << 28  # bytes; a table of a million directions has 15 MB


def read_lines(path: Path, where: str) -> list[str]:
    """Return the lines of a text file that is not too long to be one."""
    if path.stat().st_size > _LONGEST:
        raise ValueError(f"{where}: {path.stat().st_size} bytes are no table of text.")
    return path.read_text(encoding="utf-8-sig", errors="replace").splitlines()


class Words:
    """The words of a file, one after the other; lines that begin with # are left out.

    Parameters
    ----------
    path : Path
    where : str
        The beginning of messages.
    """

    def __init__(self, path: Path, where: str):
        self.where = where
        self.line = 0
        self._words = self._split(read_lines(path, where))

    def _split(self, lines: list[str]) -> Iterator[str]:
        for k, line in enumerate(lines, 1):
            self.line = k
            if not line.lstrip().startswith("#"):
                yield from line.split()

    def next(self, wanted: str) -> str:
        """Return the next word; `wanted` says what it should be, if there is none."""
        word = next(self._words, None)
        if word is None:
            raise ValueError(f"{self.where}: the file ends where {wanted} should be. It is cut off; get it again.")
        return word

    def keyword(self, wanted: str) -> str:
        """Return the next word; a number there belongs to a list that is longer than it says."""
        word = self.next(wanted)
        try:
            float(word)
        except ValueError:
            return word
        raise ValueError(
            f"{self.where}: line {self.line} has the number {shortened(word)} where {wanted} should be: there are more "
            "numbers than the file says. Correct the count before them, or get the file again."
        )

    def number(self, wanted: str) -> float:
        """Return the next word as a finite number."""
        word = self.next(wanted)
        try:
            value = float(word)
        except ValueError:
            value = np.nan
        if not abs(value) <= np.finfo(np.float32).max:
            raise ValueError(f"{self.where}: line {self.line} has {shortened(word)} where {wanted} should be.")
        return value

    def numbers(self, n: int, wanted: str) -> np.ndarray:
        """Return the next `n` words as numbers."""
        return np.array([self.number(wanted) for _ in range(n)])

    def counted(self, wanted: str) -> np.ndarray:
        """Return a list of numbers that is preceded by its length."""
        n = self.number(f"the number of {wanted}")
        if not 1 <= n <= 1e5 or n != int(n):
            raise ValueError(f"{self.where}: line {self.line} says there are {n:g} {wanted}; it must be 1 to 100000.")
        return self.numbers(int(n), wanted)

    def choice(self, choices: tuple[str, ...], wanted: str) -> str:
        """Return the next word, which must be one of `choices` in any case of letters."""
        word = self.next(wanted)
        found = next((c for c in choices if c.lower() == word.lower()), None)
        if found is None:
            raise ValueError(
                f"{self.where}: line {self.line} says {wanted} is {shortened(word)}; known are {', '.join(choices)}."
            )
        return found
