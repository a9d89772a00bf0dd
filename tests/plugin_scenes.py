"""Materials, scenes and evaluations that the tests of the plugin share."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np

from mi_enhance.material.material import Material
from mi_enhance.neural.enhance import enhance

# Every parameter away from its default, so that none can be mixed up or left out.
VALUES = {
    "n_x": 0.1, "n_y": -0.05, "t_theta": 0.4, "rho_d": (0.3, 0.2, 0.1), "rho_s": (0.5, 0.8, 1.2),
    "alpha_x": 0.3, "alpha_y": 0.5, "F0": 0.2, "latent": np.linspace(0, 1, 27),
}  # fmt: skip
ROUNDING = 2e-5  # relative: float32, and sums in another order where a texture is in the way
SUMMATION = 1e-5  # relative: threads add the samples of a pixel in any order
SIGNIFICANCE = 0.01  # of all chi-square tests together: the Sidak correction asks the more of each, the more there are
NOISE = 0.01  # of a mean of 3e5 weights
QUADRATURE = 0.005  # of 250,000 stratified directions


def material(**values) -> Material:
    """The paper's state, small: nothing about the plugin depends on how good the networks are, or how large."""
    return Material(enhance("ggx", hidden=(6, 6), seed=1), {**VALUES, **values})


def analytic(**values) -> Material:
    """GGX without networks."""
    return Material.analytic("ggx").edit(**values)


def bitmap(values) -> dict:
    """Texture of the given texels (height, width, channels), without interpolation."""
    data = mi.Bitmap(np.asarray(values, np.float32))
    return {"type": "bitmap", "bitmap": data, "filter_type": "nearest", "raw": not mi.is_spectral}


def scene(shapes, *, resolution=16, spp=64, integrator=None, emitter=None) -> mi.Scene:
    """Objects at the origin, seen along a slanted direction, in a light that is bright on one side."""
    angle = np.linspace(0, 2 * np.pi, 16, endpoint=False)
    sky = 1 + 0.5 * np.cos(np.linspace(0, np.pi, 8))[:, None, None] + 0.4 * np.cos(angle)[None, :, None]
    light = {"type": "envmap", "bitmap": mi.Bitmap((sky * np.array([1, 0.8, 0.6])).astype(np.float32))}
    return mi.load_dict({
        "type": "scene",
        "integrator": integrator or {"type": "path", "max_depth": 3},
        "sensor": {
            "type": "perspective", "fov": 25,
            "to_world": mi.ScalarTransform4f().look_at([0, -3, 5], [0, 0, 0], [0, 1, 0]),
            "sampler": {"type": "independent", "sample_count": spp},
            "film": {
                "type": "hdrfilm", "width": resolution, "height": resolution, "rfilter": {"type": "box"},
                "pixel_format": "luminance" if mi.is_monochromatic else "rgb",
            },
        },
        "light": emitter or light,
        **shapes,
    })  # fmt: skip


def ball(bsdf, **arguments) -> mi.Scene:
    """A sphere with the given BSDF."""
    return scene({"ball": {"type": "sphere", "bsdf": bsdf}}, **arguments)


def hit(wi, uv=(0.5, 0.5)) -> mi.SurfaceInteraction3f:
    """A hit on the plane z = 0, seen from the directions `wi` (N, 3)."""
    si = dr.zeros(mi.SurfaceInteraction3f, len(wi))
    si.wi = vectors(wi)
    si.uv = mi.Point2f(*uv)
    si.sh_frame = mi.Frame3f(mi.Vector3f(0, 0, 1))
    si.dp_du, si.dp_dv = mi.Vector3f(1, 0, 0), mi.Vector3f(0, 1, 0)
    return si


def vectors(w) -> mi.Vector3f:
    """Directions (N, 3) as a Mitsuba array."""
    return mi.Vector3f(np.ascontiguousarray(np.asarray(w, np.float32).T))


def directions(n, seed=0, below=False) -> np.ndarray:
    """Random unit vectors (N, 3), above the horizon unless `below`."""
    w = np.random.default_rng(seed).normal(size=(n, 3))
    w /= np.linalg.norm(w, axis=1, keepdims=True)
    if not below:
        w[:, 2] = np.abs(w[:, 2])
    return w


def evaluate(bsdf, wi, wo, uv=(0.5, 0.5)) -> np.ndarray:
    """``eval`` as an array (N, channels)."""
    return np.array(bsdf.eval(mi.BSDFContext(), hit(wi, uv), vectors(wo))).T


def close(a, b, rel=ROUNDING):
    """Assert equality up to a fraction of the value or of the largest one."""
    np.testing.assert_allclose(a, b, rtol=rel, atol=rel * np.abs(b).max())


def render_attached(material):
    """A small image of a ball, its parameters, all attached, and the keys of those that belong to the material."""
    s = ball({**material.to_dict(), "id": "m"}, integrator={"type": "prb", "max_depth": 3})
    p = mi.traverse(s)
    keys = [k for k in p.keys() if k.rsplit(".", 1)[-1] in material.params]
    assert len(keys) == len(material.params)
    for key in keys:
        dr.enable_grad(p[key])
    p.update()
    return mi.render(s, p, spp=16), p, keys


def view(degrees, azimuth=0.5) -> list[float]:
    """Unit vector at that polar angle."""
    theta = np.deg2rad(degrees)
    return [float(np.sin(theta) * np.cos(azimuth)), float(np.sin(theta) * np.sin(azimuth)), float(np.cos(theta))]


def cells(n_z, n_phi, inside):
    """Midpoints (n_z * n_phi * inside^2, 3) of cells of equal solid angle, those of one cell in a row."""
    z = (np.arange(n_z * inside) + 0.5) / (n_z * inside)
    phi = (np.arange(n_phi * inside) + 0.5) / (n_phi * inside) * 2 * np.pi
    z, phi = (v.reshape(n_z, inside, n_phi, inside).swapaxes(1, 2).ravel() for v in np.meshgrid(z, phi, indexing="ij"))
    r = np.sqrt(1 - z * z)
    return np.stack([r * np.cos(phi), r * np.sin(phi), z], -1)


def albedo_by_sampling(b, wi, n=300_000):
    """Mean weight of `n` samples, (channels,)."""
    u = [mi.Float(v) for v in np.random.default_rng(0).random((3, n)).astype(np.float32)]
    _, weight = b.sample(mi.BSDFContext(), hit(np.tile(wi, (n, 1))), u[0], mi.Point2f(u[1], u[2]))
    return np.array(dr.mean(weight, axis=1)).ravel()
