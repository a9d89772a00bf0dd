"""Sampling of the plugin: the samples follow the density, the weights are eval over pdf, no energy is made."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from plugin_scenes import (
    NOISE,
    QUADRATURE,
    SIGNIFICANCE,
    albedo_by_sampling,
    analytic,
    directions,
    hit,
    material,
    vectors,
    view,
)

from mi_enhance import models
from mi_enhance.evaluation.chi_square import chi_square
from mi_enhance.material.material import Material

ROUNDING = 1e-4  # relative: near-mirror densities amplify the rounding of the half vector

MATERIALS = {
    "default": {"n_x": 0, "n_y": 0, "t_theta": 0, "alpha_x": 0.2, "alpha_y": 0.2},
    "anisotropic, rotated, tilted": {"n_x": 0.2, "n_y": -0.1, "t_theta": 0.7, "alpha_x": 0.1, "alpha_y": 0.4},
    "near-mirror": {"n_x": 0, "n_y": 0, "rho_d": 0, "rho_s": 1, "alpha_x": 0.02, "alpha_y": 0.02},
    "diffuse": {"n_x": 0.1, "rho_d": 0.9, "rho_s": 0.05, "alpha_x": 0.5, "alpha_y": 0.5},
    "roughest": {"n_x": -0.05, "n_y": 0.1, "alpha_x": 1, "alpha_y": 1},
}
ANGLES = (0, 40, 85)  # degrees
OTHERS = {
    "cook_torrance": {"n_x": 0.2, "n_y": -0.1, "t_theta": 0.7, "alpha_x": 0.15, "alpha_y": 0.5, "F0": 0.5},
    "cook_torrance, roughest": {"alpha_x": 1.0, "alpha_y": 1.0, "F0": 1.0},
    "ward": {"n_x": 0.2, "n_y": -0.1, "t_theta": 0.7, "alpha_x": 0.1, "alpha_y": 0.4},
    "abc": {"A": (5.0, 3.0, 2.0), "B": 200.0, "C": 1.2},
    "abc, wide tails": {"A": (1.0, 0.5, 0.4), "B": 5e3, "C": 0.5, "ior": 8.0},
    "ashikhmin_shirley": {"n_x": 0.2, "n_y": -0.1, "t_theta": 0.7, "n_u": 200.0, "n_v": 10.0, "F0": 0.5},
    "ashikhmin_shirley, roughest": {"n_u": 1.0, "n_v": 1.0},
}


def other(name, **values):
    """An analytic material that is not GGX."""
    return Material.analytic(name.split(",")[0]).edit(**{"rho_d": 0.2, **OTHERS[name], **values})


class LobeDomain:
    """Azimuth and warped polar angle about an axis: cells as small as a near-mirror lobe where there is one."""

    def __init__(self, axis, width):
        self.frame, self.width = mi.Frame3f(mi.Vector3f(axis)), width

    def bounds(self):
        return mi.ScalarBoundingBox2f([-np.pi, 0], [np.pi, np.pi / (np.pi + self.width)])

    def aspect(self):
        return 1

    def _angle(self, v):
        return self.width * v / (1 - v)

    def map_forward(self, p):
        s, c = dr.sincos(self._angle(p.y))
        return self.frame.to_world(mi.Vector3f(s * dr.cos(p.x), s * dr.sin(p.x), c))

    def map_backward(self, w):
        w = self.frame.to_local(w)
        angle = dr.atan2(dr.sqrt(w.x * w.x + w.y * w.y), w.z)
        return mi.Point2f(dr.atan2(w.y, w.x), angle / (angle + self.width))

    def density(self, pdf):
        """`pdf` per solid angle as one per unit of the domain."""

        def result(w, *args):
            v = self.map_backward(w).y
            return pdf(w, *args) * dr.sin(self._angle(v)) * self.width / dr.square(1 - v)

        return result


@pytest.mark.parametrize("degrees", ANGLES)
@pytest.mark.parametrize("name", MATERIALS)
def test_samples_follow_the_density(llvm, name, degrees, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # a failing test writes its histograms
    sample, pdf = mi.chi2.BSDFAdapter("enhanced", material(**MATERIALS[name]).to_dict(), wi=view(degrees))
    domain = mi.chi2.SphericalDomain()
    if name == "near-mirror":
        domain = LobeDomain(np.multiply(view(degrees), (-1, -1, 1)), 4 * MATERIALS[name]["alpha_x"])
        pdf = domain.density(pdf)
    test = mi.chi2.ChiSquareTest(domain, sample, pdf, sample_dim=3, sample_count=400_000, ires=8)
    assert test.run(SIGNIFICANCE, test_count=len(MATERIALS) * len(ANGLES), quiet=True), test.messages


@pytest.mark.parametrize("name", MATERIALS)
def test_weight_is_eval_over_pdf(llvm, name):
    n = 20_000
    b, ctx, si = material(**MATERIALS[name]).bsdf(), mi.BSDFContext(), hit(directions(n))
    u = np.random.default_rng(0).random((3, n)).astype(np.float32)
    bs, weight = b.sample(ctx, si, mi.Float(u[0]), mi.Point2f(u[1:]))
    value, pdf = (np.array(v).T for v in b.eval_pdf(ctx, si, bs.wo))
    np.testing.assert_allclose(np.array(b.eval(ctx, si, bs.wo)).T, value, rtol=ROUNDING)
    np.testing.assert_allclose(np.array(b.pdf(ctx, si, bs.wo)), pdf, rtol=ROUNDING)
    np.testing.assert_allclose(np.array(bs.pdf), pdf, rtol=ROUNDING)
    drawn, weight = pdf > 0, np.array(weight).T
    np.testing.assert_allclose(weight[drawn], value[drawn] / pdf[drawn, None], rtol=ROUNDING)
    assert not weight[~drawn].any() and drawn.mean() > 0.5
    assert (np.array(bs.wo.z)[drawn] > 0).all()
    np.testing.assert_allclose(np.array(dr.norm(bs.wo)), 1, atol=1e-5)
    assert (np.array(bs.eta) == 1).all() and (np.array(bs.sampled_component) == 0).all()


@pytest.mark.parametrize("degrees", ANGLES)
@pytest.mark.parametrize("name", OTHERS)
def test_samples_of_other_models_follow_the_density(llvm, name, degrees, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # a failing test writes its histograms
    sample, pdf = mi.chi2.BSDFAdapter("enhanced", other(name).to_dict(), wi=view(degrees))
    test = mi.chi2.ChiSquareTest(mi.chi2.SphericalDomain(), sample, pdf, sample_dim=3, sample_count=400_000, ires=8)
    assert test.run(SIGNIFICANCE, test_count=len(OTHERS) * len(ANGLES), quiet=True), test.messages


@pytest.mark.parametrize("degrees", (0, 60, 89))
@pytest.mark.parametrize("name", sorted(models.MODELS))
def test_near_mirrors_of_all_models_follow_the_density(llvm, name, degrees, tmp_path, monkeypatch):
    """Cells as narrow as the lobe: a sine from a rounded cosine would show as steps."""
    monkeypatch.chdir(tmp_path)
    m = Material.analytic(name)
    sharp = {"alpha_x": 0.005, "alpha_y": 0.005, "alpha_x2": 0.01, "alpha_y2": 0.01, "n_u": 8e4, "n_v": 8e4, "B": 4e4}
    m = m.edit(**{key: v for key, v in sharp.items() if key in m.params})
    result = chi_square(m.bsdf(), view(degrees), m.as_drjit(), m.brdf.model, test_count=3 * len(models.MODELS))
    assert result["passed"], result["message"]


def albedo_by_quadrature(b, wi, n=500):
    """Midpoints, uniform in the projected solid angle: f cos / (cos / pi) is f pi."""
    u, v = np.meshgrid((np.arange(n) + 0.5) / n, (np.arange(n) + 0.5) / n * 2 * np.pi)
    r = np.sqrt(u)
    wo = np.stack([r * np.cos(v), r * np.sin(v), np.sqrt(1 - u)], -1).reshape(-1, 3)
    value = np.array(b.eval(mi.BSDFContext(), hit(np.tile(wi, (n * n, 1))), vectors(wo))).T
    return (value / wo[:, 2:]).mean(0) * np.pi


@pytest.mark.parametrize("degrees", (20, 70))
def test_mean_weight_is_the_albedo(llvm, degrees):
    """Holds for any networks: nothing that reflects is left out by the sampling."""
    b = material().bsdf()
    np.testing.assert_allclose(
        albedo_by_sampling(b, view(degrees)), albedo_by_quadrature(b, view(degrees)), rtol=NOISE + QUADRATURE
    )


@pytest.mark.parametrize("degrees", (20, 70))
@pytest.mark.parametrize("name", OTHERS)
def test_mean_weight_of_other_models_is_the_albedo(llvm, name, degrees):
    b = other(name).bsdf()
    np.testing.assert_allclose(
        albedo_by_sampling(b, view(degrees)), albedo_by_quadrature(b, view(degrees)), rtol=NOISE + QUADRATURE
    )


@pytest.mark.parametrize("alpha", (0.02, 0.3, 1.0))
@pytest.mark.parametrize("degrees", (0, 60, 85))
def test_white_furnace_of_cook_torrance_makes_no_energy(llvm, alpha, degrees):
    """Its 1/pi stands where 1/4 conserves energy: rho_s = pi / 4."""
    m = other("cook_torrance", n_x=0, n_y=0, alpha_x=alpha, alpha_y=alpha, F0=1.0, rho_d=0.0, rho_s=np.pi / 4)
    albedo = albedo_by_sampling(m.bsdf(), view(degrees))
    assert (albedo <= 1 + NOISE).all()
    assert albedo.min() > {0.02: 0.85, 0.3: 0.6, 1.0: 0.3}[alpha]


@pytest.mark.parametrize("alpha", (0.02, 0.3, 1.0))
@pytest.mark.parametrize("degrees", (0, 60, 85))
def test_white_furnace_makes_no_energy(llvm, alpha, degrees):
    """GGX without networks, F0 = 1: what is lost is shadowed, at most 1 comes back, nearly all of it when smooth."""
    b = analytic(alpha_x=alpha, alpha_y=alpha, F0=1.0, rho_d=0.0, rho_s=1.0).bsdf()
    albedo = albedo_by_sampling(b, view(degrees))
    assert (albedo <= 1 + NOISE).all()
    assert albedo.min() > {0.02: 0.85, 0.3: 0.6, 1.0: 0.3}[alpha]
