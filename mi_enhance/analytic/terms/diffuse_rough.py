"""A rough diffuse factor that loses no energy."""

from __future__ import annotations

from collections.abc import Mapping

import drjit as dr
import numpy as np

from .. import parameters as p
from .registry import term

# Albedo of Fujii's Oren-Nayar for a white surface, (E / A - 1) / r over 1 - cos: a fit of the source, within 1e-3.
_ALBEDO = (0.0571085289, 0.491881867, -0.332181442, 0.0714429953)


def _as_lambert(values: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    return {"diffuse_roughness": np.zeros_like(values["alpha_x"])}


@term("B", parameters=(p.DIFFUSE_ROUGHNESS,), start=_as_lambert)
def B_eon(wi, wo, diffuse_roughness):
    r"""Directional factor of the energy-preserving Oren-Nayar model (EON), the diffuse term of OpenPBR.

    .. math::
        B = A \left( 1 + r \frac{s}{t} \right) + \frac{(1 - E(\omega_i)) (1 - E(\omega_o))}{1 - \bar{E}}, \quad
        A = \frac{1}{1 + (1/2 - 2/(3\pi)) r}

    with s = wi . wo - cos_theta_i cos_theta_o; t = max(cos_theta_i, cos_theta_o) where s > 0, else 1; E the albedo of
    the first summand and Ē its mean.

    Parameters
    ----------
    wi, wo : mi.Vector3f, N lanes
        Directions towards viewer and light, local frame, above the horizon. A cosine t below 1e-4 counts as 1e-4: no
        0 / 0 where both graze.
    diffuse_roughness : mi.Float, 1 or N lanes
        r, in [0, 1]; 0 is Lambert.

    Returns
    -------
    mi.Float, N lanes
        Times rho_d / pi, :func:`M_lambert`, the diffuse term. Its albedo is rho_d at every view, to 1e-3: facets pass
        light on as if they were white. EON itself makes that light take the colour twice, which is not linear in
        rho_d; every model of this package is.

    References
    ----------
    Portsmouth, Kutz and Hill 2025, *EON: A Practical Energy-Preserving Rough Diffuse BRDF*, eqs. (7), (11) to (15).

    Examples
    --------
    >>> B_eon(mi.Vector3f(0, 0, 1), mi.Vector3f(0.6, 0, 0.8), mi.Float(0))
    [1]
    """
    r = diffuse_roughness
    a = dr.rcp(1 + (0.5 - 2 / (3 * dr.pi)) * r)
    s = wi.x * wo.x + wi.y * wo.y  # wi . wo without the product of the cosines: nothing cancels
    t = dr.select(s > 0, dr.maximum(dr.maximum(wi.z, wo.z), 1e-4), 1)

    def missing(cos):
        """1 - E, of at least 0: at r = 0 and cos = 1 it is 0 to rounding."""
        x = 1 - dr.clip(cos, 0, 1)
        g = x * (_ALBEDO[0] + x * (_ALBEDO[1] + x * (_ALBEDO[2] + x * _ALBEDO[3])))
        return dr.maximum(1 - a * (1 + r * g), 0)

    mean = 1 - a * (1 + (2 / 3 - 28 / (15 * dr.pi)) * r)
    # 1e-7: for Lambert nothing is missing, 0 / 0; the products above are of second order
    return a * (1 + r * s / t) + missing(wi.z) * missing(wo.z) / dr.maximum(mean, 1e-7)
