"""Values from outside are held in range, with gradients; parameters without effect; textures without texels."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from plugin_scenes import analytic, ball, bitmap, close, directions, evaluate, hit, vectors

from mi_enhance import models
from mi_enhance.material.material import Material
from mi_enhance.neural.enhance import enhance
from mi_enhance.system import bundled_files

N = 500


def network(**values) -> Material:
    """Networks of random weights, with every kind of parameter."""
    return Material(enhance("ggx2", ["F", "G2"], inputs="shape", seed=3), {"asymmetry": 0.5, "rho_s2": 0.5, **values})


def own(**values) -> Material:
    """A network of the difference angle, to which `asymmetry` means nothing."""
    return Material(enhance("ggx", ["F"], inputs="own", seed=3), values)


MATERIALS = {**{name: lambda name=name: Material.analytic(name) for name in models.MODELS}, "network": network}


# --- range ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", MATERIALS)
def test_value_out_of_range_counts_as_the_bound(llvm, name):
    """However far out, for every parameter, by ``mi.traverse``: in eval, density and samples."""
    m = MATERIALS[name]()
    wi, wo = directions(N), directions(N, seed=1)
    for p in m.brdf.parameters:
        for bound, value in ((p.low, p.low - 1), (p.low, -1e6), (p.high, 2 * p.high + 1)):
            b = m.bsdf()
            params = mi.traverse(b)
            params[p.name] = type(params[p.name])([value] * p.size if p.name == "latent" else value)
            params.update()
            expected = m.edit(**{p.name: bound}).bsdf()
            close(evaluate(b, wi, wo), evaluate(expected, wi, wo))
            pdf = np.array(b.pdf(mi.BSDFContext(), hit(wi), vectors(wo)))
            assert np.isfinite(pdf).all() and (pdf >= 0).all()
            if not p.is_colour:  # a lobe of colour 0 is left out, one held at 0 is drawn at least
                close(pdf, np.array(expected.pdf(mi.BSDFContext(), hit(wi), vectors(wo))))


@pytest.mark.parametrize("variant", ["llvm_ad_mono", "llvm_ad_spectral"])
def test_colours_are_held_in_other_variants_too(llvm, variant):
    mi.set_variant(variant)
    wi = directions(N)
    for colour in (-0.5, mi.load_dict(bitmap(np.full((1, 1, 1 if mi.is_monochromatic else 3), -0.5)))):
        b = mi.load_dict({**analytic(rho_s=0.0).to_dict(), **({} if isinstance(colour, float) else {"rho_d": colour})})
        params = mi.traverse(b)
        if isinstance(colour, float):
            params["rho_d"] = mi.Color3f(colour)
            params.update()
        si = hit(wi)
        if mi.is_spectral:
            si.wavelengths = 550.0
        assert not np.array(b.eval(mi.BSDFContext(), si, vectors(directions(N, seed=1)))).any()


@pytest.mark.parametrize("textured", [False, True], ids=["value", "texture"])
def test_gradient_outside_is_that_at_the_bound(llvm, textured):
    """So that an optimizer that has stepped out comes back."""
    wi, wo = directions(N), directions(N, seed=1)

    def gradient(value):
        given = {"F0": bitmap([[[value]]])} if textured else {}
        b = mi.load_dict({**analytic().to_dict(), **given})
        params, key = mi.traverse(b), "F0.data" if textured else "F0"
        if not textured:
            params[key] = mi.Float(value)
        dr.enable_grad(params[key])
        params.update()
        dr.backward(dr.mean(b.eval(mi.BSDFContext(), hit(wi), vectors(wo)), axis=None))
        return np.array(dr.grad(params[key])).sum()

    at = gradient(1e-9)
    assert at > 0
    np.testing.assert_allclose(gradient(-0.5), at, rtol=1e-4)


def test_an_optimizer_comes_back_from_beyond_the_bound(llvm):
    """The step is too large at first: F0 leaves its range, and ends where it is sought."""
    wi, wo, ctx = hit(directions(N)), vectors(directions(N, seed=1)), mi.BSDFContext()
    b = analytic(F0=0.5, rho_s=10.0).bsdf()
    target = dr.opaque(mi.Color3f, 0) + analytic(F0=0.1, rho_s=10.0).bsdf().eval(ctx, wi, wo)
    params = mi.traverse(b)
    optimizer = mi.ad.Adam(lr=0.4)
    optimizer["F0"] = params["F0"]
    params.update(optimizer)
    seen = []
    for k in range(60):
        dr.backward(dr.mean(dr.square(b.eval(ctx, wi, wo) - target), axis=None))
        optimizer.set_learning_rate(0.4 * 0.9**k)
        optimizer.step()
        params.update(optimizer)
        seen.append(float(params["F0"][0]))
    assert min(seen) < 0 and abs(seen[-1] - 0.1) < 0.02


# --- without effect ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("integrator", ["prb", "prb_basic", "direct_projective", "prb_projective"])
def test_parameter_without_effect_has_the_gradient_0_in_every_integrator(llvm, integrator):
    gradient = _gradients(analytic(rho_s=0.0), ["alpha_x", "F0", "t_theta"], integrator)
    assert all(not g.any() for g in gradient.values())


CASES = {
    **{
        name: (lambda name=name: _black(name), None)
        for name in models.MODELS
        if name not in ("abc", "ashikhmin_shirley")
    },
    "ashikhmin_shirley": (lambda: _black("ashikhmin_shirley"), ["n_u", "n_v"]),  # F0 darkens the diffuse term
    "flat diffuse": (lambda: analytic(rho_s=0.0), ["t_theta"]),
    "no second lobe": (lambda: network(rho_s2=0.0), ["norm_G2"]),
    "own": (own, ["asymmetry"]),
    "black": (lambda: analytic(rho_s=0.0, rho_d=0.0), ["alpha_x", "F0"]),
}


def _black(name) -> Material:
    """A model whose lobes have the colour 0."""
    m = Material.analytic(name)
    return m.edit(**{p.name: 0.0 for p in m.brdf.parameters if p.is_colour and p.name != "rho_d"})


@pytest.mark.parametrize("name", CASES)
def test_parameter_without_effect_has_the_gradient_0(llvm, name):
    make, names = CASES[name]
    m = make()
    lobe = [p.name for p in m.brdf.parameters if not p.is_colour and p.name not in ("n_x", "n_y")]
    for key, g in _gradients(m, names or lobe).items():
        assert not g.any(), key


def test_textured_parameter_without_effect_has_the_gradient_0(llvm):
    bsdf = {**analytic(rho_s=0.0).to_dict(), "alpha_x": bitmap(np.full((2, 2, 1), 0.3))}
    assert not _gradients(bsdf, ["alpha_x.data"])["alpha_x.data"].any()


def _gradients(bsdf, names, integrator="prb") -> dict[str, np.ndarray]:
    bsdf = bsdf if isinstance(bsdf, dict) else bsdf.to_dict()
    scene = ball(bsdf, resolution=8, integrator={"type": integrator, "max_depth": 2}, emitter={"type": "constant"})
    params = mi.traverse(scene)
    for name in names:
        dr.enable_grad(params[f"ball.bsdf.{name}"])
    params.update()
    dr.backward(dr.mean(mi.render(scene, params, spp=4), axis=None))
    return {name: np.array(dr.grad(params[f"ball.bsdf.{name}"])) for name in names}


# --- textures ---------------------------------------------------------------------------------------------------------


def test_one_texture_under_two_names_is_one_parameter(llvm):
    rough = mi.load_dict(bitmap(np.full((2, 2, 1), 0.3)))
    b = mi.load_dict({**analytic().to_dict(), "alpha_x": rough, "alpha_y": rough})
    params = mi.traverse(b)
    assert [key for key in params.keys() if key.endswith(".data")] == ["alpha_x.data"]
    assert b.textures["alpha_x"] is b.textures["alpha_y"]
    params["alpha_x.data"] = mi.TensorXf(np.full((2, 2, 1), 0.6, np.float32))
    params.update()
    wi, wo = directions(N), directions(N, seed=1)
    close(evaluate(b, wi, wo), evaluate(analytic(alpha_x=0.6, alpha_y=0.6).bsdf(), wi, wo))


TEXTURES = {
    "checkerboard": (
        {"type": "checkerboard", **{f"color{k}": {"type": "uniform", "value": v} for k, v in enumerate((0.3, 0.7))}},
        ("color0.value", "color1.value"),
    ),
    "uniform": ({"type": "uniform", "value": 0.3}, ("value",)),
    "spectrum": ({"type": "spectrum", "value": 0.3}, ("value",)),
}


@pytest.mark.parametrize("name", ["rho_d", "F0"])
@pytest.mark.parametrize("kind", TEXTURES)
def test_textures_without_texels_are_parameters(llvm, name, kind):
    """Changed by ``mi.traverse``, and with gradients."""
    texture, keys = TEXTURES[kind]
    if kind == "spectrum" and name == "F0":
        texture = {"type": "uniform", "value": 0.3}
    b = mi.load_dict({**analytic().to_dict(), name: texture})
    wi, wo = directions(N), directions(N, seed=1)
    params = mi.traverse(b)
    for key in keys:
        params[f"{name}.{key}"] = mi.Float(0.6)
        dr.enable_grad(params[f"{name}.{key}"])
    params.update()
    close(evaluate(b, wi, wo), evaluate(analytic(**{name: 0.6}).bsdf(), wi, wo))
    dr.backward(dr.mean(b.eval(mi.BSDFContext(), hit(wi), vectors(wo)), axis=None))
    assert sum(float(dr.grad(params[f"{name}.{key}"])[0]) for key in keys) > 0


def test_another_value_is_no_other_kernel(llvm):
    """An edit changes data, not code: else a process that edits for hours collects kernels, in memory and on disk."""
    bsdf = mi.load_dict({"type": "enhanced", "filename": str(bundled_files.network_file("ggx"))})
    params, kernels = mi.traverse(bsdf), []
    for red in (0.1, 0.2, 0.3):
        with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
            params["rho_d"], params["alpha_x"] = mi.Color3f(red, 0.2, 0.3), mi.Float(red)
            params.update()
            kernels.append({str(entry["hash"]) for entry in dr.kernel_history() if "hash" in entry})
    assert kernels[0] and kernels[2] <= kernels[0] | kernels[1]
