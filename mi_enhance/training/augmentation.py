"""More training materials than were measured."""

from __future__ import annotations

import numpy as np

from ..data.directions import half_difference


def warp(wi, wo, seed):
    """A random smooth positive factor (N, 3): what turns a material into one nobody measured.

    exp of a random cosine series in theta_h and theta_d, with a part that follows phi_d, a random power of the cosines,
    and a gain per channel; for a third of the seeds the channels also vary apart. For half of the seeds the factor also
    tells wi from wo, as measured files do: a series that changes sign with their order.

    Parameters
    ----------
    wi, wo : array (N, 3)
        Unit vectors above the horizon.
    seed : int

    Examples
    --------
    >>> w = np.array([[0.0, 0.6, 0.8]])
    >>> warp(w, w, 3).shape
    (1, 3)
    """
    rng = np.random.default_rng(seed)
    theta_h, _, d = half_difference(wi, wo)
    u, v = theta_h * 2, np.arccos(np.clip(d[:, 2], -1, 1)) * 2  # 0 to pi
    # cos 2 phi_d where there is one, fading out where h is the normal or both directions are h
    along = (d[:, 0] ** 2 - d[:, 1] ** 2) * np.sin(theta_h) ** 2

    def series():
        amplitude = rng.uniform(0, 0.7)
        g = 0
        for i in range(4):
            for j in range(4):
                a, b = rng.normal(0, amplitude / (1 + i * i + j * j), 2)
                g = g + np.cos(i * u) * np.cos(j * v) * (a + 2 * b * along)
        return g

    g = series() + rng.uniform(-0.4, 0.3) * np.log(np.asarray(wi)[:, 2] * np.asarray(wo)[:, 2])
    if rng.random() < 0.5:
        c_i, c_o = np.asarray(wi, np.float64)[:, 2], np.asarray(wo, np.float64)[:, 2]
        a = rng.normal(0, rng.uniform(0, 0.3), 4)
        g = g + a[0] * (c_i - c_o) + a[1] * (c_i**2 - c_o**2) + a[2] / 3 * np.log((c_i + 0.01) / (c_o + 0.01))
        g = g + a[3] * (np.cos(3 * np.arccos(np.minimum(c_i, 1))) - np.cos(3 * np.arccos(np.minimum(c_o, 1))))
    channels = np.tile(g[:, None], 3)
    if rng.random() < 1 / 3:
        channels += 0.4 * np.stack([series() for _ in range(3)], 1)
    return np.exp(channels + rng.normal(0, 0.5) + rng.normal(0, 0.3, 3))
