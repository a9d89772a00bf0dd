"""The head of a table of text: which columns it has, in which units, and how its numbers are separated.

Programs write it in many ways. A header may follow lines of comment, stand behind ``#`` (``numpy.savetxt``) or be in
quotes, have units behind the names or in a line of their own, and have another separator than the numbers.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from ..system.messages import shortened

VECTORS = ("wi_x", "wi_y", "wi_z", "wo_x", "wo_y", "wo_z")
ANGLES = ("theta_i", "phi_i", "theta_o", "phi_o")
RGB, GREY = ("f_r", "f_g", "f_b"), ("f",)
EXPECTED = (
    f"Expected is one line of column names above the numbers: {', '.join(VECTORS)}, or {', '.join(ANGLES)} (radians; "
    "degrees as theta_i_deg, ...); and f_r, f_g, f_b; or f; or wavelengths, f_450nm, f_550nm, ... "
    "Separate by commas, semicolons, tabs or spaces; begin "
    "lines of comment with #."
)

_RAD, _DEG, _PER_SR, _NONE = "rad", "deg", "1/sr", ""
_UNITS = {
    **dict.fromkeys(ANGLES, {**dict.fromkeys(("rad", "radian", "radians"), _RAD)}
                    | dict.fromkeys(("deg", "degree", "degrees", "°"), _DEG)),
    **dict.fromkeys((*RGB, *GREY), dict.fromkeys(("1/sr", "sr^-1", "sr-1", "sr**-1", "sr⁻¹"), _PER_SR)),
    **dict.fromkeys(VECTORS, dict.fromkeys(("1", "-", "none"), _NONE)),
}  # fmt: skip
_SPECTRAL = re.compile(r"(?i)f[_ ]?(\d{1,5}(?:\.\d+)?)\s*(?:nm|\[nm\]|\(nm\))(?:\s*[\[(]\s*(?:1/sr|sr\^?-1)\s*[\])])?")
_LONGEST_FIRST = sorted(_UNITS, key=len, reverse=True)  # f_r before f
_SEPARATORS = (";", "\t", ",", None)  # None: any white space; last, as it stands beside the others, too
_COMMENT = re.compile(r"^\s*(?:#|%|//|sep=)")  # sep=: a line for Excel
_FORTRAN = re.compile(r"(?<=[\d.])[dD](?=[+-]?\d+$)")  # the exponent of double precision
_MOST_LINES = 1000  # of text before the numbers
# Words for angles in degrees, outside of the header; "23 °C" and "seen at 45 deg" do not.
_DEGREES = re.compile(r"(?<!\d)(?<!\d\s)(?:\bdeg(?:rees?)?\b|°)(?!\s*[cf]\b)", re.IGNORECASE)
_RADIANS = re.compile(r"\brad(?:ians?)?\b", re.IGNORECASE)
_OF_ANGLES = re.compile(r"angle|theta|phi|polar|azimuth|unit|direction", re.IGNORECASE)


@dataclass(frozen=True)
class Header:
    """The header of a table: what the lines above the numbers say.

    Parameters
    ----------
    names : tuple of str
        Columns of the file.
    index : dict of str to int
        Place of each column that is read.
    units : dict of str to str
        ``"rad"``, ``"deg"`` or ``""`` of each of them; only what the file says.
    separator : str or None
        Between numbers; None is white space.
    first : int
        Line of the first numbers, from 1.
    comments_say_degrees : bool
        A comment speaks of angles in degrees.
    """

    names: tuple[str, ...]
    index: dict[str, int]
    units: dict[str, str]
    separator: str | None
    first: int
    comments_say_degrees: bool


def wavelength(name: str) -> float | None:
    """Return the wavelength in nm of a column of a spectrum; None for another column.

    Examples
    --------
    >>> wavelength("f_550nm"), wavelength("f 412.5 [nm]"), wavelength("f_r")
    (550.0, 412.5, None)
    """
    found = _SPECTRAL.fullmatch(name.strip())
    return float(found[1]) if found else None


def is_comment(line: str) -> bool:
    """Tell whether a line holds no numbers: it is empty, but for separators, or begins as comments do."""
    return not line.strip(" ,;\t\r\n") or _COMMENT.match(line) is not None


def split(line: str, separator: str | None, n: int = 0) -> list[str]:
    """Return the cells of a line of numbers; a separator at its end makes no cell beyond the first `n`."""
    line = line.strip().split("#")[0].rstrip(" ")
    cells = _unquoted(line, separator or " ") if '"' in line else line.split(separator)
    return cells[:-1] if len(cells) > n and separator and not cells[-1].strip() else cells


def _unquoted(line: str, separator: str) -> list[str]:
    try:
        return next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])
    except csv.Error:  # a cell beyond the limit of the module, or a NUL
        return line.split(separator)


def decimal(cell: str) -> str:
    """Return a number with a decimal point and an exponent e; what stands in one cell has no other use for a comma.

    Examples
    --------
    >>> decimal("0,25"), decimal(" 2.5D-01")
    ('0.25', '2.5e-01')
    """
    return _FORTRAN.sub("e", cell.strip().replace(",", "."))


def is_number(cell: str) -> bool:
    """Tell whether a cell, as :func:`decimal` returns it, is a number; ``nan`` and ``inf`` are."""
    try:
        float(cell)
    except ValueError:
        return False
    return "_" not in cell  # 1_000 is a number in Python alone


def read_header(lines: Iterable[str], where: str) -> Header:
    """Read lines up to the first numbers.

    Raises
    ------
    ValueError
        If there is no header, a column is missing, named twice or in another unit, or no numbers follow.
    """
    names: list[str] = []
    units: dict[int, str] = {}
    comments, closest = [], (0, "The file is empty.")
    separator = None
    for k, line in enumerate(lines, 1):
        if k > _MOST_LINES:
            break
        if not line.strip():
            continue
        if not names:
            bare = line.replace("\udcb0", "°")  # the byte of ° where the text is no UTF-8
            found = _names(_COMMENT.sub("", bare, count=1).lstrip("#%/"), f"{where}: line {k}")
            if found.complete:
                names, units, separator = found.names, found.units, found.separator
                header_line = k
                continue
            if _is_numbers(line) and not is_comment(line):
                closest = closest if closest[0] else (0, f"Line {k} holds numbers already.")
                break
            if found.known >= closest[0]:
                closest = found.known + 1, f"Line {k} is {shortened(line.strip())}.{found.missing}"
            comments.append(bare)
        elif is_comment(line):
            comments.append(line)
        elif (given := _units_of(line, names, separator)) is not None:
            units |= given
        else:
            return _header(names, units, _separator(line, names, separator, f"{where}: line {k}"), k, comments)
    if names:
        raise ValueError(f"{where}: no numbers below the header in line {header_line}. {EXPECTED}")
    raise ValueError(f"{where}: no line names the columns. {closest[1]} {EXPECTED}")


@dataclass(frozen=True)
class _Names:
    """The column names in a line: "" for a column that is not known."""

    names: list[str]
    units: dict[int, str]
    separator: str | None

    @property
    def known(self) -> int:
        return sum(n in _UNITS or wavelength(n) is not None for n in self.names)

    @property
    def complete(self) -> bool:
        return _needed(self.names) is not None

    @property
    def missing(self) -> str:
        if not self.known:
            return ""
        directions = max((VECTORS, ANGLES), key=lambda group: len({*group} & {*self.names}))
        colours = () if {*GREY} <= {*self.names} else RGB
        return f" Missing in it: {', '.join(n for n in (*directions, *colours) if n not in self.names)}."


def _needed(names: Sequence[str]) -> tuple[str, ...] | None:
    """Return the columns to read; None if some are missing. Vectors come before angles, colours before spectra."""
    directions = next((g for g in (VECTORS, ANGLES) if {*g} <= {*names}), None)
    spectrum = tuple(n for n in names if wavelength(n) is not None)
    colours = next((g for g in (RGB, GREY) if {*g} <= {*names}), spectrum or None)
    return (*directions, *colours) if directions and colours else None


def _names(line: str, where: str) -> _Names:
    """Return the names in a line, by the separator that finds most of them."""
    found = []
    for separator in _SEPARATORS:
        if separator:
            cells = _unquoted(line.strip(), separator)
        else:  # a unit in brackets belongs to the name before it
            cells = re.findall(r"[^\s\[(]+(?:\s*[\[(][^\])]*[\])])?", line)
        cells = [c.strip().strip("\"'").strip() for c in cells]
        cells = cells[:-1] if cells and not cells[-1] else cells
        parts = [_column(c) for c in cells]
        names = [name or cell for (name, _), cell in zip(parts, cells, strict=True)]
        found.append((_Names(names, {k: u for k, (_, u) in enumerate(parts) if u is not None}, separator), parts))
    best, parts = max(found, key=lambda f: f[0].known)
    if best.complete:
        for name, unit in parts:
            if name and unit is not None and unit not in _UNITS[name].values():
                allowed = ", ".join(_UNITS[name])
                raise ValueError(f"{where}: column {name} is in {shortened(unit)}; known units are {allowed}.")
        twice = {n for n in best.names if (n in _UNITS or wavelength(n)) and best.names.count(n) > 1}
        if twice:
            raise ValueError(f"{where}: the column {min(twice)} stands there twice. Leave one of them.")
    return best


def _column(cell: str) -> tuple[str | None, str | None]:
    """Return name and unit in a cell of the header: (None, None) for another column.

    Examples
    --------
    >>> _column("Theta_i [deg]"), _column("phi_o_rad"), _column("f (1/sr)"), _column("f_r"), _column("f_r_std")
    (('theta_i', 'deg'), ('phi_o', 'rad'), ('f', '1/sr'), ('f_r', None), (None, None))
    >>> _column("theta_i [grad]")  # refused later
    ('theta_i', 'grad')
    """
    text = cell.casefold()
    for name in _LONGEST_FIRST:
        if not text.startswith(name):
            continue
        rest = text[len(name) :]
        if not rest:
            return name, None
        parts = re.fullmatch(r"(\s*[\[({/]|\s+in\s+|[\s_]+|(?=°))\s*(.*?)\s*[\])}]?", rest)
        if parts and (parts[2] in _UNITS[name] or parts[1].strip() in ("[", "(", "{", "/")):
            return name, _UNITS[name].get(parts[2], parts[2])
    return None, None


def _units_of(line: str, names: Sequence[str], separator: str | None) -> dict[int, str] | None:
    """Return the units in a line below the header that holds nothing else, by column; None for any other line."""
    cells = [c.strip(" []()").casefold() for c in split(line.replace("\udcb0", "°"), separator)]
    given = {}
    for k, (name, cell) in enumerate(zip(names, cells)):  # noqa: B905  (the last cells may be empty)
        if name in _UNITS and cell:
            if cell not in _UNITS[name]:
                return None
            given[k] = _UNITS[name][cell]
    return given or None


def _separator(line: str, names: Sequence[str], of_header: str | None, where: str) -> str | None:
    """Return the separator of the first line of numbers, or say what is wrong with that line."""
    needed = [names.index(n) for n in _needed(names) or ()]
    for separator in dict.fromkeys((of_header, *_SEPARATORS)):
        cells = split(line, separator, len(names))
        if len(cells) == len(names) and all(is_number(decimal(cells[k])) for k in needed):
            return separator
    raise ValueError(fault_in(line, names, of_header, where))


def fault_in(line: str, names: Sequence[str], separator: str | None, where: str) -> str:
    """Return what is wrong with a line that is no row of numbers."""
    cells = split(line, separator, len(names))
    if len(cells) != len(names):
        hint = ""
        if separator == "," and len(cells) > len(names):
            hint = " If commas are decimal commas, separate the columns by semicolons."
        return f"{where} has {len(cells)} cells under {len(names)} column names: {shortened(line.strip())}.{hint}"
    k = next((names.index(n) for n in _needed(names) or () if not is_number(decimal(cells[names.index(n)]))), None)
    if k is None:
        return f"{where}: {shortened(line.strip())} cannot be read. {EXPECTED}"
    return f"{where}: {shortened(cells[k].strip())} in column {names[k]} is no number."


def _is_numbers(line: str) -> bool:
    """Tell whether a line holds nothing but two or more numbers."""
    parts = [split(line, s) for s in _SEPARATORS]
    return any(len(cells) > 1 and all(is_number(decimal(c)) for c in cells) for cells in parts)


def _header(names: list[str], units: dict[int, str], separator: str | None, first: int, comments: list[str]) -> Header:
    needed = _needed(names) or ()
    index = {n: names.index(n) for n in needed}
    of_angles = [c for c in comments if _OF_ANGLES.search(c)]
    degrees = any(_DEGREES.search(c) for c in of_angles) and not any(_RADIANS.search(c) for c in of_angles)
    return Header(
        names=tuple(names),
        index=index,
        units={n: units[k] for n, k in index.items() if k in units},
        separator=separator,
        first=first,
        comments_say_degrees=degrees,
    )
