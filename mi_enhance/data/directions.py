"""Rusinkiewicz angles and the paper's sampling of direction pairs (section 6), in float64 numpy.

Half vector h = normalize(wi + wo) with polar angles (theta_h, phi_h); difference vector d = the *light* wo, rotated by
-phi_h about z and then by -theta_h about y, with polar angles (theta_d, phi_d). The viewer is then (-d_x, -d_y, d_z).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

MIN_COS = 0.01  # the horizon, 89.4 degrees: beyond, measured data are extrapolated and f = eval / cos is mostly noise
_BLOCK = 1 << 20  # pairs drawn at a time: 30 MB of random numbers
_PEAK_ALPHA = (0.003, 0.3)  # roughness of highlights nobody knows, log-uniform: near-mirrors to gloss


def rusinkiewicz_to_directions(
    theta_h: ArrayLike, phi_h: ArrayLike, theta_d: ArrayLike, phi_d: ArrayLike
) -> tuple[np.ndarray, np.ndarray]:
    """Return the directions of viewer and light from half and difference angles.

    Parameters
    ----------
    theta_h, phi_h, theta_d, phi_d : array (N,) or float
        Radians; theta in [0, pi/2], any phi.

    Returns
    -------
    wi, wo : array (N, 3), float64
        Unit vectors towards the viewer and the light; one of them may be below the horizon.

    References
    ----------
    Rusinkiewicz, "A new change of variables for efficient BRDF representation", 1998.

    Examples
    --------
    >>> wi, wo = rusinkiewicz_to_directions(0.0, 0.0, np.pi / 6, 0.0)
    >>> wi.round(3)[[0, 2]].tolist(), wo.round(3).tolist()
    ([-0.5, 0.866], [0.5, 0.0, 0.866])
    """
    ch, sh, cp, sp = np.cos(theta_h), np.sin(theta_h), np.cos(phi_h), np.sin(phi_h)
    x, y, z = np.sin(theta_d) * np.cos(phi_d), np.sin(theta_d) * np.sin(phi_d), np.cos(theta_d)

    def to_surface(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        u, w = ch * x + sh * z, -sh * x + ch * z  # by theta_h about y, then by phi_h about z
        return np.stack(np.broadcast_arrays(cp * u - sp * y, sp * u + cp * y, w), axis=-1)

    return to_surface(-x, -y), to_surface(x, y)


def direction(theta: ArrayLike, phi: ArrayLike) -> np.ndarray:
    """Return unit vectors (..., 3) by their angle to the normal and their azimuth, radians.

    Examples
    --------
    >>> direction(np.pi / 2, 0.0).round(6)
    array([1., 0., 0.])
    """
    return np.stack((np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)), -1)


def half_difference(wi: ArrayLike, wo: ArrayLike) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the polar angles of the half vector and the difference vector itself.

    Swapping wi and wo changes nothing but the sign of d_x and d_y, to the last bit.

    Parameters
    ----------
    wi, wo : array (N, 3) or (3,)
        Unit vectors towards the viewer and the light, not opposite to each other.

    Returns
    -------
    theta_h, phi_h : array (N,), float64
        Radians; phi_h is 0 where h is the normal.
    d : array (N, 3), float64
        Unit difference vector, d_z >= 0.
    """
    wi, wo = np.asarray(wi, np.float64), np.asarray(wo, np.float64)
    s, e = wi + wo, (wo - wi) / 2  # e is the part of the light perpendicular to h: no cancellation where d is near h
    r, length = np.hypot(s[..., 0], s[..., 1]), np.sqrt(np.sum(s * s, axis=-1))
    phi_h = np.arctan2(s[..., 1], s[..., 0])
    theta_h = np.arctan2(r, s[..., 2])
    cp, sp, ch, sh = np.cos(phi_h), np.sin(phi_h), np.cos(theta_h), np.sin(theta_h)
    u, y = cp * e[..., 0] + sp * e[..., 1], cp * e[..., 1] - sp * e[..., 0]
    return theta_h, phi_h, np.stack((ch * u - sh * e[..., 2], y, length / 2), axis=-1)


def directions_to_rusinkiewicz(wi: ArrayLike, wo: ArrayLike) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return the half and difference angles of a pair of directions; the inverse of `rusinkiewicz_to_directions`.

    Parameters
    ----------
    wi, wo : array (N, 3) or (3,)
        Unit vectors towards the viewer and the light, not opposite to each other.

    Returns
    -------
    theta_h, phi_h, theta_d, phi_d : array (N,), float64
        Radians, both phi in [0, 2 pi). Where theta_h (theta_d) is 0, phi_h (phi_d) has no meaning.

    Examples
    --------
    >>> wi, wo = rusinkiewicz_to_directions(0.1, 0.2, 0.3, 0.4)
    >>> np.round(directions_to_rusinkiewicz(wi, wo), 12).tolist()
    [0.1, 0.2, 0.3, 0.4]
    """
    theta_h, phi_h, d = half_difference(wi, wo)
    theta_d = np.arctan2(np.hypot(d[..., 0], d[..., 1]), d[..., 2])
    return theta_h, _positive(phi_h), theta_d, _positive(np.arctan2(d[..., 1], d[..., 0]))


def _positive(phi: np.ndarray) -> np.ndarray:
    """Return the angle in [0, 2 pi); the second step is for -1e-17 + 2 pi, which rounds to 2 pi itself."""
    phi = np.mod(phi, 2 * np.pi)
    return np.where(phi >= 2 * np.pi, 0.0, phi)


def sample_pairs(
    n: int,
    *,
    seed: int | np.random.Generator = 0,
    min_cos: float = MIN_COS,
    accept: Callable[[np.ndarray, np.ndarray], np.ndarray] | None = None,
    half: Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]] | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Draw pairs of directions, uniform in the four Rusinkiewicz angles, both above the horizon.

    Parameters
    ----------
    n : int
        How many pairs.
    seed : int or numpy.random.Generator
    min_cos : float
        Smallest cosine to the normal of either direction, in (0, 1).
    accept : callable, optional
        ``accept(wi, wo) -> bool array``: further pairs to reject, e.g. where a table holds nothing.
    half : callable, optional
        ``half(u, v) -> (theta_h, phi_h)`` of numbers uniform in [0, 1): another density of the half vector.

    Returns
    -------
    wi, wo : array (n, 3), float32
        Towards the viewer and the light.

    Raises
    ------
    ValueError
        If almost every pair is rejected.

    References
    ----------
    The paper, section 6: "We draw 1e5 random directional pairs according to [58]".

    Examples
    --------
    >>> wi, wo = sample_pairs(1000, seed=1)
    >>> bool(wi[:, 2].min() >= np.float32(0.01)), wo.shape
    (True, (1000, 3))
    """
    rng = np.random.default_rng(seed)
    pairs, found, drawn = [], 0, 0
    while found < n:
        if drawn > 1000 * (n + 1000):  # 55 % pass the horizon: this is a table with next to nothing in it
            raise ValueError(
                f"sample_pairs(): {drawn} pairs were drawn, {found} of the wanted {n} accepted. The source "
                "holds (almost) no valid data above the horizon; look at the file."
            )
        m = min(_BLOCK, max(2 * (n - found) + 64, drawn))
        theta_h, theta_d, phi_h, phi_d = rng.random((4, m)) * (np.pi / 2 * np.array([[1], [1], [4], [4]]))
        if half is not None:
            theta_h, phi_h = half(theta_h / (np.pi / 2), phi_h / (2 * np.pi))
        wi, wo = (w.astype(np.float32) for w in rusinkiewicz_to_directions(theta_h, phi_h, theta_d, phi_d))
        keep = np.minimum(wi[:, 2], wo[:, 2]) >= np.float32(min_cos)
        wi, wo = wi[keep], wo[keep]
        if accept is not None:
            inside = accept(wi, wo)
            wi, wo = wi[inside], wo[inside]
        pairs.append((wi, wo))
        found, drawn = found + len(wi), drawn + m
    wi, wo = (np.concatenate(w)[:n] for w in zip(*pairs, strict=True))
    return wi, wo


def with_peaks(
    wi: np.ndarray,
    wo: np.ndarray,
    share: float,
    rng: np.random.Generator,
    *,
    alpha: tuple[float, float] | None = None,
    axes: ArrayLike = ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
) -> tuple[np.ndarray, np.ndarray]:
    """Exchange a share of the pairs, at random places, for pairs whose half vector lies in a highlight.

    Of pairs uniform in the Rusinkiewicz angles one in 150 lies within a highlight of roughness 0.01. Here the half
    vector has the density of GGX normals, D cos_theta_h; the difference angles stay uniform.

    Parameters
    ----------
    wi, wo : array (n, 3), float32
        As `sample_pairs` returns them.
    share : float
        Part of the pairs to exchange, 0 to 1.
    rng : numpy.random.Generator
        It is not moved on: what is drawn from it afterwards does not depend on `share`.
    alpha : (float, float), optional
        Roughness along both axes; without it each pair has its own, log-uniform from 0.003 to 0.3.
    axes : array (3, 3)
        Tangent, bitangent and normal of the highlight, as rows.

    Returns
    -------
    wi, wo : array (n, 3), float32

    References
    ----------
    Walter et al. 2007, eqs. 35 and 36.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> wi, wo = with_peaks(*sample_pairs(1000, seed=rng), 0.5, rng, alpha=(0.01, 0.01))
    >>> bool(0.4 < np.mean(half_difference(wi, wo)[0] < 0.05) < 0.6)
    True
    """
    if share == 0:
        return wi, wo
    (draws,) = rng.spawn(1)
    places = np.flatnonzero(draws.random(len(wi)) < share)
    rotation = np.asarray(axes, np.float64)

    def in_peak(u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        if alpha is None:
            low, high = np.log(_PEAK_ALPHA)
            alpha_x = alpha_y = np.exp(draws.uniform(low, high, len(u)))
        else:
            alpha_x, alpha_y = np.asarray(alpha)
        slope = np.sqrt(u / (1 - u))
        x, y = slope * alpha_x * np.cos(2 * np.pi * v), slope * alpha_y * np.sin(2 * np.pi * v)
        return np.arctan(np.hypot(x, y)), np.arctan2(y, x)

    def above(wi: np.ndarray, wo: np.ndarray) -> np.ndarray:
        return np.minimum((wi @ rotation)[:, 2], (wo @ rotation)[:, 2]) >= MIN_COS

    peaks = sample_pairs(len(places), seed=draws, accept=above, half=in_peak) if len(places) else (wi[:0], wo[:0])
    wi, wo = wi.copy(), wo.copy()
    for w, peak in zip((wi, wo), peaks, strict=True):
        w[places] = peak @ rotation
    return wi, wo


def cosine_hemisphere(n: int) -> np.ndarray:
    """Return `n` evenly spread directions, density cos / pi: a mean over them times pi is an albedo.

    Examples
    --------
    >>> round(float(cosine_hemisphere(1000)[:, 2].mean()), 3)
    0.667
    """
    k = np.arange(n) + 0.5
    r, phi = np.sqrt(k / n), k * np.pi * (3 - np.sqrt(5))  # Vogel's spiral
    return np.stack((r * np.cos(phi), r * np.sin(phi), np.sqrt(1 - k / n)), 1)
