"""Virtual measurements of random materials, anisotropic GGX as section 6 of the paper makes them from OpenSVBRDF first.

The formulas are written here a second time, in float64 numpy and without the package's own terms, so that fits and
terms can be tested against them. `ward_anisotropic` and `beckmann_mixture` are for validation only, like RGL: nothing
is ever trained or tuned on them. No anisotropic measurement could be had, so these kinds must stay unseen.
"""

from __future__ import annotations

import numpy as np

from .directions import MIN_COS, direction, sample_pairs, with_peaks
from .measurements import Measurements, clamp_negative
from .reference_brdfs import beckmann, frame, ggx, ward

_F0 = 0.04
_RHO_S_MAX = 10.0
_ALPHA_RANGE = (0.006, 0.503)  # OpenSVBRDF's published range, log-uniform


def ggx_anisotropic(
    seed: int, n_samples: int = 100_000, noise: float = 0.1, max_tilt: float = 0.0, peaks: float = 0.0
) -> tuple[Measurements, dict]:
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
    peaks : float
        Share of the samples in the highlight, see :func:`mi_enhance.data.directions.with_peaks`.

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
    low, high = np.log(_ALPHA_RANGE)
    alpha_y, alpha_x = np.sort(np.exp(rng.uniform(low, high, 2)))
    tilt, azimuth = rng.uniform(0, max_tilt), rng.uniform(0, 2 * np.pi)
    truth: dict = {
        "n": direction(tilt, azimuth),
        "t_theta": rng.uniform(0, np.pi),
        "rho_d": rng.uniform(0, 1, 3),
        "rho_s": rng.uniform(0, _RHO_S_MAX, 3),
        "alpha_x": float(alpha_x),
        "alpha_y": float(alpha_y),
        "F0": _F0,
    }

    def above(wi: np.ndarray, wo: np.ndarray) -> np.ndarray:
        return np.minimum(wi @ truth["n"], wo @ truth["n"]) >= MIN_COS

    wi, wo = sample_pairs(n_samples, seed=rng, accept=above)
    axes = np.stack(frame(truth["n"], truth["t_theta"]))
    wi, wo = with_peaks(wi, wo, peaks, rng, alpha=(truth["alpha_x"], truth["alpha_y"]), axes=axes)
    f = ggx(wi, wo, **truth) * rng.normal(1, noise, (n_samples, 3))
    f, clamped_fraction = clamp_negative(f)
    return Measurements(wi, wo, f, f"ggx_anisotropic_{seed}", f"synthetic, noise {noise}", clamped_fraction), truth


def two_lobes(seed: int, n_samples: int = 100_000, peaks: float = 0.0) -> Measurements:
    """Draw a material with a sharp and a wide lobe, like a coat over paint or a flake in lacquer, and measure it.

    One GGX cannot be such a material: networks that saw only single lobes do not generalize to real ones. Half of the
    materials are isotropic, half of the Fresnel reflectances are those of dielectrics, half coloured like metals.

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
        Without noise.

    Examples
    --------
    >>> two_lobes(1, n_samples=10).name
    'two_lobes_1'
    """
    rng = np.random.default_rng(seed)
    base = rng.uniform(0, 1, 3) * rng.uniform(0, 1)
    frame: dict = {"n": np.array([0.0, 0.0, 1.0]), "t_theta": rng.uniform(0, np.pi)}
    isotropic = rng.random() < 0.5
    wi, wo = with_peaks(*sample_pairs(n_samples, seed=rng), peaks, rng)
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


def ward_anisotropic(seed: int, n_samples: int = 100_000) -> Measurements:
    """Draw an anisotropic Ward material, rotated by 0 to 180 degrees. Never to be trained on.

    Parameters
    ----------
    seed : int
        Decides material and directions.
    n_samples : int

    Returns
    -------
    Measurements
        Without noise. Both albedos coloured and at most 1 together, roughness 0.03 to 0.3 (geometric mean), 1.5 to 6
        times as rough along one axis as along the other.

    Examples
    --------
    >>> ward_anisotropic(1, n_samples=10).name
    'ward_anisotropic_1'
    """
    rng = np.random.default_rng(seed)
    rho_s = rng.uniform(0.05, 0.6, 3)
    material: dict = {"t_theta": rng.uniform(0, np.pi), "rho_s": rho_s, "rho_d": (1 - rho_s) * rng.uniform(0, 1, 3)}
    material |= _stretched(rng, np.exp(rng.uniform(*np.log((0.03, 0.3)))))
    wi, wo = sample_pairs(n_samples, seed=rng)
    return Measurements(wi, wo, ward(wi, wo, **material), f"ward_anisotropic_{seed}", "synthetic, validation only")


def beckmann_mixture(seed: int, n_samples: int = 100_000) -> Measurements:
    """Draw a mixture of two anisotropic Beckmann lobes, rotated by 0 to 180 degrees. Never to be trained on.

    Parameters
    ----------
    seed : int
        Decides material and directions.
    n_samples : int

    Returns
    -------
    Measurements
        Without noise. A lobe of roughness 0.03 to 0.15 and one 2 to 5 times as rough, each with its own anisotropy
        (up to 6) and coloured Fresnel reflectance, on a coloured diffuse base.

    Examples
    --------
    >>> beckmann_mixture(1, n_samples=10).name
    'beckmann_mixture_1'
    """
    rng = np.random.default_rng(seed)
    t_theta, share = rng.uniform(0, np.pi), rng.uniform(0.2, 0.8)
    rho_d = rng.uniform(0, 1, 3) * rng.uniform(0, 0.5)
    sharp = np.exp(rng.uniform(*np.log((0.03, 0.15))))
    wi, wo = sample_pairs(n_samples, seed=rng)
    f = np.tile(rho_d / np.pi, (n_samples, 1))
    for weight, alpha in ((share, sharp), (1 - share, sharp * rng.uniform(2, 5))):
        F0 = rng.uniform(0.04, 1, 3)
        f += weight * beckmann(wi, wo, t_theta=t_theta, F0=F0, **_stretched(rng, alpha))
    return Measurements(wi, wo, f, f"beckmann_mixture_{seed}", "synthetic, validation only")


def _stretched(rng: np.random.Generator, alpha: float) -> dict[str, float]:
    """Return the roughness along both axes: geometric mean `alpha`, ratio 1.5 to 6."""
    ratio = np.sqrt(np.exp(rng.uniform(*np.log((1.5, 6)))))
    return {"alpha_x": alpha * ratio, "alpha_y": alpha / ratio}
