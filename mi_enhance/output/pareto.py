"""The Pareto front of a set of candidates."""

from __future__ import annotations


def pareto(stages: list[dict]) -> list[dict]:
    """Candidates that no other beats in both loss and cost, cheapest first.

    Examples
    --------
    >>> rows = [{"loss": 3, "cost": 0}, {"loss": 2, "cost": 5}, {"loss": 2.5, "cost": 6}]
    >>> [row["cost"] for row in pareto([{"candidates": rows}])]
    [0, 5]
    """
    rows = sorted((row for s in stages for row in s["candidates"]), key=lambda row: (row["cost"], row["loss"]))
    front = []
    for row in rows:
        if not front or row["loss"] < front[-1]["loss"]:
            front.append(row)
    return front
