"""The samples of a written file follow its density, which is the material's."""

from __future__ import annotations

import types

import browser
import drjit as dr
import materials
import mitsuba as mi
import numpy as np
import pytest
from any_material import pairs
from materials import KINDS

from mi_enhance import Material
from mi_enhance.evaluation.chi_square import chi_square
from mi_enhance.export import shaders
from mi_enhance.export.program import record

VIEWS = ([0, 0, 1], [0.5, 0.1, 0.86], [-0.3, 0.94, 0.17])


def chi_square_of(material, sample, pdf, wi, test_count):
    """Mitsuba's chi-square test of two functions of arrays."""

    def drawn(ctx, si, u, v):
        points = np.array([u, v.x, v.y], np.float32).T
        wo = np.asarray(sample(np.broadcast_to(np.float32(wi), points.shape), points))
        bs = dr.zeros(mi.BSDFSample3f, len(wo))
        bs.wo = mi.Vector3f(np.ascontiguousarray(wo.T))
        bs.pdf = density(ctx, si, bs.wo)
        return bs, None

    def density(ctx, si, wo):
        light = np.array(wo, np.float32).T
        return mi.Float(np.ascontiguousarray(pdf(np.broadcast_to(np.float32(wi), light.shape), light), np.float32))

    plugin = types.SimpleNamespace(sample=drawn, pdf=density)
    params = material.as_drjit()
    dr.make_opaque(params)
    return chi_square(plugin, wi, params, material.brdf.model, test_count=test_count, n=50_000)


def unit(w):
    return np.array(w) / np.linalg.norm(w)


@pytest.mark.parametrize("wi", VIEWS)
@pytest.mark.parametrize("kind", ["ggx2", "cook_torrance", "mixture", "edited"])
def test_samples_follow_their_density(llvm, kind, wi):
    material = KINDS[kind]().edit(**{"n_x": 0.1} if kind != "edited" else {})
    written = materials.module(material)
    result = chi_square_of(material, written.sample, written.pdf, unit(wi), 12)
    assert result["passed"], result["message"]
    assert result["normalization"] == pytest.approx(1, abs=0.02)  # 50,000 samples: 0.5 %, and the cells at the rim


@pytest.mark.parametrize("kind", ["ggx", "abc", "mixture", "edited", "specialized"])
def test_the_density_is_that_of_the_plugin(llvm, kind):
    material = KINDS[kind]()
    wi, wo = pairs(2000)
    si = dr.zeros(mi.SurfaceInteraction3f, len(wi))
    si.wi = mi.Vector3f(np.ascontiguousarray(wi.T))
    light = mi.Vector3f(np.ascontiguousarray(wo.T))
    reference = np.array(material.bsdf().pdf(mi.BSDFContext(), si, light))
    assert materials.module(material).pdf(wi, wo) == pytest.approx(reference, rel=1e-3, abs=1e-6)


@pytest.mark.slow
@browser.needs_chromium
@pytest.mark.parametrize("kind", ["ggx2", "mixture"])
def test_samples_of_the_shader_follow_its_density(llvm, kind):
    """What the density is in a browser is compared in test_browser.py."""
    material, wi = KINDS[kind](), unit([0.5, 0.1, 0.86])
    text = shaders.source(record(material), "it")
    job = {"source": browser.fragment(text, "vec4(it_sample(m, a, b), 0)", "it", uniform=False), "uniforms": [{}]}
    sample = lambda a, b: browser.run([job], a, b)[0, :, :3]  # noqa: E731
    result = chi_square_of(material, sample, materials.module(material).pdf, wi, 2)
    assert result["passed"], result["message"]


def test_a_sample_may_leave_below_the_horizon_and_weighs_nothing_there(llvm):
    written = materials.module(Material.analytic("ggx").edit(alpha_x=0.8, alpha_y=0.8, rho_d=0, rho_s=1))
    u = np.random.default_rng(0).random((5000, 3)).astype(np.float32)
    wi = np.tile(np.float32(unit([0.98, 0, 0.2])), (len(u), 1))
    wo = written.sample(wi, u)
    below = wo[:, 2] <= 0
    assert below.any()
    assert not written.pdf(wi, wo)[below].any()
    assert not written.evaluate(wi, wo)[below].any()
    assert np.linalg.norm(wo, axis=1) == pytest.approx(1, abs=1e-5)
