r"""Bounded energy: a factor for each of the two directions that keeps the directional albedo at most 1.

.. math::
    f'(w_i, w_o) = s(w_i)\, f(w_i, w_o)\, s(w_o), \qquad \int f'(w_i, w_o) \cos\theta_o \, dw_o \le 1

One function of the angle to the material's normal serves both directions, so f' is as reciprocal as f; it is 1 where f
already reflects less than it receives. It is tabulated from the material's parameters as they are now, so the bound
holds for edited materials, too.
"""

from __future__ import annotations

from collections.abc import Mapping

import drjit as dr
import mitsuba as mi

from ..analytic import geometry
from ..neural import cooperative
from ..neural.enhanced_brdf import EnhancedBRDF
from ..numerics import sequences
from . import albedo, lobe_mixture

# Evenly spaced in the fourth root of the cosine: the albedo changes most in the last degrees. Node 1 is at 2e-7; node 5
# at geometry.MIN_COS, where terms have a kink and the albedo of some a peak.
_NODES = 51
_AZIMUTHS = 32  # of the view: anisotropic lobes are narrow; the table holds the worst of them
_SAMPLES = 1024  # directions of the light for each view
_STEPS = 8
# The albedo aimed at: the rest is for the error of the quadrature, and for what the albedo does between the nodes.
# One of a thousand materials came out 3 % above the aim.
_TARGET = 0.97
# Up to node 6, within 0.02 degrees of the horizon: weights of samples reach hundreds there, and sums of a thousand
# were met that are a quarter too small.
_TARGET_AT_HORIZON, _AT_HORIZON = 0.75, 6


def table(brdf: EnhancedBRDF, params: Mapping, lobe_albedo: mi.Float | float) -> mi.Float:
    """The factor s at the nodes of the angle to the normal, for :func:`factor`.

    Parameters
    ----------
    brdf : EnhancedBRDF
    params : dict
        Parameters of the material, one lane each, RGB colours.
    lobe_albedo : mi.Float or float
        Decides how often the lobes are drawn here, see :func:`mi_enhance.sampling.lobe_mixture.shares`.

    Returns
    -------
    mi.Float, 51 entries
        In (0, 1]. Gradients are not tracked.

    Examples
    --------
    >>> from mi_enhance import Material
    >>> m = Material.analytic("ward").edit(rho_s=1.0)
    >>> s = table(m.brdf, m.as_drjit(), 0.1)
    >>> s[0] < 0.5, s[30]
    (True, 1.0)
    """
    shares = lobe_mixture.shares(params, lobe_albedo, brdf.model)
    with dr.suspend_grad():
        cos, value = _reflected(brdf, params, shares)

        def largest_albedo(s):
            received = [dr.block_sum(v * _between(s, cos), _SAMPLES) / _SAMPLES for v in value]
            largest = dr.maximum(dr.maximum(received[0], received[1]), received[2])
            # 1e-30: the ratios below stay finite for a black material
            return dr.maximum(dr.block_reduce(dr.ReduceOp.Max, largest, _AZIMUTHS), 1e-30)

        k = dr.arange(mi.Int32, _NODES)
        target = dr.select(k <= _AT_HORIZON, mi.Float(_TARGET_AT_HORIZON), _TARGET)
        s = dr.full(mi.Float, 1, _NODES)
        dr.make_opaque(s)
        for _ in range(_STEPS):
            # Halfway, in the logarithm, to what would do if s(w_o) stayed: both directions share the loss.
            s = dr.sqrt(s * dr.minimum(1, target / largest_albedo(s)))
            dr.make_opaque(s)
        # From here s only falls, and with it the albedo of every other direction: the bound is kept.
        s = dr.minimum(s, target / largest_albedo(s))
        # Between two nodes s is between theirs; where the albedo is monotonous there, the smaller one would do.
        low, high = (dr.gather(mi.Float, s, dr.clip(k + d, 0, _NODES - 1)) for d in (-1, 1))
        s = dr.minimum(s, dr.minimum(low, high))
        dr.make_opaque(s)
        return s


def bounded(f, table: mi.Float, wi: mi.Vector3f, wo: mi.Vector3f, params: Mapping):
    """Return reflectance `f`, in any spectrum, times the factors of both directions; see :func:`factor`."""
    return f * (factor(table, wi, params) * factor(table, wo, params))


def factor(table: mi.Float, w: mi.Vector3f, params: Mapping) -> mi.Float:
    """The factor s of a direction, surface frame; `params` as for :func:`mi_enhance.analytic.geometry.frame_of`."""
    return _between(table, mi.Float(dr.detach(geometry.frame_of(params).to_local(w).z)))


def _between(table: mi.Float, cos: mi.Float) -> mi.Float:
    """The table at a cosine to the normal."""
    x = dr.sqrt(dr.sqrt(dr.clip(cos, 0, 1))) * (_NODES - 1)
    k = dr.minimum(mi.UInt32(x), _NODES - 2)
    return dr.lerp(dr.gather(mi.Float, table, k), dr.gather(mi.Float, table, k + 1), x - mi.Float(k))


def _reflected(brdf: EnhancedBRDF, params: Mapping, shares: list) -> tuple[mi.Float, mi.Color3f]:
    """Cosines of drawn directions and f cos / pdf there, views of one azimuth after those of another, node by node."""
    n = _NODES * _AZIMUTHS * _SAMPLES
    k = dr.arange(mi.UInt32, n)
    u = sequences.even_numbers(n, k % _SAMPLES)
    view = k // _SAMPLES
    # 1e-7: node 0 is the horizon itself
    cos = dr.maximum(dr.square(dr.square(mi.Float(view // _AZIMUTHS) / (_NODES - 1))), 1e-7)
    sin, (s, c) = dr.safe_sqrt(1 - cos * cos), dr.sincos(mi.Float(view % _AZIMUTHS) * (dr.two_pi / _AZIMUTHS))
    frame = geometry.frame_of(params)
    wi = frame.to_world(mi.Vector3f(sin * c, sin * s, cos))
    wo, density = albedo.draw(wi, params, shares, u, brdf.model)
    dr.eval(wi, wo, density)  # the networks in a kernel of their own compile faster
    f = mi.Color3f(brdf(wi, wo, params, brdf.evaluators(cooperative.Cooperative)))
    value = albedo.reflected(f, wo, density)
    cos = mi.Float(frame.to_local(wo).z)
    dr.eval(value, cos)
    return cos, value
