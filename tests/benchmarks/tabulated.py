"""Render what is no BSDF of ours: a reflectance function in a table, sampled like the fitted GGX. For benchmarks only.

The table is MERL's grid, theta_h with square-root spacing (fine near the highlight) and theta_d, and phi_d over the
whole circle, because not every model is reciprocal. Isotropic. It holds log(1 + f), interpolated linearly.

Run as a script it renders a GGX and its table, and prints how far they are apart.
"""

from __future__ import annotations

from collections.abc import Callable

import mi_enhance  # noqa: F401  (first: it finds the LLVM that Dr.Jit then loads)

import drjit as dr  # isort: skip
import common
import mitsuba as mi
import numpy as np
from mi_enhance.bsdfs.function import function_bsdf

from mi_enhance import Material
from mi_enhance.data.directions import rusinkiewicz_to_directions

_SHAPE = (90, 90, 180)  # theta_h, theta_d, phi_d
_COLUMNS = {
    "label": ("table of GGX, alpha", ""),
    "ssim": ("SSIM", ".5f"),
    "delta_E_ITP_1000": ("ΔE ITP x1000", ".3f"),
}


def tabulate(f: Callable) -> np.ndarray:
    """Table of log(1 + f) at the middles of the cells.

    Parameters
    ----------
    f : callable
        ``f(wi, wo) -> array (N, 3)``, f_r in 1/sr, for directions above the horizon.

    Returns
    -------
    array (90, 90, 180, 3), float32
        Cells with a direction below the horizon repeat the last cell above it on the way of theta_d.
    """
    middles = [(np.arange(n) + 0.5) / n for n in _SHAPE]
    theta_h, theta_d, phi_d = np.meshgrid(
        middles[0] ** 2 * np.pi / 2, middles[1] * np.pi / 2, middles[2] * 2 * np.pi, indexing="ij"
    )
    wi, wo = rusinkiewicz_to_directions(theta_h, 0.0, theta_d, phi_d)
    above = np.minimum(wi[..., 2], wo[..., 2]) > 0
    table = np.zeros((*_SHAPE, 3), np.float32)
    table[above] = np.log1p(f(wi[above], wo[above]))
    # At theta_d = 0 both directions are h, so every row starts above the horizon.
    last = np.maximum.accumulate(np.where(above, np.arange(_SHAPE[1])[None, :, None], 0), axis=1)
    return np.take_along_axis(table, last[..., None], axis=1)


def bsdf(table: np.ndarray, lobe: Material) -> mi.BSDF:
    """A BSDF of the active variant.

    Parameters
    ----------
    table : array
        From `tabulate`.
    lobe : Material
        Fitted GGX: directions are drawn from its lobe and the cosine, as `mi_enhance.sampling.importance` does.

    Returns
    -------
    mi.BSDF
    """
    # phi_d closes on itself: one cell more on either side, and no wrapping for the others
    padded = mi.TensorXf(np.concatenate([table[:, :, -1:], table, table[:, :, :1]], 2))
    texture = mi.Texture3f(padded, wrap_mode=dr.WrapMode.Clamp)

    def f(wi, wo):
        return mi.Color3f([dr.exp(v) - 1 for v in texture.eval(_position(wi, wo))])

    return function_bsdf(f, lobe)


def _position(wi, wo) -> mi.Point3f:
    """Place of a pair in the texture: x is its last axis, phi_d."""
    s, e = wi + wo, 0.5 * (wo - wi)  # as mi_enhance.data.directions.half_difference
    r, length = dr.sqrt(s.x * s.x + s.y * s.y), dr.norm(s)
    # where h is the normal, phi_h is 0 by definition
    c, n = dr.select(r > 0, s.x / r, 1), dr.select(r > 0, s.y / r, 0)
    cos_h, sin_h = s.z / length, r / length
    u = c * e.x + n * e.y
    x, y = cos_h * u - sin_h * e.z, c * e.y - n * e.x
    phi = dr.atan2(y, x) / (2 * dr.pi)
    theta_h, theta_d = (dr.atan2(a, b) / (0.5 * dr.pi) for a, b in ((r, s.z), (dr.sqrt(x * x + y * y), 0.5 * length)))
    n_phi = _SHAPE[2]
    return mi.Point3f(((phi - dr.floor(phi)) * n_phi + 1) / (n_phi + 2), theta_d, dr.sqrt(theta_h))


def main() -> None:
    """Run the check of the command line."""
    from common import finish

    from mi_enhance.benchmark.timing import machine
    from mi_enhance.evaluation import image_metrics, scenes

    parser = common.parser(__doc__)
    parser.add_argument("--alpha", type=float, nargs="+", default=[0.05, 0.15, 0.4])
    parser.add_argument("--resolution", type=int, default=256)
    parser.add_argument("--spp", type=int, default=256)
    args = parser.parse_args()
    mi.set_variant("llvm_ad_rgb")
    about, rows = machine(), []
    for alpha in args.alpha:
        ggx = Material.analytic("ggx").edit(rho_d=(0.2, 0.1, 0.05), rho_s=1, F0=0.5, alpha_x=alpha, alpha_y=alpha)
        table = bsdf(tabulate(ggx.evaluate), ggx)
        images = [
            np.array(mi.render(scenes.shader_ball(b, resolution=args.resolution, spp=args.spp)))
            for b in (table, ggx.bsdf())
        ]
        rows.append({"label": f"{alpha:g}", "ssim": image_metrics.ssim(*images)})
        rows[-1]["delta_E_ITP_1000"] = 1000 * image_metrics.delta_E_ITP(*images)
    finish(rows, _COLUMNS, title="A table against what it holds", about=about, as_json=args.json)


if __name__ == "__main__":
    main()
