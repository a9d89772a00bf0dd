"""The loss of fits. It takes Dr.Jit arrays (for gradients) and NumPy arrays (for reports) alike.

A fit minimizes the mean absolute difference of compressed reflectance: another :func:`compressed` is another loss, and
only this file says which, but for its slope in ``FactorProblem._slopes`` of specialization. Whatever minimizes
(:mod:`mi_enhance.fitting.objective`) works on compressed values.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import numpy as np


def compressed(f: Any, cos: Any) -> Any:
    r"""Return reflectance as the loss compares it: :math:`\log(1 + f \cos\theta)`.

    The logarithm keeps a highlight of 1e4 from drowning the rest, the 1 keeps dark values from dominating, and the
    cosine gives grazing light the weight it has in a render.

    Parameters
    ----------
    f : NumPy or Dr.Jit array
        BRDF in 1/sr, without the cosine, at least 0.
    cos : array or float
        Cosine to the light direction, in [0, 1], of a shape that multiplies with `f`.

    Examples
    --------
    >>> float(compressed(np.array([np.e - 1]), 1.0)[0])
    1.0
    """
    # NumPy does not know dr.log and Dr.Jit does not know np.log: this is the one place where the two differ.
    return np.log1p(f * cos) if isinstance(f, np.ndarray) else dr.log(1 + f * cos)


def log_l1(f: Any, f_gt: Any, cos: Any) -> Any:
    r"""Return the mean absolute difference of log-transformed reflectance: the paper's loss.

    .. math:: L = \frac{1}{N} \sum_k \left| \log(1 + \tilde f_k \cos\theta_k) - \log(1 + f_k \cos\theta_k) \right|

    Parameters
    ----------
    f, f_gt : NumPy array (N,) or (N, C), or any Dr.Jit array or ``mi.Color3f`` with N lanes
        Predicted and measured BRDF in 1/sr, without the cosine, at least 0. Negative measurements are the reader's
        to clamp: ``f cos <= -1`` gives NaN here.
    cos : NumPy array (N,), Dr.Jit array with N lanes, or float
        Cosine between the ground-truth normal and the light direction, in [0, 1].

    Returns
    -------
    float for NumPy, Dr.Jit array with one lane (differentiable) otherwise
        Mean over samples and channels. The paper writes a sum; the mean does not depend on the number of samples.

    References
    ----------
    Shen et al., "Neural Enhancement of Analytical Appearance Models", eq. (1).

    Examples
    --------
    >>> round(float(log_l1(np.array([0.0]), np.array([np.e - 1]), 1.0)), 6)
    1.0
    """
    if isinstance(f, np.ndarray):
        cos = np.asarray(cos)
        if f.ndim == 2 and cos.ndim == 1:
            cos = cos[:, None]
        return float(np.mean(np.abs(compressed(f_gt, cos) - compressed(f, cos))))
    return dr.mean(dr.abs(compressed(f_gt, cos) - compressed(f, cos)), axis=None)
