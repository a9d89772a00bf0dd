"""Virtual measurements of a random anisotropic GGX, as section 6 of the paper makes them from OpenSVBRDF.

The formulas are written here a second time, in float64 numpy and without the package's own terms, so that fits and
terms can be tested against them.
"""

from __future__ import annotations

import numpy as np

from . import Measurements, clamp_negative
from .sampling import sample_pairs

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
