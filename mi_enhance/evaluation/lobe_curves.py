"""Curves and slices of a reflectance function: what a figure of a BRDF shows."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..data.directions import direction, rusinkiewicz_to_directions
from ..data.functions import Function

INCIDENCES = (15.0, 45.0, 75.0)  # degrees of the light whose lobes are shown
_LAST = 89.0  # degrees: beyond, 1/cos has no limit
_ALBEDO_ANGLES = np.linspace(0, 85, 18)
_N_THETA, _N_PHI = 256, 64  # half vectors that an albedo is the sum of
_N_SLICE = 90
_REC709 = np.array([0.2126, 0.7152, 0.0722])


class Curves(NamedTuple):
    """Figures of one BRDF.

    Parameters
    ----------
    angles : tuple of array (A,)
        Degrees of the viewer in the plane of incidence, for each of `INCIDENCES`; the light stands at the negative one.
    plane : tuple of array (A,)
        Luminance of f, 1/sr, at these angles.
    albedo_angles : array (B,)
        Degrees of the view.
    albedo : array (B, 3)
        Directional albedo, linear RGB.
    slice : array (N, N, 3)
        log(1 + f cos) over theta_d and theta_h, where phi_d is 90 degrees and phi_h is 0; theta_h is N steps of its
        root, from 0 to 90 degrees.
    """

    angles: tuple[np.ndarray, ...]
    plane: tuple[np.ndarray, ...]
    albedo_angles: np.ndarray
    albedo: np.ndarray
    slice: np.ndarray


def curves_of(f: Function) -> Curves:
    """Return the curves of ``f(wi, wo) -> (N, 3)``, in 1/sr.

    Examples
    --------
    >>> grey = curves_of(lambda wi, wo: np.full((len(wi), 3), 0.5 / np.pi))
    >>> grey.albedo[0].round(3)
    array([0.5, 0.5, 0.5])
    """
    angles = tuple(_viewers(theta) for theta in INCIDENCES)
    plane = tuple(_plane(f, np.deg2rad(theta), np.deg2rad(a)) for theta, a in zip(INCIDENCES, angles, strict=True))
    albedo = np.array([_albedo(f, np.deg2rad(a)) for a in _ALBEDO_ANGLES])
    return Curves(angles, plane, _ALBEDO_ANGLES, albedo, _slice(f))


def luminance(rgb: np.ndarray) -> np.ndarray:
    """Return the luminance of linear sRGB, (..., 3) to (...)."""
    return rgb @ _REC709


def _viewers(theta: float) -> np.ndarray:
    """Return angles from horizon to horizon, close together around the mirror and the light."""
    near = np.geomspace(0.01, 30, 120)
    close = [c + sign * near for c in (theta, -theta) for sign in (-1, 1)]
    a = np.unique(np.concatenate([np.linspace(-_LAST, _LAST, 357), [theta], *close]))
    return a[np.abs(a) <= _LAST]


def _call(f: Function, wi: np.ndarray, wo: np.ndarray) -> np.ndarray:
    return np.maximum(np.asarray(f(wi.astype(np.float32), wo.astype(np.float32)), np.float64), 0)


def _plane(f: Function, theta: float, viewers: np.ndarray) -> np.ndarray:
    wi = direction(viewers, np.zeros_like(viewers))
    wo = np.broadcast_to(direction(-theta, 0.0), wi.shape)
    return luminance(_call(f, wi, wo))


def _albedo(f: Function, theta: float) -> np.ndarray:
    """Sum over half vectors, which lie close where highlights are: d wo = 4 cos_d dh."""
    u = (np.arange(_N_THETA) + 0.5) / _N_THETA
    theta_h, phi_h = np.meshgrid(u**2 * np.pi / 2, (np.arange(_N_PHI) + 0.5) / _N_PHI * 2 * np.pi, indexing="ij")
    area = np.sin(theta_h) * np.pi * u[:, None] / _N_THETA * 2 * np.pi / _N_PHI
    h, wi = direction(theta_h.ravel(), phi_h.ravel()), direction(theta, 0.0)
    cos_d = h @ wi
    wo = 2 * cos_d[:, None] * h - wi
    above = (wo[:, 2] > 1e-4) & (cos_d > 0)
    wo, weight = wo[above], (4 * cos_d * area.ravel())[above]
    return (_call(f, np.broadcast_to(wi, wo.shape), wo) * (weight * wo[:, 2])[:, None]).sum(0)


def _slice(f: Function) -> np.ndarray:
    theta_d, root = np.meshgrid(np.linspace(0, np.deg2rad(_LAST), _N_SLICE), np.linspace(0, 1, _N_SLICE), indexing="ij")
    theta_h = np.minimum(root**2 * np.pi / 2, np.deg2rad(_LAST))
    wi, wo = rusinkiewicz_to_directions(theta_h, 0.0, theta_d, np.pi / 2)  # sideways: both above the horizon
    wi, wo = wi.reshape(-1, 3), wo.reshape(-1, 3)
    return np.log1p(_call(f, wi, wo) * wo[:, 2:]).reshape(_N_SLICE, _N_SLICE, 3)
