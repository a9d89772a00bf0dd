"""ASTM E1392 / E2387 goniometer tables: text, `.astm`, as Cornell's measurements and optics programs write them.

Keywords with a value, one a line; the last is VARS with the names of the columns: theta_i, phi_i, theta_s, phi_s and
the values (1/sr): R, G, B; X, Y, Z; wavelengths (``550nm``); or a single one, which is grey. Then a line of numbers for
each pair, separated by commas. `i` is the light, `s` the viewer. Angles are radians; they are degrees if a polar angle
is above pi. With one phi_i for all rows the file is isotropic.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from ..system.files import require_file
from ..system.messages import shortened
from .directions import direction
from .measurements import Measurements
from .registry import reader
from .rows import finite, from_rows
from .spectra import to_rgb
from .words import read_lines

_VARS = re.compile(r"^\s*VARS\s*[=:\s]\s*(.+)$", re.IGNORECASE)
_POINTS = re.compile(r"^\s*NUM_POINTS\s*[=:\s]\s*(\d+)\s*$", re.IGNORECASE)
_MOST_LINES = 1000  # before VARS


def _knows(head: bytes) -> bool:
    return re.search(rb"(?m)^\s*VARS\b", head) is not None


@reader("astm", about="ASTM .astm", suffixes=(".astm",), scattered=True, knows=_knows)
def read(path: str | Path, *, n_samples: int = 100_000, seed: int = 0) -> Measurements:
    """Return the measured pairs of directions.

    Parameters
    ----------
    path : str or Path
    n_samples, seed : int
        As for `mi_enhance.data.loading.load`.

    Raises
    ------
    ValueError
        If VARS is missing, a line is no row of numbers, or a value is not finite.

    References
    ----------
    ASTM E1392-96 (the data format that E2387 refers to), as Cornell's light measurement laboratory publishes it.

    Examples
    --------
    >>> read("garnet-red.astm").name  # doctest: +SKIP
    'garnet-red'
    """
    where = f'data.load("{path}")'
    lines = read_lines(require_file(path, where), where)
    first, names = _header(lines, where)
    rows, at = [], []
    for k, line in enumerate(lines[first:], first + 1):
        if not line.strip(" ,\t"):
            continue
        cells = [c for c in re.split(r"[,\s]+", line.strip()) if c]
        try:
            rows.append([float(c) for c in cells])
        except ValueError:
            rows.append([])
        if len(rows[-1]) != len(names):
            raise ValueError(
                f"{where}: line {k} is {shortened(line.strip())}; expected are {len(names)} numbers: "
                f"{', '.join(names)}."
            )
        at.append(k)
    if not rows:
        raise ValueError(f"{where}: no numbers below VARS in line {first}.")
    said = next((int(m[1]) for line in lines[:first] if (m := _POINTS.match(line))), len(rows))
    if said != len(rows):
        raise ValueError(f"{where}: NUM_POINTS says {said}, and there are {len(rows)} rows. Get the file again.")
    values = np.array(rows)
    finite(values, where, np.array(at))
    theta_i, phi_i, theta_s, phi_s = values[:, :4].T
    notes = []
    if max(np.abs(theta_i).max(), np.abs(theta_s).max()) > np.pi:
        theta_i, phi_i, theta_s, phi_s = np.deg2rad((theta_i, phi_i, theta_s, phi_s))
        notes.append("angles in degrees")
    f, more = to_rgb(values[:, 4:], names[4:], where)
    isotropic = bool(np.ptp(phi_i) < 1e-6)
    return from_rows(
        path, direction(theta_s, phi_s), direction(theta_i, phi_i), f, where=where, about="ASTM file",
        notes=notes + more, n_samples=n_samples, seed=seed, isotropic=isotropic,
    )  # fmt: skip


def _header(lines: list[str], where: str) -> tuple[int, list[str]]:
    """Return the number of lines up to VARS, and the names of the columns."""
    for k, line in enumerate(lines[:_MOST_LINES], 1):
        if found := _VARS.match(line):
            names = [c.strip() for c in found[1].split(",") if c.strip()]
            if len(names) < 5 or [n.lower() for n in names[:4]] != ["theta_i", "phi_i", "theta_s", "phi_s"]:
                raise ValueError(
                    f"{where}: VARS in line {k} is {shortened(found[1])}; it must be theta_i, phi_i, theta_s, phi_s "
                    "and at least one value."
                )
            return k, names
    raise ValueError(f"{where}: no line VARS names the columns. This is no ASTM table; a plain one is a .csv.")
