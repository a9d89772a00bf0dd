"""Which way light goes, and how it is polarized: as Mitsuba's own plugins."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from mi_enhance.bsdfs.function import function_bsdf
from plugin_scenes import ROUNDING, close, directions, evaluate, hit, vectors

from mi_enhance.analytic.models import from_expression
from mi_enhance.material.material import Material
from mi_enhance.neural.enhance import enhance

N = 2000
NOISE = 0.05  # relative, of a mean over 64 pixels: ptracer with 2,048 samples, path with 256
# The diffuse term reads the cosine of the light only, so it tells viewer from light.
ONE_SIDED = """
name = "one_sided"
formula = "M * B + S * D"
[terms]
M = "rho_d / pi"
B = "cos_theta_o ** 2"
S = "rho_s"
D = "cos_theta_i * cos_theta_h ** 9"
[parameters]
rho_d = true
rho_s = true
[[lobes]]
rho_s = "rho_s"
alpha_x = "0.5"
alpha_y = "0.5"
"""


def asymmetric(**values) -> Material:
    """Networks of random weights that see viewer and light."""
    return Material(enhance("ggx2", ["F", "G"], inputs="shape", seed=3), {"asymmetry": 1.5, "rho_s": 2.0, **values})


MATERIALS = {
    "asymmetry": asymmetric,
    "bounded": lambda: asymmetric().bounded(),
    "directions": lambda: Material(enhance("ggx", ["F", "G"], inputs="directions", seed=1), {"n_x": 0.1}),
    "text": lambda: Material(enhance(from_expression(ONE_SIDED), []), {"rho_d": 0.3, "rho_s": 0.2}),
}


def from_light() -> mi.BSDFContext:
    return mi.BSDFContext(mi.TransportMode.Importance)


@pytest.mark.parametrize("name", MATERIALS)
def test_from_the_light_viewer_and_light_are_exchanged(llvm, name):
    """In Importance mode si.wi is the light: f(viewer, light) cos of what is drawn."""
    wi, wo = directions(N), directions(N, seed=1)
    b = MATERIALS[name]().bsdf()
    forward, backward = evaluate(b, wi, wo) / wo[:, 2:], evaluate(b, wo, wi) / wi[:, 2:]
    assert np.abs(forward - backward).max() > 0.02 * forward.max()  # 200 times what is allowed below
    value, pdf = b.eval_pdf(from_light(), hit(wi), vectors(wo))
    close(np.array(value).T, backward * wo[:, 2:], 1e-4)
    np.testing.assert_array_equal(np.array(b.eval(from_light(), hit(wi), vectors(wo))), np.array(value))
    np.testing.assert_array_equal(np.array(b.pdf(from_light(), hit(wi), vectors(wo))), np.array(pdf))


def test_samples_from_the_light_have_the_weight_of_their_value(llvm):
    b, si = asymmetric().bsdf(), hit(directions(N))
    u = np.random.default_rng(0).random((3, N)).astype(np.float32)
    bs, weight = b.sample(from_light(), si, mi.Float(u[0]), mi.Point2f(u[1:]))
    value, pdf = b.eval_pdf(from_light(), si, bs.wo)
    value, pdf, weight = np.array(value).T, np.array(pdf)[:, None], np.array(weight).T
    np.testing.assert_allclose(weight * pdf, value, rtol=1e-4, atol=ROUNDING)


def test_a_function_is_exchanged_too(llvm):
    wi, wo = directions(N), directions(N, seed=1)
    b = function_bsdf(lambda viewer, light: mi.Color3f(viewer.z), Material.analytic("ggx"))
    value = np.array(b.eval(from_light(), hit(wi), vectors(wo))).T
    close(value, np.repeat(wo[:, 2:] ** 2, 3, 1))


def test_ptracer_renders_what_path_renders(llvm):
    t = mi.ScalarTransform4f

    def image(integrator, spp):
        return np.array(
            mi.render(
                mi.load_dict({
                    "type": "scene",
                    "integrator": {"type": integrator, "max_depth": 2, "hide_emitters": True},
                    "sensor": {
                        "type": "perspective", "fov": 20,
                        "to_world": t().look_at([0, 4, 1], [0, 0, 0], [0, 0, 1]),
                        "film": {"type": "hdrfilm", "width": 8, "height": 8, "rfilter": {"type": "box"}},
                    },
                    "floor": {
                        "type": "rectangle", "to_world": t().rotate([1, 0, 0], -90).scale(3),
                        "bsdf": MATERIALS["text"]().to_dict(),
                    },
                    "light": {
                        "type": "rectangle", "to_world": t().look_at([0, 0.6, -4], [0, 0, 0], [0, 1, 0]).scale(0.3),
                        "emitter": {"type": "area", "radiance": {"type": "rgb", "value": 40}},
                    },
                }),
                spp=spp,
            )
        ).mean((0, 1))  # fmt: skip

    np.testing.assert_allclose(image("ptracer", 2048), image("path", 256), rtol=NOISE)


# --- polarization -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("variant", ["llvm_ad_mono_polarized", "llvm_ad_spectral_polarized"])
def test_it_depolarizes(llvm, variant):
    """Of the Mueller matrix only the first entry is not 0, and it is the value of the unpolarized variant."""
    wi, wo = directions(9), directions(9, seed=1)
    mi.set_variant(variant.removesuffix("_polarized"))
    plain = _in_light(Material.analytic("ggx").edit(rho_d=0.3).bsdf(), wi, wo)
    mi.set_variant(variant)
    polarized = _in_light(Material.analytic("ggx").edit(rho_d=0.3).bsdf(), wi, wo)
    for mueller, value in zip(polarized, plain, strict=True):
        for i, j in np.ndindex(4, 4):
            if i or j:
                assert not np.any(np.array(mueller[i, j]))
        np.testing.assert_allclose(np.array(mueller[0, 0]) + 0 * np.array(value), np.array(value), rtol=1e-4)


def _in_light(b, wi, wo):
    si, ctx = hit(wi), mi.BSDFContext()
    if mi.is_spectral:
        si.wavelengths = 550.0
    return (
        b.eval(ctx, si, vectors(wo)),
        b.eval_pdf(ctx, si, vectors(wo))[0],
        b.sample(ctx, si, 0.7, mi.Point2f(0.3, 0.6))[1],
    )


def test_stokes_shows_unpolarized_light(llvm):
    """Of polarized light as of any other: behind the surface S1, S2, S3 are 0."""
    mi.set_variant("llvm_ad_mono_polarized")
    image = np.array(
        mi.render(
            mi.load_dict({
                "type": "scene",
                "integrator": {"type": "stokes", "nested": {"type": "path", "max_depth": 3}},
                "sensor": {
                    "type": "perspective", "fov": 20,
                    "to_world": mi.ScalarTransform4f().look_at([0, 0, 4], [0, 0, 0], [0, 1, 0]),
                    "film": {"type": "hdrfilm", "width": 8, "height": 8},
                },
                "ball": {"type": "sphere", "bsdf": Material.analytic("ggx").to_dict()},
                # a mirror of metal polarizes what it sends to the ball
                "mirror": {
                    "type": "rectangle", "bsdf": {"type": "conductor"},
                    "to_world": mi.ScalarTransform4f().look_at([-2, 0, 0], [0, 0, 0], [0, 1, 0]).scale(2),
                },
                "light": {"type": "constant"},
            }),
            spp=16,
        )
    )  # fmt: skip
    stokes = image[..., -12:].reshape(8, 8, 4, 3)  # S0 to S3, R, G and B of each
    assert stokes[..., 0, :].min() > 0 and np.abs(stokes[..., 1:, :]).max() < 1e-6 * stokes[..., 0, :].max()


def test_polarized_is_one_matrix_for_each_lane(llvm):
    mi.set_variant("llvm_ad_mono_polarized")
    value = Material.analytic("ggx").bsdf().eval(mi.BSDFContext(), hit(directions(5)), vectors(directions(5, seed=1)))
    assert dr.width(value) == 5
