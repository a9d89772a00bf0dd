"""Error against run time as a plot and as one HTML page that needs nothing else but the pictures beside it."""

from __future__ import annotations

import base64
import html
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from string import Template
from typing import TYPE_CHECKING, Any

from ..output.figure import sheet
from ..output.pareto import pareto
from ..output.table import Columns, cells
from ..system.files import write_text

if TYPE_CHECKING:
    from .benchmark import BenchReport

_ROUNDING = 1e-4  # below this an error is float32: the measured file held against itself
_STYLE = """body{font:15px/1.45 system-ui,sans-serif;margin:2em auto;max-width:100em;padding:0 1em;color:#222}
table{border-collapse:collapse;font-size:13px}td,th{padding:.25em .6em;border-bottom:1px solid #ddd;text-align:right}
td:first-child,th:first-child{text-align:left}tr:hover{background:#f4f4f4}img{max-width:100%}"""
_PAGE = Template("""<!doctype html><html lang="en"><meta charset="utf-8"><title>Error against run time</title>
<style>$style</style><h1>Error against run time</h1><p>$about</p>
<img alt="Pareto plot" src="data:image/png;base64,$plot">
$table<h2>How the time of a frame grows</h2>$growth$pictures</html>
""")
_PICTURE = Template('<h2>$name</h2><img alt="renders and error maps of $name" src="$name/comparison.png">')


def draw_pareto(rows: Sequence[Mapping[str, Any]], path: str | Path, *, title: str) -> None:
    """Draw error over the time of an evaluation and of a frame, multiply-adds, and bytes; lines are fronts.

    Parameters
    ----------
    rows : list of dict
        Of :func:`mi_enhance.benchmark.benchmark.bench`: ``label``, ``log_l1``, ``eval_ns``, ``ball_ratio``,
        ``multiply_adds``, ``n_bytes``. What one has not, or 0, is left out of that plot.
    path : str or Path
        PNG.
    title : str

    Examples
    --------
    >>> rows = [{"label": "GGX", "log_l1": 0.03, "eval_ns": 7.0, "ball_ratio": 1.0, "multiply_adds": 0, "n_bytes": 48}]
    >>> draw_pareto(rows, "pareto.png", title="test")  # doctest: +SKIP
    """
    with sheet(path, (15, 11), 90) as figure:
        axes = figure.subplots(2, 2).ravel()
        _front(axes[0], rows, lambda row: row.get("eval_ns"), "ns per evaluation in a kernel of 2^20 lanes")
        _front(axes[1], rows, _frame, "time of a frame of the shader ball, GGX in Python = 1")
        _front(axes[2], rows, lambda row: row.get("multiply_adds"), "multiply-adds of networks")
        _front(axes[3], rows, lambda row: row.get("n_bytes"), "bytes of a material, without what all share")
        handles, labels = axes[1].get_legend_handles_labels()  # of all: the numbers are the same
        order = sorted(range(len(labels)), key=lambda i: int(labels[i].split()[0]))
        texts = [labels[i] for i in order]
        figure.legend([handles[i] for i in order], texts, fontsize=8, loc="outside right upper")
        figure.suptitle(title, fontsize=10)


def _frame(row: Mapping[str, Any]) -> float | None:
    return 1 / row["ball_ratio"] if row.get("ball_ratio") else None


def _front(axes: Any, rows: Sequence[Mapping[str, Any]], cost: Callable, label: str) -> None:
    points = []
    for k, row in enumerate(rows, 1):
        x, y = cost(row), row["log_l1"]
        if not x:
            continue
        if y < _ROUNDING:
            axes.axvline(x, color="0.5", ls="--", lw=1, label=f"0  {row['label']} (the truth itself)")
            continue
        points.append({"cost": x, "loss": y})
        ours = "enhanced" in row["label"] or "specialized" in row["label"]
        axes.plot(x, y, "o", color="tab:orange" if ours else "tab:blue", ms=6, label=f"{k}  {row['label']}")
        axes.annotate(str(k), (x, y), xytext=(5, 4), textcoords="offset points", fontsize=8)
    if points:
        x, y = zip(*map(dict.values, pareto(points)), strict=True)
        axes.step(x, y, where="post", color="tab:orange", lw=1.5, zorder=1)
    axes.set(xlabel=label, ylabel="log-L1 on unseen samples", xscale="log", yscale="log")
    axes.tick_params(axis="x", which="both", labelsize=7, labelrotation=30)  # labels of a short axis stand close
    axes.grid(alpha=0.3, which="both")


def write_page(report: BenchReport, path: str | Path, columns: Columns, growth_columns: Columns) -> None:
    """Write table, growth, plot and the pictures of each material as one HTML page.

    Parameters
    ----------
    report : BenchReport
        Of :func:`mi_enhance.benchmark.benchmark.bench`, whose folder is that of `path`.
    path : str or Path
    columns, growth_columns : dict
        As for :func:`mi_enhance.output.table.markdown`.
    """
    path = Path(path)
    text = _PAGE.substitute(
        style=_STYLE,
        about=html.escape(", ".join(f"{key} {value}" for key, value in report.machine.items())),
        plot=base64.b64encode((path.parent / "pareto.png").read_bytes()).decode(),
        table=_table(report.rows, columns),
        growth=_table(report.growth, growth_columns),
        pictures="".join(_PICTURE.substitute(name=html.escape(name)) for name in report.materials),
    )
    write_text(path, text)


def _table(rows: Sequence[Mapping[str, Any]], columns: Columns) -> str:
    headers, lines = cells(rows, columns)
    row = lambda tag, values: "<tr>" + "".join(f"<{tag}>{html.escape(v)}</{tag}>" for v in values) + "</tr>"  # noqa: E731
    return "<table>" + row("th", headers) + "".join(row("td", line) for line in lines) + "</table>"
