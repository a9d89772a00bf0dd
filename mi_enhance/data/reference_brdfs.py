"""Analytic BRDFs in float64, written apart from the terms that fits use."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike


def ggx(
    wi: ArrayLike,
    wo: ArrayLike,
    *,
    n: ArrayLike,
    t_theta: float,
    rho_d: ArrayLike,
    rho_s: ArrayLike,
    alpha_x: float,
    alpha_y: float,
    F0: ArrayLike,
) -> np.ndarray:
    r"""Evaluate anisotropic GGX: rho_d/pi + rho_s D F G / (4 cos_i cos_o), in float64.

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
    t, b, n = frame(np.asarray(n, np.float64), t_theta)
    i, o = (np.asarray(w, np.float64) @ np.stack((t, b, n), 1) for w in (wi, wo))
    up = (i[:, 2] > 0) & (o[:, 2] > 0)
    f = np.zeros((len(i), 3))
    i, o = i[up], o[up]
    h = i + o
    h /= np.linalg.norm(h, axis=1, keepdims=True)
    D = 1 / (np.pi * alpha_x * alpha_y * ((h[:, 0] / alpha_x) ** 2 + (h[:, 1] / alpha_y) ** 2 + h[:, 2] ** 2) ** 2)
    q = (1 - np.clip(np.sum(h * o, 1), 0, 1)) ** 5  # clip: 1 + 1e-16 for wi = wo
    F = np.asarray(F0) + (1 - np.asarray(F0)) * q[:, None]
    specular = F * (D * smith(i, o, alpha_x, alpha_y) / (4 * i[:, 2] * o[:, 2]))[:, None]
    f[up] = np.asarray(rho_d) / np.pi + np.asarray(rho_s) * specular
    return f


def smith(i: np.ndarray, o: np.ndarray, alpha_x: float, alpha_y: float) -> np.ndarray:
    """Return GGX's shadowing and masking (N,), height-uncorrelated: the product of both sides.

    References
    ----------
    Heitz 2014, eqs. 85 and 86.

    Examples
    --------
    >>> smith(np.array([[0.0, 0, 1]]), np.array([[0.0, 0, 1]]), 0.1, 0.1)
    array([1.])
    """
    G = np.ones(len(i))
    for w in (i, o):
        tan2 = ((alpha_x * w[:, 0]) ** 2 + (alpha_y * w[:, 1]) ** 2) / w[:, 2] ** 2
        G = G * 2 / (1 + np.sqrt(1 + tan2))
    return G


def ward(
    wi: ArrayLike, wo: ArrayLike, *, t_theta: float, rho_d: ArrayLike, rho_s: ArrayLike, alpha_x: float, alpha_y: float
) -> np.ndarray:
    r"""Evaluate anisotropic Ward, normal (0, 0, 1), in float64.

    .. math:: f = \frac{\rho_d}{\pi} + \frac{\rho_s}{4 \pi \alpha_x \alpha_y \sqrt{\cos\theta_i \cos\theta_o}}
        \exp\left(-\frac{h_x^2 / \alpha_x^2 + h_y^2 / \alpha_y^2}{h_z^2}\right)

    Parameters
    ----------
    wi, wo : array (N, 3)
        Unit vectors towards the viewer and the light, above the horizon.
    t_theta : float
        Radians from +x to the tangent.
    rho_d, rho_s : array (3,)
    alpha_x, alpha_y : float

    Returns
    -------
    array (N, 3)
        f_r in 1/sr.

    References
    ----------
    Ward 1992, *Measuring and Modeling Anisotropic Reflection*, eq. 5a.

    Examples
    --------
    >>> grey = dict(t_theta=0, rho_d=[0.0] * 3, rho_s=[1.0] * 3, alpha_x=0.5, alpha_y=0.5)
    >>> ward([[0, 0, 1]], [[0, 0, 1]], **grey).round(4)
    array([[0.3183, 0.3183, 0.3183]])
    """
    i, o, h = _local(wi, wo, t_theta)
    slope2 = ((h[:, 0] / alpha_x) ** 2 + (h[:, 1] / alpha_y) ** 2) / h[:, 2] ** 2
    lobe = np.exp(-slope2) / (4 * np.pi * alpha_x * alpha_y * np.sqrt(i[:, 2] * o[:, 2]))
    return np.asarray(rho_d) / np.pi + np.asarray(rho_s) * lobe[:, None]


def beckmann(
    wi: ArrayLike, wo: ArrayLike, *, t_theta: float, F0: ArrayLike, alpha_x: float, alpha_y: float
) -> np.ndarray:
    r"""Evaluate the specular lobe D F G / (4 cos_i cos_o) with anisotropic Beckmann D, normal (0, 0, 1), in float64.

    Parameters
    ----------
    wi, wo : array (N, 3)
        Unit vectors towards the viewer and the light, above the horizon.
    t_theta : float
        Radians from +x to the tangent.
    F0 : array (3,)
        Reflectance at normal incidence, Schlick's formula.
    alpha_x, alpha_y : float

    Returns
    -------
    array (N, 3)
        f_r in 1/sr.

    References
    ----------
    Walter et al. 2007, eqs. 20, 25 and 27 (rational fit of G1); Heitz 2014, eq. 80 and 81 (anisotropic); Schlick 1994.

    Examples
    --------
    >>> beckmann([[0, 0, 1]], [[0, 0, 1]], t_theta=0, F0=[1.0] * 3, alpha_x=0.5, alpha_y=0.5).round(4)
    array([[0.3183, 0.3183, 0.3183]])
    """
    i, o, h = _local(wi, wo, t_theta)
    slope2 = ((h[:, 0] / alpha_x) ** 2 + (h[:, 1] / alpha_y) ** 2) / h[:, 2] ** 2
    D = np.exp(-slope2) / (np.pi * alpha_x * alpha_y * h[:, 2] ** 4)
    cos_d = np.linalg.norm(i + o, axis=1) / 2  # unlike h o, the same after a swap to the last bit
    q = (1 - np.minimum(cos_d, 1)) ** 5
    F = np.asarray(F0) + (1 - np.asarray(F0)) * q[:, None]
    G: np.ndarray | float = 1.0
    for w in (i, o):
        # 1e-9: at normal incidence nothing is in the shadow, a is infinite
        a = w[:, 2] / np.maximum(np.hypot(alpha_x * w[:, 0], alpha_y * w[:, 1]), 1e-9)
        inside = np.minimum(a, 1.6)
        rational = (3.535 * inside + 2.181 * inside**2) / (1 + 2.276 * inside + 2.577 * inside**2)
        G = G * np.where(a < 1.6, rational, 1.0)
    return F * (D * G / (4 * i[:, 2] * o[:, 2]))[:, None]


def _local(wi: ArrayLike, wo: ArrayLike, t_theta: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return both directions and the half vector in the frame of the tangent."""
    axes = np.stack(frame(np.array([0.0, 0.0, 1.0]), t_theta), 1)
    i, o = (np.asarray(w, np.float64) @ axes for w in (wi, wo))
    h = i + o
    return i, o, h / np.linalg.norm(h, axis=1, keepdims=True)


def frame(n: np.ndarray, t_theta: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return tangent, bitangent and normal, as rows."""
    x = np.array([1.0, 0.0, 0.0]) - n[0] * n
    x /= np.linalg.norm(x)
    c, s = np.cos(t_theta), np.sin(t_theta)
    y = np.cross(n, x)
    return c * x + s * y, c * y - s * x, n
