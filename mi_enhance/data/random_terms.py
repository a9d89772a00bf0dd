"""Materials nobody measured, to train on: published forms of every term at random, with smooth random factors."""

from __future__ import annotations

import numpy as np

from .directions import sample_pairs, with_peaks
from .measurements import Measurements
from .reference_brdfs import frame


def assorted(seed: int, n_samples: int = 100_000, peaks: float = 0.0) -> Measurements:
    """Draw a material from the many shapes that terms of published models take, and measure it.

    One to three lobes over a diffuse term. Each has one of three distributions (generalized Trowbridge-Reitz, hence GGX
    and its longer and shorter tails; hyper-Cauchy in the slope; exponential in the slope), a Fresnel colour that goes
    to white, stays, or shifts through a film's hues, one of three geometric factors, and a free power of the cosines.
    The diffuse term is Lambert's, brightens at the edges or towards the light. What a network learns here is less what
    materials are than what directions a factor may depend on, and how.

    Parameters
    ----------
    seed : int
        Decides material and directions.
    n_samples : int
    peaks : float
        Share of the samples in highlights, see :func:`mi_enhance.data.directions.with_peaks`.

    Returns
    -------
    Measurements
        Reciprocal, without noise; the value is limited to 1e4.

    References
    ----------
    Burley 2012, *Physically Based Shading at Disney*: GTR, retro-reflective diffuse, sheen. Bagher et al. 2012,
    *Accurate Fitting of Measured Reflectances*: tails between Beckmann and GGX. Neither Ward nor Beckmann here: they
    test how networks generalize.

    Examples
    --------
    >>> assorted(1, n_samples=10).name
    'assorted_1'
    """
    rng = np.random.default_rng(seed)
    wi, wo = with_peaks(*sample_pairs(n_samples, seed=rng), peaks, rng)
    t, b, n = frame(np.array([0.0, 0.0, 1.0]), rng.uniform(0, np.pi))
    i, o = (np.asarray(w, np.float64) @ np.stack((t, b, n), 1) for w in (wi, wo))
    h, cos_d = half_vectors(i, o)
    product = i[:, 2] * o[:, 2]
    q = 1 - np.clip(cos_d, 0, 1)

    base = rng.uniform(0, 1, 3) ** rng.uniform(0.5, 2) * rng.uniform(0, 1)
    factor = np.ones(n_samples)
    if rng.random() < 0.4:  # edges, brighter or darker
        factor *= product ** rng.uniform(-0.4, 0.5)
    if rng.random() < 0.4:  # towards the light
        factor += rng.uniform(0, 1.5) * np.exp(-((1 - cos_d**2) / rng.uniform(0.05, 0.6)))
    if rng.random() < 0.3:  # sheen
        factor += rng.uniform(0, 3) * q ** rng.uniform(2, 6)
    f = base / np.pi * factor[:, None]

    anisotropic = rng.random() < 0.4
    for _ in range(rng.integers(1, 4)):
        alpha = np.exp(rng.uniform(*np.log((0.01, 0.7))))
        ratio = np.exp(rng.uniform(0, np.log(3))) if anisotropic else 1.0
        lobe = _distribution(rng, h, min(alpha * ratio, 1.0), alpha / ratio)
        lobe *= _geometry(rng, i, o, h, cos_d, alpha)
        lobe *= 0.25 * product ** -rng.uniform(0.5, 1.0)
        scale = np.exp(rng.uniform(*np.log((0.02, 1.5))))
        f = f + scale * _colour(rng, q) * lobe[:, None]
    return Measurements(wi, wo, np.minimum(f, 1e4), f"assorted_{seed}", "synthetic")


def half_vectors(i: np.ndarray, o: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the half vectors (N, 3) and the cosine to both directions (N,), the same after a swap to the last bit."""
    h = i + o
    cos_d = np.linalg.norm(h, axis=1) / 2
    h /= 2 * cos_d[:, None]
    return h, cos_d


def _distribution(rng: np.random.Generator, h: np.ndarray, alpha_x: float, alpha_y: float) -> np.ndarray:
    """Return the density of normals of one of three families, normalized at its peak like GGX."""
    x2 = (h[:, 0] / alpha_x) ** 2 + (h[:, 1] / alpha_y) ** 2
    peak = 1 / (np.pi * alpha_x * alpha_y)
    kind = rng.integers(3)
    if kind == 0:
        return peak / (x2 + h[:, 2] ** 2) ** rng.uniform(1.2, 4)
    slope2 = x2 / h[:, 2] ** 2
    if kind == 1:
        return peak / (1 + slope2) ** rng.uniform(0.8, 3) / h[:, 2] ** rng.uniform(0, 1)
    return peak * np.exp(-(slope2 ** rng.uniform(0.3, 0.8))) / h[:, 2] ** rng.uniform(0, 1)


def _geometry(
    rng: np.random.Generator, i: np.ndarray, o: np.ndarray, h: np.ndarray, cos_d: np.ndarray, alpha: float
) -> np.ndarray:
    kind = rng.integers(3)
    if kind == 0:
        return np.ones(len(i))
    if kind == 1:  # V-cavities
        return np.minimum(1, 2 * h[:, 2] * np.minimum(i[:, 2], o[:, 2]) / cos_d)
    k = alpha * rng.uniform(0.5, 1.5)  # Smith
    return np.prod([2 * w[:, 2] / (w[:, 2] + np.sqrt(k * k + (1 - k * k) * w[:, 2] ** 2)) for w in (i, o)], axis=0)


def _colour(rng: np.random.Generator, q: np.ndarray) -> np.ndarray:
    """Return the Fresnel colour (N, 3) over q = 1 - cos_theta_d."""
    first = rng.uniform(0, 1, 3) if rng.random() < 0.6 else np.full(3, rng.uniform(0.02, 1))
    weight = q[:, None] ** rng.uniform(3, 7)
    kind = rng.integers(4)
    if kind == 0:
        return np.broadcast_to(first, (len(q), 3))
    if kind == 3:  # hues of a film
        phase = rng.uniform(0, 2 * np.pi, 3) + rng.uniform(1, 8) * np.sqrt(1 - 0.4 * q * (2 - q))[:, None]
        first = first * (1 - rng.uniform(0, 0.8) * np.cos(phase))
    last = np.full(3, rng.uniform(0.3, 1)) if kind == 2 else np.ones(3)
    return first + (last - first) * weight
