"""Tables of results: one list of rows (dictionaries), printed, or written as CSV, JSON and Markdown."""

from __future__ import annotations

import csv
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ..system.files import replacing, write_text

Rows = Sequence[Mapping[str, Any]]
Columns = Mapping[str, tuple[str, str]]

# key of a row: (header, format); a column is shown where some row has the key
COLUMNS: Columns = {
    "material": ("material", ""),
    "label": ("model", ""),
    "log_l1": ("log-L1", ".4f"),
    "ssim": ("SSIM", ".4f"),
    "delta_E_ITP_1000": ("ΔE ITP x1000", ".2f"),
    "fit_seconds": ("fit s", ".1f"),
    "render_seconds_cold": ("first frame s", ".2f"),
    "mpaths_per_s": ("Mpaths/s", ".2f"),
    "bytes": ("bytes", ",d"),
}


def print_table(rows: Rows, columns: Columns | None = None, *, title: str | None = None) -> None:
    """Print rows on the terminal.

    Parameters
    ----------
    rows : list of dict
        A missing value or None is shown as a dash.
    columns : dict, optional
        Key -> (header, format); those of `COLUMNS` that occur in the rows if left out.
    title : str, optional

    Examples
    --------
    >>> print_table([{"label": "GGX", "ssim": 0.9812}])
    model      SSIM
    -------  ------
    GGX      0.9812
    """
    print("\n".join([*([title] if title else []), _as_text(rows, columns, "simple")]))


def markdown(rows: Rows, columns: Columns | None = None) -> str:
    """Return rows as a Markdown table.

    Examples
    --------
    >>> print(markdown([{"label": "GGX", "ssim": 0.98123}, {"label": "enhanced", "ssim": None}]))
    | model    |   SSIM |
    |:---------|-------:|
    | GGX      | 0.9812 |
    | enhanced |      – |
    """
    return _as_text(rows, columns, "pipe")


def _as_text(rows: Rows, columns: Columns | None, style: str) -> str:
    from tabulate import tabulate

    headers, lines = cells(rows, columns)
    sides = ["right" if form else "left" for _, form in _present(rows, columns).values()]  # numbers have a format
    # a format for numbers would undo ours
    return tabulate(lines, headers, tablefmt=style, colalign=sides if lines else None, disable_numparse=True)


def write_table(rows: Rows, stem: str | Path, columns: Columns | None = None) -> dict[str, Path]:
    """Write ``<stem>.csv`` and ``<stem>.json`` (every key, every digit) and ``<stem>.md`` (as printed).

    Parameters
    ----------
    rows : list of dict
    stem : str or Path
        Path without suffix; its folder exists.
    columns : dict, optional
        For the Markdown table, as for `print_table`.

    Returns
    -------
    dict
        Suffix -> Path.

    Examples
    --------
    >>> write_table([{"label": "GGX", "ssim": 0.9812}], "out/table")  # doctest: +SKIP
    """
    paths = {suffix: Path(f"{stem}.{suffix}") for suffix in ("csv", "json", "md")}
    with replacing(paths["csv"]) as temporary, open(temporary, "w", newline="", encoding="utf8") as file:
        writer = csv.DictWriter(file, list(dict.fromkeys(key for row in rows for key in row)))
        writer.writeheader()
        writer.writerows(rows)
    for suffix, text in (("json", json.dumps(rows, indent=1)), ("md", markdown(rows, columns))):
        write_text(paths[suffix], text + "\n")
    return paths


def cells(rows: Rows, columns: Columns | None) -> tuple[list[str], list[list[str]]]:
    """Return the headers, and the cells of each row as text; see `print_table`."""
    columns = _present(rows, columns)
    lines = [
        ["–" if row.get(key) is None else format(row[key], form) for key, (_, form) in columns.items()] for row in rows
    ]
    return [header for header, _ in columns.values()], lines


def _present(rows: Rows, columns: Columns | None) -> Columns:
    return columns or {key: value for key, value in COLUMNS.items() if any(key in row for row in rows)}
