"""Tables of results: one list of rows (dictionaries), printed, or written as CSV, JSON and Markdown."""

from __future__ import annotations

import csv
import json
from pathlib import Path

from ..system.files import replacing

# key of a row: (header, format); a column is shown where some row has the key
COLUMNS = {
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


def print_table(rows, columns=None, *, title=None):
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
    >>> print_table([{"label": "GGX", "ssim": 0.9812}])  # doctest: +SKIP
     model   SSIM
     GGX    0.9812
    """
    from rich import box
    from rich.console import Console
    from rich.table import Table

    headers, lines = cells(rows, columns)
    table = Table(title=title, title_justify="left", box=box.SIMPLE)
    for header, is_number in zip(headers, _numeric(rows, columns), strict=True):
        table.add_column(header, justify="right" if is_number else "left", no_wrap=True)
    for line in lines:
        table.add_row(*line)
    # Rich shortens cells to fit 80 columns, also into a pipe; a number cut off is worse than a wrapped line.
    console = Console()
    unlimited = console.options.update(max_width=10_000)
    console.width = max(console.width, console.measure(table, options=unlimited).maximum)
    console.print(table)


def markdown(rows, columns=None):
    """Return rows as a Markdown table.

    Examples
    --------
    >>> print(markdown([{"label": "GGX", "ssim": 0.98123}, {"label": "enhanced", "ssim": None}]))
    | model | SSIM |
    |---|---:|
    | GGX | 0.9812 |
    | enhanced | – |
    """
    headers, lines = cells(rows, columns)
    rule = ["---:" if is_number else "---" for is_number in _numeric(rows, columns)]
    table = [headers, rule, *lines]
    return "\n".join(f"|{'|'.join(line)}|" if line is rule else f"| {' | '.join(line)} |" for line in table)


def write_table(rows, stem, columns=None):
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
        with replacing(paths[suffix]) as temporary:
            Path(temporary).write_text(text + "\n", encoding="utf8")
    return paths


def cells(rows, columns):
    """Return the headers, and the cells of each row as text; see `print_table`."""
    columns = _present(rows, columns)
    lines = [
        ["–" if row.get(key) is None else format(row[key], form) for key, (_, form) in columns.items()] for row in rows
    ]
    return [header for header, _ in columns.values()], lines


def _numeric(rows, columns):
    return [bool(form) for _, form in _present(rows, columns).values()]


def _present(rows, columns):
    return columns or {key: value for key, value in COLUMNS.items() if any(key in row for row in rows)}
