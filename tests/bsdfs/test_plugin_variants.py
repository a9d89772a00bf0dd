"""The plugin in every variant and mode of Dr.Jit; many materials share one compiled function."""

from __future__ import annotations

import dataclasses

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from plugin_scenes import SUMMATION, VALUES, ball, bitmap, material, scene

import mi_enhance
from mi_enhance.material.material import Material
from mi_enhance.neural.enhance import enhance, with_trunk

LUMINANCE = (0.2126, 0.7152, 0.0722)
# Relative, of a mean over the ball: colours are products of spectra in one variant and of RGB in the other, and
# upsampled bitmaps are read back at three wavelengths.
SPECTRA = 0.03


def picture(bsdf, **arguments):
    return np.array(mi.render(ball(bsdf, **arguments)))


def luminance(image):
    return image @ LUMINANCE if image.shape[2] == 3 else image[..., 0]


def textured():
    texels = {"rho_d": (0.5, 0.3, 0.1), "rho_s": (0.4, 0.7, 0.9), "alpha_x": (0.2,)}
    return {**material().to_dict(), **{k: bitmap(np.reshape(v, (1, 1, -1))) for k, v in texels.items()}}


@pytest.mark.parametrize("variant", ["llvm_ad_mono", "llvm_ad_spectral"])
@pytest.mark.parametrize("make", [lambda: material().to_dict(), textured], ids=["values", "textures"])
def test_variant_renders_what_rgb_renders(llvm, variant, make):
    expected = picture(make(), spp=256)
    mi.set_variant(variant)
    image = picture(make(), spp=256)
    assert image.shape == (16, 16, 1 if mi.is_monochromatic else 3) and np.isfinite(image).all()
    if not mi.is_monochromatic:
        np.testing.assert_allclose(image.mean((0, 1)), expected.mean((0, 1)), rtol=SPECTRA)
    assert luminance(image).mean() == pytest.approx(luminance(expected).mean(), rel=SPECTRA)


@pytest.mark.slow
def test_monochrome_has_gradients_of_colours_and_spectra_say_they_have_none(llvm):
    for variant in ("llvm_ad_mono", "llvm_ad_spectral"):
        mi.set_variant(variant)
        s = ball(material().to_dict(), integrator={"type": "prb", "max_depth": 2})
        p = mi.traverse(s)
        assert p.flags("ball.bsdf.alpha_x") == mi.ParamFlags.Differentiable
        if mi.is_spectral:
            assert p.flags("ball.bsdf.rho_d") == mi.ParamFlags.NonDifferentiable
            continue
        dr.enable_grad(p["ball.bsdf.rho_d"])
        dr.backward(mi.render(s, p))
        gradient = dr.grad(p["ball.bsdf.rho_d"]).numpy().ravel()
        assert gradient[1] > gradient[0] > gradient[2] > 0  # as the luminance


def test_variants_may_be_switched_back_and_forth(llvm):
    first = picture(material().to_dict())
    mi.set_variant("llvm_ad_mono")
    mi.load_dict(material().to_dict())
    mi.set_variant("llvm_ad_rgb")
    np.testing.assert_allclose(picture(material().to_dict()), first, rtol=SUMMATION)


@pytest.mark.parametrize("variant", ["llvm_ad_mono", "llvm_ad_spectral"])
def test_factors_in_rgb_reach_every_variant(llvm, variant):
    """A grey material with a grey factor is as bright as in RGB; with a red one red wavelengths are brighter."""
    brdf = with_trunk("ggx2", hidden=(4, 4, 4))
    read = np.zeros((9, 5))
    read[:3, -1] = np.log(0.5)  # of the diffuse term
    grey = Material(brdf, {"rho_d": 0.6, "rho_s": 0, "read_out": read.ravel()})
    read[:3, -1] = np.log([0.8, 0.4, 0.2])
    red = dataclasses.replace(grey, params={**grey.params, "read_out": read.ravel()})
    mi.set_variant(variant)
    si = dr.zeros(mi.SurfaceInteraction3f)
    si.wi = mi.Vector3f(0, 0, 1)
    if variant == "llvm_ad_spectral":
        si.wavelengths = type(si.wavelengths)(611, 549, 465, 580)
    f = [np.array(m.bsdf().eval(mi.BSDFContext(), si, mi.Vector3f(0, 0.6, 0.8))).ravel() for m in (grey, red)]
    np.testing.assert_allclose(f[0], 0.6 * 0.5 / np.pi * 0.8, rtol=0.02)
    if variant == "llvm_ad_spectral":
        np.testing.assert_allclose(f[1][:3] / f[0][:3], [1.6, 0.8, 0.4], rtol=0.02)
    else:
        luminance = np.array([0.2126, 0.7152, 0.0722]) @ [0.8, 0.4, 0.2]
        np.testing.assert_allclose(f[1] / f[0], luminance / 0.5, rtol=0.02)


def test_scalar_variant_is_refused_with_what_to_do(llvm):
    arrays = material().to_dict()
    mi.set_variant("scalar_rgb")
    try:
        with pytest.raises(
            RuntimeError, match='variant "scalar_rgb" cannot run the networks of "enhanced". Call mi.set'
        ):
            mi.load_dict({"type": "enhanced", "description": arrays["description"]})
    finally:
        mi.set_variant("llvm_ad_rgb")


@pytest.mark.slow
def test_worker_processes_render(run_child):
    child = run_child(
        """
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from mi_enhance.cli.doctor import try_variant
if __name__ == "__main__":
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        jobs = [pool.submit(try_variant, v, "enhanced") for v in ("llvm_ad_rgb", "llvm_ad_mono")]
        print([job.result() for job in jobs])
""",
        DRJIT_LIBLLVM_PATH=mi_enhance.system.llvm.found.path,
    )
    assert child.stdout.strip().endswith("[None, None]"), child.stderr


# --- modes of Dr.Jit --------------------------------------------------------------------------------------------------


def test_without_symbolic_loops_and_calls_the_image_is_the_same(llvm):
    s = ball(material().to_dict(), spp=16)
    symbolic = np.array(mi.render(s))
    with dr.scoped_set_flag(dr.JitFlag.SymbolicLoops, False), dr.scoped_set_flag(dr.JitFlag.SymbolicCalls, False):
        wavefront = np.array(mi.render(s))
    np.testing.assert_allclose(wavefront, symbolic, rtol=1e-4)


def test_frozen_render_sees_updated_parameters(llvm, no_collection):
    s = ball(material().to_dict(), spp=16)
    p = mi.traverse(s)
    frozen = dr.freeze(lambda s: mi.render(s, seed=0))
    for alpha, latent in ((0.3, 0.5), (0.1, 0.5), (0.6, 0.2), (0.2, 0.9)):
        p["ball.bsdf.alpha_x"] = mi.Float(alpha)
        p["ball.bsdf.latent"] = mi.Float([latent] * 27)
        p["ball.bsdf.rho_d"] = mi.Color3f(alpha)
        p.update()
        np.testing.assert_allclose(np.array(frozen(s)), np.array(mi.render(s, seed=0)), rtol=SUMMATION)
    assert frozen.n_recordings <= 2  # what changed is data; Mitsuba's own plugins take two as well


# --- many materials ---------------------------------------------------------------------------------------------------


def spheres(n_materials):
    """Twenty spheres that fill the picture and share so many materials."""
    materials = {
        f"m{k}": material(rho_d=k / 20, alpha_x=0.1 + 0.02 * k, latent=np.full(27, k / 20)).to_dict()
        for k in range(n_materials)
    }
    shapes = {}
    for k in range(20):
        center = [k % 5 - 2.0, k // 5 - 1.5, 0.0]
        ref = {"type": "ref", "id": f"m{k % n_materials}"}
        shapes[f"s{k}"] = {"type": "sphere", "center": center, "radius": 0.5, "bsdf": ref}
    return scene({**materials, **shapes}, resolution=32)


def largest_kernel(s):
    """Operations of the largest kernel of a render, and the median time it runs in milliseconds."""
    runs = []
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        for _ in range(5):
            dr.kernel_history_clear()
            np.array(mi.render(s))
            runs.append(
                max((k["operation_count"], k["execution_time"]) for k in dr.kernel_history((dr.KernelType.JIT,)))
            )
    return runs[0][0], np.median([seconds for _, seconds in runs])


def test_materials_of_one_network_share_their_compiled_functions(llvm):
    (few, time_few), (many, time_many) = (largest_kernel(spheres(n)) for n in (2, 20))
    assert few > 1000  # the networks are in there
    assert many < 1.02 * few
    assert time_many < 3 * time_few  # loosely: the machine has other work


def test_material_of_another_network_is_a_function_of_its_own(llvm):
    """Else the test above would show nothing."""
    other = Material(enhance("ggx", hidden=(6, 6), seed=2), VALUES).to_dict()
    shapes = {f"s{k}": {"type": "sphere", "bsdf": b} for k, b in enumerate((material().to_dict(), other))}
    one = largest_kernel(ball(material().to_dict()))[0]  # a scene that lives on would be compiled into the next kernel
    two = largest_kernel(scene(shapes))[0]
    assert two - one > 1000  # the other networks are in there; what lives on from an earlier test counts in both
