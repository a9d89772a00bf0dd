"""The Pareto front of a set of candidates."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, TypeVar

Row = TypeVar("Row", bound=Mapping[str, Any])


def pareto(rows: Iterable[Row]) -> list[Row]:
    """Return the rows that no other beats in both ``loss`` and ``cost``, cheapest first.

    Examples
    --------
    >>> rows = [{"loss": 3, "cost": 0}, {"loss": 2, "cost": 5}, {"loss": 2.5, "cost": 6}]
    >>> [row["cost"] for row in pareto(rows)]
    [0, 5]
    """
    front: list[Row] = []
    for row in sorted(rows, key=lambda row: (row["cost"], row["loss"])):
        if not front or row["loss"] < front[-1]["loss"]:
            front.append(row)
    return front
