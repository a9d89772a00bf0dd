"""Measured reflectance as a table that a page of the viewer holds: a texture of its shader."""

from __future__ import annotations

import base64

import numpy as np

from ..data.directions import rusinkiewicz_to_directions
from ..data.functions import Function

SIZE = (96, 32, 19)  # theta_h in steps of its root, theta_d, phi_d: 350 KB
_LAST = np.deg2rad(89)  # of wi and wo: beyond, values are those of the nearest entry
_TURNS = 4  # azimuths of the half vector that an entry is the mean of
LEAST = 1e-5  # added before the logarithm, 1/sr: darker is black


def table(f: Function) -> str:
    """Return log(f + 1e-5) over theta_h, theta_d and phi_d as base64 of float16, RGB, theta_h fastest.

    The mean over azimuths is taken, and over a mirror image: what is anisotropic is not in it. phi_d ends at half a
    turn. Measurements need not be reciprocal, and the table is not either.

    Parameters
    ----------
    f : callable
        ``f(wi, wo) -> (N, 3)`` in 1/sr, see :mod:`mi_enhance.data.functions`.

    Returns
    -------
    str

    Examples
    --------
    >>> grey = table(lambda wi, wo: np.full((len(wi), 3), 0.5))
    >>> np.frombuffer(base64.b64decode(grey), "<f2")[:2].astype(float).round(2)
    array([-0.69, -0.69])
    """
    from scipy.ndimage import distance_transform_edt

    n_h, n_d, n_phi = SIZE
    phi_d, theta_d, theta_h = np.meshgrid(
        np.linspace(0, np.pi, n_phi),
        np.linspace(0, np.pi / 2, n_d),
        np.linspace(0, 1, n_h) ** 2 * np.pi / 2,
        indexing="ij",
    )
    values: np.ndarray = np.zeros((*theta_h.shape, 3))
    above = np.ones(theta_h.shape, bool)
    for turn in range(_TURNS):
        for mirror in (1, -1):
            phi_h = 2 * np.pi * turn / _TURNS
            wi, wo = rusinkiewicz_to_directions(theta_h, phi_h, theta_d, mirror * phi_d)
            above &= (wi[..., 2] > np.cos(_LAST)) & (wo[..., 2] > np.cos(_LAST))
            pairs = (w[above].reshape(-1, 3).astype(np.float32) for w in (wi, wo))
            values[above] += np.maximum(f(*pairs), 0) / (2 * _TURNS)
    nearest = distance_transform_edt(~above, return_distances=False, return_indices=True)
    filled = np.log(values + LEAST)[tuple(nearest)]
    return base64.b64encode(filled.astype("<f2").tobytes()).decode()
