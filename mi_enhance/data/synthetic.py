"""Virtual measurements of a random anisotropic GGX, as section 6 of the paper makes them from OpenSVBRDF.

The formulas are written here a second time, in float64 numpy and without the package's own terms, so that fits and
terms can be tested against them.
"""

from __future__ import annotations

import numpy as np

from . import Measurements, clamp_negative
from .sampling import half_difference, sample_pairs

_F0 = 0.04
_RHO_S_MAX = 10.0
_ALPHA_RANGE = (0.006, 0.503)  # OpenSVBRDF's published range, log-uniform
_MIN_COS = 0.01  # to the tilted normal, as sampling.py has it for the untilted one


def ggx_anisotropic(seed, n_samples=100_000, noise=0.1, max_tilt=0.0):
    """Draw a material and measure it.

    Parameters
    ----------
    seed : int
        Decides material, directions and noise.
    n_samples : int
    noise : float
        Standard deviation of the multiplicative Gaussian noise of mean 1 (paper: 0.1).
    max_tilt : float
        The shading normal leans by an angle uniform in [0, max_tilt] radians, in a random direction.

    Returns
    -------
    measurements : Measurements
    truth : dict
        ``n`` (3,) shading normal, ``t_theta`` in [0, pi], ``rho_d`` (3,) in [0, 1], ``rho_s`` (3,) in [0, 10],
        ``alpha_x`` >= ``alpha_y`` in [0.006, 0.503], ``F0`` = 0.04: the arguments of `ggx`.

    References
    ----------
    Ma et al., "OpenSVBRDF", 2023, for the ranges; the paper, section 6, for the noise.

    Examples
    --------
    >>> m, truth = ggx_anisotropic(7, n_samples=100)
    >>> len(m.f), truth["alpha_x"] >= truth["alpha_y"]
    (100, True)
    """
    rng = np.random.default_rng(seed)
    alpha_y, alpha_x = np.sort(np.exp(rng.uniform(*np.log(_ALPHA_RANGE), 2)))
    tilt, azimuth = rng.uniform(0, max_tilt), rng.uniform(0, 2 * np.pi)
    truth = {
        "n": np.array([np.sin(tilt) * np.cos(azimuth), np.sin(tilt) * np.sin(azimuth), np.cos(tilt)]),
        "t_theta": rng.uniform(0, np.pi),
        "rho_d": rng.uniform(0, 1, 3),
        "rho_s": rng.uniform(0, _RHO_S_MAX, 3),
        "alpha_x": float(alpha_x),
        "alpha_y": float(alpha_y),
        "F0": _F0,
    }

    def above(wi, wo):
        return np.minimum(wi @ truth["n"], wo @ truth["n"]) >= _MIN_COS

    wi, wo = sample_pairs(n_samples, seed=rng, accept=above)
    f = ggx(wi, wo, **truth) * rng.normal(1, noise, (n_samples, 3))
    f, clamped_fraction = clamp_negative(f)
    return Measurements(wi, wo, f, f"ggx_anisotropic_{seed}", f"synthetic, noise {noise}", clamped_fraction), truth


def two_lobes(seed, n_samples=100_000):
    """Draw a material with a sharp and a wide lobe, like a coat over paint or a flake in lacquer, and measure it.

    One GGX cannot be such a material: networks that saw only single lobes do not generalise to real ones. Half of the
    materials are isotropic, half of the Fresnel reflectances are those of dielectrics, half coloured like metals.

    Parameters
    ----------
    seed : int
        Decides material and directions.
    n_samples : int

    Returns
    -------
    Measurements
        Without noise.

    Examples
    --------
    >>> two_lobes(1, n_samples=10).name
    'two_lobes_1'
    """
    rng = np.random.default_rng(seed)
    base = rng.uniform(0, 1, 3) * rng.uniform(0, 1)
    frame = {"n": np.array([0.0, 0.0, 1.0]), "t_theta": rng.uniform(0, np.pi)}
    isotropic = rng.random() < 0.5
    wi, wo = sample_pairs(n_samples, seed=rng)
    f = np.zeros((n_samples, 3))
    alpha = np.exp(rng.uniform(*np.log((0.01, 0.3))))
    for k in range(2):
        ratio = 1.0 if isotropic else np.exp(rng.uniform(0, np.log(4)))
        metal = rng.random() < 0.5
        f += ggx(
            wi,
            wo,
            **frame,
            rho_d=base if k == 0 else np.zeros(3),
            rho_s=np.full(3, np.exp(rng.uniform(*np.log((0.05, 1))))),
            alpha_x=min(alpha * np.sqrt(ratio), 1.0),
            alpha_y=alpha / np.sqrt(ratio),
            F0=rng.uniform(0.1, 1, 3) if metal else np.full(3, rng.uniform(0.02, 0.1)),
        )
        alpha = min(alpha * np.exp(rng.uniform(np.log(2), np.log(10))), 0.8)
    return Measurements(wi, wo, f, f"two_lobes_{seed}", "synthetic")


def assorted(seed, n_samples=100_000):
    """Draw a material from the many shapes that terms of published models take, and measure it.

    One to three lobes over a diffuse term. Each has one of three distributions (generalised Trowbridge-Reitz, hence GGX
    and its longer and shorter tails; hyper-Cauchy in the slope; exponential in the slope), a Fresnel colour that goes to
    white, stays, or shifts through a film's hues, one of three geometric factors, and a free power of the cosines.
    The diffuse term is Lambert's, brightens at the edges or towards the light. What a network learns here is less what
    materials are than what directions a factor may depend on, and how.

    Parameters
    ----------
    seed : int
        Decides material and directions.
    n_samples : int

    Returns
    -------
    Measurements
        Reciprocal, without noise; the value is limited to 1e4.

    References
    ----------
    Burley 2012, *Physically Based Shading at Disney*: GTR, retro-reflective diffuse, sheen; Wu et al. 2011 and Bagher et
    al. 2012 for tails between Beckmann's and GGX's. No Ward, no Beckmann: those test how networks generalise.

    Examples
    --------
    >>> assorted(1, n_samples=10).name
    'assorted_1'
    """
    rng = np.random.default_rng(seed)
    wi, wo = sample_pairs(n_samples, seed=rng)
    t, b, n = _frame(np.array([0.0, 0.0, 1.0]), rng.uniform(0, np.pi))
    i, o = (np.asarray(w, np.float64) @ np.stack((t, b, n), 1) for w in (wi, wo))
    h = i + o
    cos_d = np.linalg.norm(h, axis=1) / 2
    h /= 2 * cos_d[:, None]
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


def _distribution(rng, h, alpha_x, alpha_y):
    """Density of normals of one of three families, normalised at its peak like GGX."""
    x2 = (h[:, 0] / alpha_x) ** 2 + (h[:, 1] / alpha_y) ** 2
    peak = 1 / (np.pi * alpha_x * alpha_y)
    kind = rng.integers(3)
    if kind == 0:
        return peak / (x2 + h[:, 2] ** 2) ** rng.uniform(1.2, 4)
    slope2 = x2 / h[:, 2] ** 2
    if kind == 1:
        return peak / (1 + slope2) ** rng.uniform(0.8, 3) / h[:, 2] ** rng.uniform(0, 1)
    return peak * np.exp(-(slope2 ** rng.uniform(0.3, 0.8))) / h[:, 2] ** rng.uniform(0, 1)


def _geometry(rng, i, o, h, cos_d, alpha):
    kind = rng.integers(3)
    if kind == 0:
        return np.ones(len(i))
    if kind == 1:  # V-cavities
        return np.minimum(1, 2 * h[:, 2] * np.minimum(i[:, 2], o[:, 2]) / cos_d)
    k = alpha * rng.uniform(0.5, 1.5)  # Smith
    return np.prod([2 * w[:, 2] / (w[:, 2] + np.sqrt(k * k + (1 - k * k) * w[:, 2] ** 2)) for w in (i, o)], axis=0)


def _colour(rng, q):
    """Fresnel colour (N, 3) over q = 1 - cos_theta_d."""
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


def warp(wi, wo, seed):
    """A random smooth positive factor (N, 3), symmetric in wi and wo: what turns a material into one nobody measured.

    exp of a random cosine series in theta_h and theta_d, with a part that follows phi_d, a random power of the cosines, and
    a gain per channel; for a third of the seeds the channels also vary apart.

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
    channels = np.tile(g[:, None], 3)
    if rng.random() < 1 / 3:
        channels += 0.4 * np.stack([series() for _ in range(3)], 1)
    return np.exp(channels + rng.normal(0, 0.5) + rng.normal(0, 0.3, 3))


def ggx(wi, wo, *, n, t_theta, rho_d, rho_s, alpha_x, alpha_y, F0):
    r"""Anisotropic GGX: rho_d/pi + rho_s D F G / (4 cos_i cos_o), in float64.

    Parameters
    ----------
    wi, wo : array (N, 3)
        Unit vectors towards the viewer and the light.
    n : array (3,)
        Shading normal, not (1, 0, 0).
    t_theta : float
        Radians from the direction perpendicular to n that is closest to +x to the tangent, about n.
    alpha_x, alpha_y : float
    F0 : float or array (3,)
    rho_d, rho_s : array (3,)

    Returns
    -------
    array (N, 3)
        f_r in 1/sr; 0 where a direction is below the horizon of n.

    References
    ----------
    Walter et al. 2007, eq. 20, 33, 34; Heitz 2014, eq. 85 and 86 (anisotropic); Schlick 1994.

    Examples
    --------
    >>> grey = dict(n=[0, 0, 1], t_theta=0, rho_d=[0.5] * 3, rho_s=[0.0] * 3, alpha_x=0.1, alpha_y=0.1, F0=0.04)
    >>> ggx([[0, 0, 1]], [[0, 0, 1]], **grey).round(4)
    array([[0.1592, 0.1592, 0.1592]])
    """
    t, b, n = _frame(np.asarray(n, np.float64), t_theta)
    wi, wo = (np.asarray(w, np.float64) @ np.stack((t, b, n), 1) for w in (wi, wo))
    up = (wi[:, 2] > 0) & (wo[:, 2] > 0)
    f = np.zeros((len(wi), 3))
    wi, wo = wi[up], wo[up]
    h = wi + wo
    h /= np.linalg.norm(h, axis=1, keepdims=True)
    D = 1 / (np.pi * alpha_x * alpha_y * ((h[:, 0] / alpha_x) ** 2 + (h[:, 1] / alpha_y) ** 2 + h[:, 2] ** 2) ** 2)
    q = (1 - np.clip(np.sum(h * wo, 1), 0, 1)) ** 5  # clip: 1 + 1e-16 for wi = wo
    F = np.asarray(F0) + (1 - np.asarray(F0)) * q[:, None]
    G = 1.0  # height-uncorrelated: the product of both sides
    for w in (wi, wo):
        tan2 = ((alpha_x * w[:, 0]) ** 2 + (alpha_y * w[:, 1]) ** 2) / w[:, 2] ** 2
        G = G * 2 / (1 + np.sqrt(1 + tan2))
    specular = F * (D * G / (4 * wi[:, 2] * wo[:, 2]))[:, None]
    f[up] = np.asarray(rho_d) / np.pi + np.asarray(rho_s) * specular
    return f


def _frame(n, t_theta):
    """Tangent, bitangent and normal, as rows."""
    x = np.array([1.0, 0.0, 0.0]) - n[0] * n
    x /= np.linalg.norm(x)
    c, s = np.cos(t_theta), np.sin(t_theta)
    y = np.cross(n, x)
    return c * x + s * y, c * y - s * x, n
