"""Progress of long functions: one record, one kind of callback. Nothing below ``cli/`` prints."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping


@dataclasses.dataclass(frozen=True)
class Progress:
    """The state of a long function.

    Parameters
    ----------
    stage : str
        What is being done, for example ``"enhanced, 1024 samples"``.
    step : int
        How many steps of the stage are done.
    total : int, optional
        How many there will be, where that is known.
    values : dict of str to float
        Current figures, for example ``{"loss": 0.01}``.

    Examples
    --------
    >>> Progress("train", 10, 100, {"loss": 0.5}).values["loss"]
    0.5
    """

    stage: str
    step: int
    total: int | None = None
    values: Mapping[str, float] = dataclasses.field(default_factory=dict)


Callback = Callable[[Progress], None]


def silent(progress: Progress) -> None:
    """A callback that ignores what it is told."""
