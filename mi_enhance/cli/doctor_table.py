"""The table that ``mi-enhance doctor`` prints."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text


def print_report(report: Mapping[str, Any]) -> None:
    """Print what `mi_enhance.cli.doctor.examine` found."""
    table = Table(box=None, show_header=False)
    table.add_column(style="bold")
    table.add_column(overflow="fold")
    for name, version in report["versions"].items():
        table.add_row(name, version)
    llvm = report["llvm"]
    table.add_row("LLVM", f"{llvm['version'] or 'none'}  {llvm['path']}  ({llvm['origin']})")
    for name, result in report["variants"].items():
        table.add_row(name, _coloured(result))
    table.add_row(f"enhanced ({report['enhanced']['variant']})", _coloured(report["enhanced"]["result"]))
    console = Console()
    console.print(table)
    if llvm["problem"]:
        console.print(llvm["problem"], style="red", markup=False)
    console.print("Rendering works." if report["rendering_works"] else "Rendering does not work.", style="bold")


def _coloured(result: str) -> Text:
    return Text(result, style="green" if result == "works" else "yellow")
