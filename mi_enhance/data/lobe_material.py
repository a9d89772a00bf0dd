"""A material as a sum of microfacet lobes over a base, and its albedo, in float64."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .directions import cosine_hemisphere, direction
from .random_terms import half_vectors
from .reference_brdfs import frame, smith

Reflectance = Callable[[np.ndarray], np.ndarray]  # of the cosine (N,), in RGB (N, 3) or grey (N, 1)
BRDF = Callable[[np.ndarray, np.ndarray], np.ndarray]

_NORMAL = np.array([0.0, 0.0, 1.0])
_ALBEDO_SAMPLES = 2048  # of each strategy
_MIRRORED = np.array([-1.0, -1.0, 1.0])


@dataclass(frozen=True)
class Lobe:
    """D G / (4 cos_i cos_o) of a distribution with a tail of its own and GGX's shadowing.

    Parameters
    ----------
    alpha_x, alpha_y : float
    t_theta : float
        Radians from +x to the tangent.
    tail : float
        Exponent, 2: GGX; lower is a longer tail.
    slopes : bool
        The exponent is of the slope (Student's t) and not of the normal (GTR).
    back : bool
        The lobe stands about the light and not about its mirror image: the half vector is the back vector.

    References
    ----------
    Burley 2012, *Physically Based Shading at Disney* (GTR); Ribardiere et al. 2017, *STD: Student's t-Distribution of
    Slopes for Microfacet Based BSDFs*; Belcour et al. 2014, *Bidirectional Reflectance Distribution Function
    Measurements and Analysis of Retroreflective Materials* (back vector).
    """

    alpha_x: float
    alpha_y: float
    t_theta: float = 0.0
    tail: float = 2.0
    slopes: bool = False
    back: bool = False

    def __call__(self, i: np.ndarray, o: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the lobe (N,) and the cosine between each direction and the half vector (N,)."""
        i, o = i @ self.axes.T, o @ self.axes.T
        h, cos_d = half_vectors(i * _MIRRORED if self.back else i, o)
        lobe = self.density(h) * smith(i, o, self.alpha_x, self.alpha_y) / (4 * i[:, 2] * o[:, 2])
        return lobe, np.minimum(cos_d, 1)

    @property
    def axes(self) -> np.ndarray:
        """Tangent, bitangent and normal, as rows."""
        return np.stack(frame(_NORMAL, self.t_theta))

    def density(self, h: np.ndarray) -> np.ndarray:
        """Return the density of normals (N,) by half vectors in the frame of the lobe."""
        x2 = (h[:, 0] / self.alpha_x) ** 2 + (h[:, 1] / self.alpha_y) ** 2
        area, m = self.alpha_x * self.alpha_y, self.tail - 1
        if self.slopes:
            return (1 + x2 / h[:, 2] ** 2 / m) ** -self.tail / (np.pi * area * h[:, 2] ** 4)
        return m * (1 - area) / (1 - area**m) / (np.pi * area) / (x2 + h[:, 2] ** 2) ** self.tail


@dataclass(frozen=True)
class Material:
    """Lobes times their Fresnel reflectance, over a base.

    Parameters
    ----------
    lobes : tuple of (Lobe, callable)
        The sharpest first.
    base : callable
        Everything else: ``base(i, o) -> (N, 3)``.
    scale : float
    """

    lobes: tuple[tuple[Lobe, Reflectance], ...]
    base: BRDF
    scale: float = 1.0

    def __call__(self, i: np.ndarray, o: np.ndarray) -> np.ndarray:
        """Return f_r in 1/sr, (N, 3), by directions (N, 3) above the horizon."""
        f = self.base(i, o)
        for lobe, reflectance in self.lobes:
            value, cos_d = lobe(i, o)
            f = f + reflectance(cos_d) * value[:, None]
        return self.scale * f

    def albedo(self, theta: float) -> np.ndarray:
        """Return the directional albedo (3,) of light that comes in at `theta`, radians.

        Samples lie where the lobes are, at two more widths, and by the cosine, weighted by the balance heuristic
        (Veach and Guibas 1995).
        """
        i = direction(theta, 0.3)
        guides = [lobe for lobe, _ in self.lobes] + [Lobe(0.03, 0.03), Lobe(0.15, 0.15)]
        o = np.concatenate([cosine_hemisphere(_ALBEDO_SAMPLES)] + [_about(lobe, i) for lobe in guides])
        o = o[o[:, 2] > 1e-4]  # at the horizon itself nothing is defined
        i = np.broadcast_to(i, o.shape)
        density = o[:, 2] / np.pi
        for lobe in guides:
            h, cos_d = half_vectors(i @ lobe.axes.T * (_MIRRORED if lobe.back else 1), o @ lobe.axes.T)
            density = density + Lobe(lobe.alpha_x, lobe.alpha_y).density(h) * h[:, 2] / (4 * cos_d)
        return (self(i, o) * (o[:, 2] / density)[:, None]).sum(0) / _ALBEDO_SAMPLES


def _about(lobe: Lobe, i: np.ndarray) -> np.ndarray:
    """Return directions (N, 3) that reflect `i` at GGX normals of a lobe's roughness."""
    spread = cosine_hemisphere(_ALBEDO_SAMPLES)
    u = spread[:, 0] ** 2 + spread[:, 1] ** 2
    slope = np.sqrt(1 / (1 - u))  # times the radius sqrt(u) that is in `spread`
    h = np.stack([lobe.alpha_x * slope * spread[:, 0], lobe.alpha_y * slope * spread[:, 1], np.ones(len(u))], 1)
    h = h @ lobe.axes / np.linalg.norm(h, axis=1, keepdims=True)
    i = i * _MIRRORED if lobe.back else i
    return 2 * (h @ i)[:, None] * h - i
