"""Fresnel reflectance of dielectrics, metals and thin films, in float64."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

# Nanometres, a few around the peak of each channel of sRGB: their average keeps hues and has no fringes of one line.
WAVELENGTHS = np.array([[585.0, 605.0, 630.0], [520.0, 540.0, 560.0], [430.0, 450.0, 470.0]])


def dielectric(cos: ArrayLike, eta: ArrayLike) -> np.ndarray:
    """Return the reflectance of unpolarized light at the border to a dielectric of relative index `eta`.

    Parameters
    ----------
    cos : array
        Cosine of the angle of incidence, [0, 1].
    eta : float or array
        At least 1: from the outside.

    References
    ----------
    Born and Wolf, *Principles of Optics*, section 1.5.

    Examples
    --------
    >>> dielectric([1.0, 0.0], 1.5).round(3)
    array([0.04, 1.  ])
    """
    return conductor(cos, eta, 0.0)


def conductor(cos: ArrayLike, eta: ArrayLike, k: ArrayLike) -> np.ndarray:
    """Return the reflectance of unpolarized light at a metal of complex index eta + i k; arrays are broadcast.

    References
    ----------
    Born and Wolf, *Principles of Optics*, section 14.2.

    Examples
    --------
    >>> conductor([1.0, 0.0], 0.2, 3.4).round(3)
    array([0.938, 1.   ])
    """
    cos = np.asarray(cos, np.float64)
    index = np.asarray(eta) + 1j * np.asarray(k)
    return _intensity(*_amplitudes(cos, _inside(cos, index), 1.0, index))


def metal_index(r: ArrayLike, edge: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Return eta and k of a metal by its reflectance at normal incidence, (0, 1), and its edge tint, [0, 1].

    References
    ----------
    Gulbrandsen 2014, *Artist Friendly Metallic Fresnel*.

    Examples
    --------
    >>> conductor(1.0, *metal_index(0.9, 0.3)).round(6)
    np.float64(0.9)
    """
    r, edge = np.asarray(r, np.float64), np.asarray(edge, np.float64)
    eta = edge * (1 - r) / (1 + r) + (1 - edge) * (1 + np.sqrt(r)) / (1 - np.sqrt(r))
    # 0: rounding, where the index is real
    k2 = np.maximum((r * (eta + 1) ** 2 - (eta - 1) ** 2) / (1 - r), 0)
    return eta, np.sqrt(k2)


def lazanyi(cos: ArrayLike, F0: ArrayLike, dip: ArrayLike) -> np.ndarray:
    """Return Schlick's reflectance of a metal less Lazanyi's error term.

    Parameters
    ----------
    cos : array
    F0 : array
        At normal incidence.
    dip : array
        What is left of Schlick's value at 82 degrees (cosine 1/7), [0, 1].

    References
    ----------
    Lazanyi and Szirmay-Kalos 2005, *Fresnel Term Approximations for Metals*; Hoffman 2019, *Fresnel Equations
    Considered Harmful*, for the value at 82 degrees.

    Examples
    --------
    >>> lazanyi([1.0, 1 / 7, 0.0], 0.5, 0.8).round(3)
    array([0.5  , 0.585, 1.   ])
    """
    cos, F0 = np.asarray(cos, np.float64), np.asarray(F0)

    def schlick(c: ArrayLike) -> np.ndarray:
        return F0 + (1 - F0) * (1 - np.asarray(c)) ** 5

    depth = schlick(1 / 7) * (1 - np.asarray(dip)) / (1 / 7 * (6 / 7) ** 6)
    return np.clip(schlick(cos) - depth * cos * (1 - cos) ** 6, 0, 1)


def thin_film(cos: ArrayLike, thickness: float, eta: float, base: ArrayLike) -> np.ndarray:
    """Return the RGB reflectance (N, 3) of a film on a base: Airy's sum over all reflections between its faces.

    Parameters
    ----------
    cos : array (N,)
    thickness : float
        Nanometres.
    eta : float
        Index of the film.
    base : complex, or complex array (3,)
        Index below, eta + i k, for each channel.

    References
    ----------
    Born and Wolf, *Principles of Optics*, section 7.6; Belcour and Barla 2017, *A Practical Extension to Microfacet
    Theory for the Modeling of Varying Iridescence*, for its place in a microfacet lobe.

    Examples
    --------
    >>> thin_film([1.0, 0.3], 0.0, 1.5, 1.5 + 0j).round(3).tolist()
    [[0.04, 0.04, 0.04], [0.208, 0.208, 0.208]]
    """
    cos = np.asarray(cos, np.float64)[:, None, None]
    below = np.broadcast_to(np.asarray(base, np.complex128), 3)[:, None]
    cos_film, cos_below = _inside(cos, complex(eta)), _inside(cos, below)
    turn = np.exp(4j * np.pi * eta * thickness * cos_film / WAVELENGTHS)
    above_film = _amplitudes(cos, cos_film, 1.0, complex(eta))
    film_below = _amplitudes(cos_film, cos_below, complex(eta), below)
    sums = [(a + b * turn) / (1 + a * b * turn) for a, b in zip(above_film, film_below, strict=True)]
    return _intensity(*sums).mean(2)


def tabulated(reflectance: Callable[[np.ndarray], np.ndarray], size: int = 2048) -> Callable[[np.ndarray], np.ndarray]:
    """Return the RGB reflectance as a function that looks it up, linear in the cosine: as good, and quick.

    Examples
    --------
    >>> lookup = tabulated(lambda cos: np.stack([cos, cos**2, cos**3], 1))
    >>> lookup(np.array([0.5])).round(4)
    array([[0.5  , 0.25 , 0.125]])
    """
    grid = np.linspace(0, 1, size)
    table = reflectance(grid)
    return lambda cos: np.stack([np.interp(cos, grid, table[:, k]) for k in range(3)], 1)


def _inside(cos: np.ndarray, index: ArrayLike) -> np.ndarray:
    """Return the cosine of the refracted direction, by Snell's law."""
    return np.sqrt(1 - (1 - cos**2) / np.asarray(index, np.complex128) ** 2)


def _amplitudes(
    cos_a: np.ndarray, cos_b: np.ndarray, a: complex | np.ndarray, b: complex | np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the amplitudes reflected at the border from index a to b, perpendicular and parallel."""
    perpendicular = (a * cos_a - b * cos_b) / (a * cos_a + b * cos_b)
    return perpendicular, (b * cos_a - a * cos_b) / (b * cos_a + a * cos_b)


def _intensity(perpendicular: np.ndarray, parallel: np.ndarray) -> np.ndarray:
    return (np.abs(perpendicular) ** 2 + np.abs(parallel) ** 2) / 2
