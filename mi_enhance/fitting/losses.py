"""Fitting losses as plain functions. They take Dr.Jit arrays (for gradients) and NumPy arrays (for reports) alike."""

from __future__ import annotations

import drjit as dr
import numpy as np


def log_l1(f, f_gt, cos):
    r"""Mean absolute difference of log-transformed reflectance: the paper's loss.

    The logarithm keeps a highlight of 1e4 from drowning the rest, the 1 keeps dark values from dominating, and the
    cosine gives grazing light the weight it has in a render.

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
    # NumPy does not know dr.log and Dr.Jit does not know np.log: this is the one place where the two differ.
    if isinstance(f, np.ndarray):
        cos = np.asarray(cos)
        if f.ndim == 2 and cos.ndim == 1:
            cos = cos[:, None]
        return float(np.mean(np.abs(np.log1p(f_gt * cos) - np.log1p(f * cos))))
    return dr.mean(dr.abs(dr.log(1 + f_gt * cos) - dr.log(1 + f * cos)), axis=None)
