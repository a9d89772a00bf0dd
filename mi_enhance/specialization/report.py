"""The report of a specialization, as the file of the material keeps it."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

PREFIX = "specialize_"  # of its entries in `Material.report`


@dataclasses.dataclass(frozen=True)
class SpecializeReport:
    """What :func:`mi_enhance.specialization.specialize.specialize` has done to a material.

    Parameters
    ----------
    network : str
        Sizes of the small network, or a word for the network that was kept.
    error : float
        Mean absolute difference of log(1 + f cos) to the exact material.
    multiply_adds, multiply_adds_exact : int
        Of one evaluation, now and before.
    seconds : float
    max_error : float, optional
        The largest error that was allowed.
    log_l1, log_l1_exact : float, optional
        Error against measurements that were not learned, now and before.

    Examples
    --------
    >>> report = SpecializeReport("4-8-8-1", 5e-4, 130, 4320, 1.5)
    >>> report.entries()["specialize_network"]
    '4-8-8-1'
    >>> SpecializeReport.of(report.entries()) == report
    True
    """

    network: str
    error: float
    multiply_adds: int
    multiply_adds_exact: int
    seconds: float
    max_error: float | None = None
    log_l1: float | None = None
    log_l1_exact: float | None = None

    def entries(self) -> dict[str, Any]:
        """Return what is known as entries of `Material.report`."""
        return {PREFIX + name: value for name, value in dataclasses.asdict(self).items() if value is not None}

    @classmethod
    def of(cls, report: Mapping[str, Any]) -> SpecializeReport | None:
        """Return the record that the entries of a `Material.report` hold; None if the material is not specialized."""
        names = [field.name for field in dataclasses.fields(cls)]
        found = {name: report[PREFIX + name] for name in names if PREFIX + name in report}
        return cls(**found) if found else None
