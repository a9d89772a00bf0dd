"""Numbers out of a table of text, whatever program wrote it; :mod:`mi_enhance.data.table_header` reads its head."""

from __future__ import annotations

import array
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..system.messages import shortened
from .table_header import Header, decimal, fault_in, is_comment, is_number, read_header, split

_LONGEST_LINE = 1 << 16  # characters; a file without line ends is no table, and must not fill the memory


@dataclass(frozen=True)
class TextTable:
    """The columns that are read.

    Parameters
    ----------
    header : Header
    columns : dict of str to array (N,), float64
        As in the file: angles in its unit.
    lines : array (N,), int
        Line of each row in the file, from 1.
    """

    header: Header
    columns: dict[str, np.ndarray]
    lines: np.ndarray


def read_text(path: Path, where: str) -> TextTable:
    """Read a table of text.

    Parameters
    ----------
    path : Path
        UTF-8, or UTF-16 as spreadsheets write it; lines may end as on any system.
    where : str
        The beginning of error messages.

    Raises
    ------
    ValueError
        If there is no header, a column is missing, or a line is no row of numbers; the message names the line.
    """
    header = read_header(_lines(path, where), where)
    at, mixed = array.array("Q"), _Decimals()

    def rows() -> Iterator[str]:
        for k, line in enumerate(_lines(path, where), 1):
            if k < header.first or is_comment(line):
                continue
            cells = split(line, header.separator, len(header.names))
            if len(cells) != len(header.names):
                raise ValueError("number of cells")  # _first_fault finds the line and says more
            wanted = [cells[j] for j in header.index.values()]
            mixed.see(wanted, k, where)
            at.append(k)
            yield "\t".join(map(decimal, wanted))

    try:
        values = np.loadtxt(rows(), delimiter="\t", ndmin=2, dtype=np.float64, comments=None)
    except ValueError as error:
        raise ValueError(
            _first_fault(path, header, where) or f"{where}: {str(error).removeprefix(f'{where}: ')}"
        ) from None
    return TextTable(header, dict(zip(header.index, values.T, strict=True)), np.array(at, np.int64))


class _Decimals:
    """Refuses a table that has decimal points and commas: one of them separates thousands, and which is a guess."""

    def __init__(self) -> None:
        self.point = self.comma = 0

    def see(self, cells: list[str], line: int, where: str) -> None:
        text = "".join(cells)
        self.point = self.point or ("." in text and line)
        self.comma = self.comma or ("," in text and line)
        if self.point and self.comma:
            raise ValueError(
                f"{where}: a number in line {self.point} has a decimal point, one in line {self.comma} a comma. Write "
                "all of them with a point, and without separators of thousands."
            )


def _first_fault(path: Path, header: Header, where: str) -> str:
    """Return what is wrong with the first line that is no row of numbers, or nothing if all are."""
    for k, line in enumerate(_lines(path, where), 1):
        if k < header.first or is_comment(line):
            continue
        cells = split(line, header.separator, len(header.names))
        if len(cells) != len(header.names) or not all(is_number(decimal(cells[j])) for j in header.index.values()):
            return fault_in(line, header.names, header.separator, f"{where}: line {k}")
    return ""


def _lines(path: Path, where: str) -> Iterator[str]:
    """Yield the lines of a file; bytes that are no text become characters that no number has."""
    with open(path, "rb") as raw:
        head = raw.read(64)
    wide = head[:2] in (b"\xff\xfe", b"\xfe\xff")
    encoding = "utf-16" if wide else "utf-8-sig"  # -sig: spreadsheets put a byte-order mark in front
    with open(path, encoding=encoding, errors="replace" if wide else "surrogateescape") as file:
        k = 0
        while line := file.readline(_LONGEST_LINE):
            k += 1
            if len(line) == _LONGEST_LINE:
                raise ValueError(
                    f"{where}: line {k} is longer than {_LONGEST_LINE} characters. This is no table of text."
                )
            if "\0" in line:
                raise ValueError(f"{where}: line {k} is no text: {shortened(line)}. Save the table as UTF-8.")
            yield line
