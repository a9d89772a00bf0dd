"""Learning rates over the steps of a descent."""

from __future__ import annotations

import math


def cosine_decay(step: int, steps: int, *, low: float = 0.01, warm_up: int = 0) -> float:
    """Return the factor of a learning rate: it rises over `warm_up` steps and falls to `low` along a cosine.

    Parameters
    ----------
    step, steps : int
        Steps done, and all that there will be.
    low : float
        Factor at the end, in [0, 1].
    warm_up : int
        Steps in which the factor rises from 0: at most a quarter of all.

    Examples
    --------
    >>> [round(cosine_decay(k, 100), 3) for k in (0, 50, 100)]
    [1.0, 0.505, 0.01]
    """
    fall = low + (1 - low) * 0.5 * (1 + math.cos(math.pi * min(step / max(steps, 1), 1)))
    warm_up = min(warm_up, max(1, steps // 4))
    return fall * (min(1.0, (step + 1) / warm_up) if warm_up else 1.0)
