"""Evenly spread numbers for quadratures."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi


def even_numbers(n: int, k=None) -> list[mi.Float]:
    """Three coordinates in [0, 1) that fill the cube evenly: as good as many more random ones.

    Parameters
    ----------
    n : int
        Points.
    k : mi.UInt32, optional
        Which of them; all in order if left out.

    References
    ----------
    Roberts 2018, *The Unreasonable Effectiveness of Quasirandom Sequences*, R3.

    Examples
    --------
    >>> [len(v) for v in even_numbers(8)]
    [8, 8, 8]
    """
    k = dr.arange(mi.UInt32, n) if k is None else k
    # multiples of 2^-32 wrap around in 32 bits; as float32, k times a step would lose digits
    steps = (3518319155, 2882110345, 2360945575)  # 2^32 / g, / g^2, / g^3 with g^4 = g + 1
    return [mi.Float((k * mi.UInt32(step)) >> 8) * 2**-24 for step in steps]
