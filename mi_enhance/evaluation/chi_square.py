"""Do samples follow their density? Mitsuba's chi-square test, over cells that are shaped like the narrowest lobe."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from ..analytic import geometry
from ..analytic.models.model import Model

SIGNIFICANCE = 0.01  # of all tests of a run together
_SAMPLES = 200_000
_CELLS = 101  # along either coordinate; odd, as Mitsuba's default
_INSIDE = 16  # points along either side of a cell: the horizon cuts through cells, where the density jumps
_CORE = 4.0  # half of the cells (in radius) lie within four widths of the lobe


class LobeDomain:
    """Half vectors as azimuth and warped distance in units of a lobe's roughness: a domain for ``mi.chi2``.

    Cells are as small as the lobe where it is, even if it is a thousandth of a radian wide in one direction only, and
    still cover the hemisphere.
    """

    def __init__(self, wi: mi.Vector3f, frame: mi.Frame3f, alpha_x: float, alpha_y: float):
        self.wi, self.frame, self.alpha = wi, frame, (alpha_x, alpha_y)

    def bounds(self):
        return mi.ScalarBoundingBox2f(mi.ScalarPoint2f(-np.pi, 0), mi.ScalarPoint2f(np.pi, 1))

    def aspect(self):
        return 1

    def _half(self, p: mi.Point2f) -> tuple[mi.Vector3f, Any, Any]:
        """Half vector in the material's frame, the distance it stands for, and the cosine of wi to it."""
        v = dr.minimum(p.y, 1 - 1e-6)  # the rim, a half vector on the horizon, is infinitely far
        s = _CORE * v / (1 - v)
        sin, cos = dr.sincos(p.x)
        h = dr.normalize(mi.Vector3f(self.alpha[0] * s * cos, self.alpha[1] * s * sin, 1))
        return h, s, dr.dot(self.frame.to_local(self.wi), h)

    def map_forward(self, p):
        h, _, cos = self._half(p)
        return self.frame.to_world(2 * cos * h - self.frame.to_local(self.wi))

    def map_backward(self, w):
        # 1e-20: wi = -wo has no half vector; such a sample has no weight, but lies in the domain
        total = self.frame.to_local(self.wi + w)
        h = total * dr.rsqrt(dr.maximum(dr.squared_norm(total), 1e-20))
        x, y = (v / (a * dr.maximum(h.z, 1e-7)) for v, a in zip((h.x, h.y), self.alpha, strict=True))
        s = dr.sqrt(x * x + y * y)
        return mi.Point2f(dr.atan2(y, x), s / (s + _CORE))

    def density(self, pdf):
        """`pdf` per solid angle of the direction as one per unit of the domain."""

        def result(w):
            h, s, cos = self._half(self.map_backward(w))
            # d wo = 4 cos d h, d h = h_z^3 d slope, d slope = alpha_x alpha_y s ds dpsi, s = _CORE v / (1 - v)
            area = 4 * dr.maximum(cos, 0) * h.z * h.z * h.z * self.alpha[0] * self.alpha[1] * s
            return pdf(w) * area * dr.square(s + _CORE) / _CORE

        return result


def chi_square(
    bsdf: mi.BSDF,
    wi: Sequence[float] | np.ndarray,
    params: Mapping[str, Any],
    model: Model,
    *,
    test_count: int,
    n: int = _SAMPLES,
    seed: int = 0,
) -> dict | None:
    """Pearson's chi-square test of a BSDF's samples against its density.

    Parameters
    ----------
    bsdf : mi.BSDF
    wi : array (3,)
        Direction towards the viewer.
    params : dict
        Parameters of the material; reads the frame and the lobes' roughness, which shape the cells.
    model : Model
    test_count : int
        Tests of the run: each is held to 1 - (1 - 0.01)^(1 / test_count), so that all of them together fail by chance
        in one run of a hundred (Sidak's correction).
    n : int
        Samples.
    seed : int

    Returns
    -------
    dict or None
        ``passed``, ``p_value``, ``normalization`` (the integral of the density over the share of samples above the
        horizon), ``message``; None where the view is below the horizon of a tilted normal and nothing is sampled.

    Examples
    --------
    >>> from mi_enhance import Material
    >>> m = Material.analytic("ggx")
    >>> chi_square(m.bsdf(), [0, 0, 1], m.as_drjit(), m.brdf.model, test_count=1)["passed"]
    True
    """
    view = mi.Vector3f(*map(float, wi))
    if not geometry.frame_of(params).to_local(view).z[0] > 0:
        return None
    context = mi.BSDFContext()

    def hit(count):
        si = dr.zeros(mi.SurfaceInteraction3f, count)
        si.wi = view
        return si

    def sample(u):
        bs, _ = bsdf.sample(context, hit(dr.width(u)), u[0], mi.Point2f(u[1], u[2]))
        return bs.wo, dr.select(bs.pdf > 0, mi.Float(1), 0)

    lobes = [[float(a[0]) for a in alpha] for _, *alpha in model.lobes(params)] or [[1.0, 1.0]]
    domain = LobeDomain(view, geometry.frame_of(params), *min(lobes, key=min))
    pdf = domain.density(lambda w: bsdf.pdf(context, hit(dr.width(w)), w))
    test = mi.chi2.ChiSquareTest(domain, sample, pdf, 3, n, _CELLS, _INSIDE, seed)
    passed = test.run(SIGNIFICANCE, test_count=test_count, quiet=True)
    return {
        "passed": bool(passed),
        "p_value": float(test.p_value or 0),
        "normalization": float(test.pdf_sum[0] / test.histogram_sum[0]),
        "message": test.messages.strip().replace("\n", " "),
    }
