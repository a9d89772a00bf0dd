"""The plugin with ggx2 and networks that see shapes: sampling, edits, textures and gradients."""

from __future__ import annotations

import dataclasses

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
import twin
import twin_networks
from plugin_scenes import (
    NOISE,
    QUADRATURE,
    SIGNIFICANCE,
    albedo_by_sampling,
    ball,
    bitmap,
    cells,
    close,
    directions,
    evaluate,
    hit,
    vectors,
    view,
)

from mi_enhance.data.directions import sample_pairs
from mi_enhance.data.measurements import Measurements
from mi_enhance.fitting.fit import fit
from mi_enhance.material.material import Material
from mi_enhance.neural import mlp
from mi_enhance.neural.enhance import enhance
from mi_enhance.sampling import albedo
from mi_enhance.training.imitation import imitate


def random_networks():
    """Small random weights: nothing about sampling depends on how good the networks are."""
    b = enhance("ggx2", ("B", "G", "G2"), inputs="shape", modulated=True, n_latent=4, hidden=(8, 8), seed=1)
    b = dataclasses.replace(b, modules=mlp.unflatten(b.modules, 0.3 * mlp.flatten(b.modules)))
    p = {k: v[0] for k, v in twin_networks.parameters(b, 1, seed=2).items()}
    frame = {"n_x": 0.1, "n_y": -0.05, "t_theta": 0.7, "alpha_x": 0.1, "alpha_y": 0.3, "alpha_x2": 0.5, "alpha_y2": 0.6}
    m = Material(b, {**p, **frame, "rho_d": (0.3, 0.2, 0.1), "rho_s": (0.5, 0.4, 0.2), "rho_s2": 0.3, "F0": 0.3})
    return dataclasses.replace(m, lobe_albedo=albedo.lobe_albedo(m.brdf, m.as_drjit()))


def fitted_networks():
    """A few steps of imitation, then fitted to two GGX whose reflectance falls towards grazing angles."""
    b = enhance("ggx2", ("B", "G", "G2"), inputs="shape", modulated=True, n_latent=4, hidden=(8, 8), seed=1)
    truth = {"n_x": [0], "n_y": [0], "t_theta": [0.4], "F0": [0.3], "rho_d": [0.3, 0.2, 0.1]}
    truth |= {"rho_s": [0.3, 0.3, 0.3], "rho_s2": [0.2, 0.4, 0.6]}
    truth |= {"alpha_x": [0.15], "alpha_y": [0.1], "alpha_x2": [0.4], "alpha_y2": [0.6]}
    wi, wo = sample_pairs(2000, seed=3)
    f = twin.analytic("ggx2", wi, wo, truth) * (0.5 + 0.5 * (wi[:, 2:] * wo[:, 2:]) ** 0.5)
    return fit(Material(imitate(b, steps=200, batch=1024), {}), Measurements(wi, wo, f, "two lobes", "test"))


@pytest.fixture(scope="module")
def materials():
    mi.set_variant("llvm_ad_rgb")
    return {"random": random_networks(), "fitted": fitted_networks()}


def test_networks_are_fitted_to_two_lobes(llvm, materials):
    """They start where the analytic fit ends, and untrained ones still say a little that it cannot."""
    report = materials["fitted"].report
    assert report["log_l1"] < report["log_l1_analytic"] < 0.02
    assert report["model"] == "M * [B] + S * D * F * [G] * 1/E + S2 * D2 * F2 * [G2] * 1/E2"


@pytest.mark.parametrize("degrees", [0, 40, 85])
@pytest.mark.parametrize("name", ["random", "fitted"])
def test_samples_of_the_plugin_follow_the_density(llvm, materials, name, degrees, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # a failing test writes its histograms
    sample, pdf = mi.chi2.BSDFAdapter("enhanced", materials[name].to_dict(), wi=view(degrees))
    test = mi.chi2.ChiSquareTest(mi.chi2.SphericalDomain(), sample, pdf, sample_dim=3, sample_count=400_000, ires=8)
    assert test.run(SIGNIFICANCE, test_count=6, quiet=True), test.messages


@pytest.mark.parametrize("degrees", [20, 70])
@pytest.mark.parametrize("name", ["random", "fitted"])
def test_mean_weight_of_the_plugin_is_the_albedo(llvm, materials, name, degrees):
    """Midpoints uniform in the cosine: a random G does not fall at grazing angles, where f alone has no bound.

    Nor has f cos beside the horizon of a tilted normal, so it is not tilted here.
    """
    b, wo = materials[name].edit(n_x=0, n_y=0).bsdf(), cells(1, 1, 700)
    value = np.array(b.eval(mi.BSDFContext(), hit(np.tile(view(degrees), (len(wo), 1))), vectors(wo)))
    np.testing.assert_allclose(albedo_by_sampling(b, view(degrees)), value.mean(1) * 2 * np.pi, rtol=NOISE + QUADRATURE)


@pytest.mark.parametrize("name", ["random", "fitted"])
def test_plugin_evaluates_the_material(llvm, materials, name):
    wi, wo = directions(1000), directions(1000, seed=1)
    close(evaluate(materials[name].bsdf(), wi, wo), materials[name].evaluate(wi, wo) * wo[:, 2:])


EDITS = {"rho_s2": 0.7, "alpha_x2": 0.2, "alpha_y2": 0.8, "asymmetry": -1.0, "rho_d": 0.1}


@pytest.mark.parametrize("name", EDITS)
def test_scene_and_texture_edit_what_the_file_says(llvm, materials, name):
    """A number, and a texture of that number, in place of the material's own."""
    m, value = materials["random"], EDITS[name]
    wi, wo = twin.pairs(300, seed=1, min_cos=0.2)  # above the horizon of the tilted normal
    expected = m.edit(**{name: value}).evaluate(wi, wo) * wo[:, 2:]
    given = {"type": "rgb", "value": [value] * 3} if name.startswith("rho") else value
    close(evaluate(mi.load_dict({**m.to_dict(), name: given}), wi, wo), expected)
    assert np.abs(expected / (m.evaluate(wi, wo) * wo[:, 2:]) - 1).max() > 1e-3  # rounding is 2e-5
    channels = 3 if name.startswith("rho") else 1
    texture = bitmap(np.full((2, 2, channels), value))
    close(evaluate(mi.load_dict({**m.to_dict(), name: texture}), wi, wo), expected)


def test_asymmetry_of_a_rendered_material(llvm, materials):
    """Exchanging viewer and light does nothing at 0, and does something elsewhere."""
    wi, wo = twin.pairs(1000, seed=1, min_cos=0.2)
    f = lambda m, a, b: evaluate(m.bsdf(), a, b) / b[:, 2:]  # noqa: E731
    for asymmetry in (0.0, 1.5):
        m = materials["random"].edit(asymmetry=asymmetry)
        difference = np.abs(f(m, wi, wo) / f(m, wo, wi) - 1)
        assert difference.max() < 1e-4 if asymmetry == 0 else np.median(difference) > 1e-3


def test_gradient_of_every_parameter_through_a_render(llvm, materials):
    m = materials["random"]
    s = ball({**m.to_dict(), "id": "m"}, integrator={"type": "prb", "max_depth": 3})
    p = mi.traverse(s)
    keys = [k for k in p.keys() if k.rsplit(".", 1)[-1] in m.params]
    assert len(keys) == len(m.params) == 16
    for key in keys:
        dr.enable_grad(p[key])
    p.update()
    image = mi.render(s, p, spp=16)
    dr.backward(dr.mean(dr.square(image), axis=None))
    for key in keys:
        gradient = np.array(dr.grad(p[key]))
        assert np.isfinite(gradient).all() and np.abs(gradient).max() > 0, key
