"""What the surface models of other programs are made of, in NumPy: GGX lobes, Fresnel terms, directional albedos.

Directions are one axis (N), sets of parameters another in front of it: a number of a model is (K, 1), a colour
(K, 1, 3), and a result (K, N) or (K, N, 3).
"""

from __future__ import annotations

import functools
from typing import NamedTuple

import numpy as np

from ..data.directions import cosine_hemisphere


class Pairs(NamedTuple):
    """Pairs of directions as the models see them, float64; each (N,), `h`, `i` and `o` (N, 3)."""

    i: np.ndarray  # the viewer
    o: np.ndarray  # the light
    h: np.ndarray  # the half vector
    cos_i: np.ndarray
    cos_o: np.ndarray
    cos_d: np.ndarray  # of either direction to the half vector

    @staticmethod
    def of(wi: np.ndarray, wo: np.ndarray) -> Pairs:
        """Return the pairs of unit vectors (N, 3) above the horizon."""
        i, o = wi.astype(np.float64), wo.astype(np.float64)
        h = i + o
        h /= np.linalg.norm(h, axis=1, keepdims=True)
        return Pairs(i, o, h, i[:, 2], o[:, 2], np.minimum(np.sum(i * h, 1), 1))


def ggx(h: np.ndarray, ax: np.ndarray, ay: np.ndarray) -> np.ndarray:
    """Return the distribution of normals, Walter et al. 2007, eq. 33, stretched as in Burley 2012."""
    q = (h[:, 0] / ax) ** 2 + (h[:, 1] / ay) ** 2 + h[:, 2] ** 2
    return 1 / (np.pi * ax * ay * q**2)


def _slope(w: np.ndarray, ax: np.ndarray, ay: np.ndarray) -> np.ndarray:
    """Return sqrt(cos^2 + (alpha sin)^2) of a direction: all that Smith's terms need."""
    return np.sqrt((w[:, 0] * ax) ** 2 + (w[:, 1] * ay) ** 2 + w[:, 2] ** 2)


def smith(p: Pairs, ax: np.ndarray, ay: np.ndarray) -> np.ndarray:
    """Return G / (4 cos_i cos_o) of Smith's height-correlated term; Heitz 2014, eq. 99."""
    return 0.5 / (p.cos_o * _slope(p.i, ax, ay) + p.cos_i * _slope(p.o, ax, ay))


def smith_apart(p: Pairs, ax: np.ndarray, ay: np.ndarray) -> np.ndarray:
    """Return G / (4 cos_i cos_o) where both directions are masked independently, as in Walter et al. 2007, eq. 23."""
    return 1 / ((p.cos_i + _slope(p.i, ax, ay)) * (p.cos_o + _slope(p.o, ax, ay)))


def schlick(f0: np.ndarray, cos: np.ndarray, f90: np.ndarray | float = 1.0) -> np.ndarray:
    """Return Schlick's Fresnel term (1994, eq. 15)."""
    return f0 + (f90 - f0) * (1 - np.minimum(cos, 1)) ** 5


def dielectric(cos: np.ndarray, eta: np.ndarray) -> np.ndarray:
    """Return the Fresnel term of an unpolarized wave that enters a medium of relative index eta >= 1."""
    inside = np.sqrt(np.maximum(eta**2 - 1 + cos**2, 0))  # eta times the cosine of the refracted ray
    s = (cos - inside) / (cos + inside)
    p = (eta**2 * cos - inside) / (eta**2 * cos + inside)
    return 0.5 * (s**2 + p**2)


def f0_of(eta: np.ndarray) -> np.ndarray:
    """Return the reflectance at normal incidence of a relative index."""
    return ((eta - 1) / (eta + 1)) ** 2


def oren_nayar(p: Pairs, colour: np.ndarray, roughness: np.ndarray) -> np.ndarray:
    """Return the energy-preserving Oren-Nayar term; Portsmouth, Kutz, Hill 2024 ("EON"), eq. 14 and following."""
    a = 1 / (1 + (0.5 - 2 / (3 * np.pi)) * roughness)
    s = np.sum(p.i * p.o, 1) - p.cos_i * p.cos_o
    single = a * (1 + roughness * np.where(s > 0, s / np.maximum(p.cos_i, p.cos_o), s))
    e_i, e_o = (a * (1 + roughness / np.pi * _eon(c)) for c in (p.cos_i, p.cos_o))
    mean = a * (1 + (2 / 3 - 28 / (15 * np.pi)) * roughness)
    # 1e-7: for roughness 0 nothing is left to be scattered twice, and this is 0 / 0
    twice = (1 - e_i) * (1 - e_o) / np.maximum(1 - mean, 1e-7)
    again = colour**2 * mean[..., None] / (1 - colour * (1 - mean[..., None]))
    return (colour * single[..., None] + again * np.maximum(twice, 0)[..., None]) / np.pi


def _eon(cos: np.ndarray) -> np.ndarray:
    sin = np.sqrt(1 - cos**2)
    return sin * (np.arccos(cos) - sin * cos) + 2 / 3 * (sin / cos * (1 - sin**3) - sin)


_N_TABLE, _N_DRAWN = 24, 256  # entries over cosine and roughness; directions in each


def albedo(cos: np.ndarray, alpha: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a and b, so that a GGX lobe with Schlick's Fresnel term reflects F0 a + F90 b of what is received.

    The split sum of Karis 2013, by quadrature; interpolated in the cosine and in the root of alpha.
    """
    table = _albedo_table()
    at_cos, at_root = (np.broadcast_arrays(cos, np.sqrt(alpha))[k] * (_N_TABLE - 1) for k in (0, 1))
    j, k = (np.clip(x.astype(int), 0, _N_TABLE - 2) for x in (at_cos, at_root))
    s, t = (at_cos - j)[..., None], (at_root - k)[..., None]
    low = table[j, k] * (1 - s) + table[j + 1, k] * s
    high = table[j, k + 1] * (1 - s) + table[j + 1, k + 1] * s
    result = low * (1 - t) + high * t
    return result[..., 0], result[..., 1]


@functools.cache
def _albedo_table() -> np.ndarray:
    """Sample visible normals (Heitz 2018): what a lobe reflects is the mean of F G / G1."""
    cos, root = np.meshgrid(np.linspace(0, 1, _N_TABLE), np.linspace(0, 1, _N_TABLE), indexing="ij")
    cos, alpha = np.maximum(cos, 1e-3)[..., None], np.maximum(root**2, 1e-4)[..., None]  # grazing, smooth: the limits
    disk = cosine_hemisphere(_N_DRAWN)[:, :2]  # even on the disk
    sin = np.sqrt(1 - cos**2)
    v = np.stack(np.broadcast_arrays(alpha * sin, 0 * cos, cos))
    v /= np.linalg.norm(v, axis=0)
    s = 0.5 * (1 + v[2])
    x, y = disk[:, 1], disk[:, 0]  # across the plane of incidence, and along it
    y = (1 - s) * np.sqrt(1 - x**2) + s * y
    z = np.sqrt(np.maximum(1 - x**2 - y**2, 0))
    # the frame of v: across, along, and v itself
    along = np.stack((-v[2], 0 * v[2], v[0]))
    m = z * v + y * along + x * np.array([0.0, 1.0, 0.0])[:, None, None, None]
    m = np.stack((alpha * m[0], alpha * m[1], np.maximum(m[2], 1e-9)))  # 1e-9: a normal at the horizon is none below
    m /= np.linalg.norm(m, axis=0)
    cos_d = sin * m[0] + cos * m[2]
    cos_o = 2 * cos_d * m[2] - cos
    tail_i = np.sqrt(cos**2 + alpha**2 * (1 - cos**2))
    tail_o = np.sqrt(cos_o**2 + alpha**2 * (1 - cos_o**2))
    # G / G1 of the height-correlated term
    part = np.where(cos_o > 0, cos_o * (cos + tail_i) / (cos_o * tail_i + cos * tail_o), 0)
    weight = (1 - np.clip(cos_d, 0, 1)) ** 5
    return np.stack(((part * (1 - weight)).mean(-1), (part * weight).mean(-1)), -1)
