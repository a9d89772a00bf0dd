"""GGX's terms: against the twin, the limits of physics, and Mitsuba's own rough conductor."""

from __future__ import annotations

import mitsuba as mi
import numpy as np
import pytest
import twin
from lanes import vectors

from mi_enhance import enhance, parameters, terms

ROUNDING = 2e-6  # relative; float32 has 6e-8, a dozen operations and the exponents 4 and 5 multiply it
# Mitsuba's roughconductor against ours: two float32 codes, each with a half vector of its own (6e-8 / alpha in D).
TWO_CODES = 1e-5

ALPHAS = [(1e-4, 1e-4), (1e-4, 1.0), (0.003, 0.5), (0.1, 0.1), (0.7, 0.2), (1.0, 1.0)]


def directions(n=2000, seed=0):
    """Random pairs, and the awkward ones: normal, grazing down to cos 1e-6, equal."""
    wi, wo = twin.pairs(n, seed)
    cos = np.geomspace(1e-6, 1, 40)
    graze = np.stack([np.sqrt(1 - cos**2), 0 * cos, cos], 1)
    side = np.stack([0 * cos, -np.sqrt(1 - cos**2), cos], 1)
    up = np.tile([0.0, 0.0, 1.0], (40, 1))
    wi, wo = np.concatenate([wi, graze, graze, graze, up]), np.concatenate([wo, side, graze, up, up])
    return wi.astype(np.float32), wo.astype(np.float32)


@pytest.mark.parametrize("alpha", ALPHAS, ids=str)
def test_D_is_the_twins(llvm, alpha):
    h = np.concatenate(directions())
    a_x, a_y = np.float32(alpha).astype(np.float64)
    got = np.array(terms.D_ggx(vectors(h), mi.Float(a_x), mi.Float(a_y)), np.float64)
    expected = twin.D_ggx(h.astype(np.float64), a_x, a_y)
    assert np.isfinite(got).all()
    np.testing.assert_allclose(got, expected, rtol=ROUNDING)


@pytest.mark.parametrize("alpha", [(0.05, 0.05), (0.05, 0.5), (0.3, 0.1), (1.0, 1.0)], ids=str)
def test_D_times_cosine_integrates_to_one(llvm, alpha):
    """Midpoints in (tan(theta_h) scaled to the lobe, phi_h)."""
    n = 1000
    v, phi = np.meshgrid((np.arange(n) + 0.5) / n, (np.arange(n) + 0.5) / n * 2 * np.pi)
    scale = np.sqrt((alpha[0] * np.cos(phi)) ** 2 + (alpha[1] * np.sin(phi)) ** 2)
    theta = np.arctan(scale * v / (1 - v))
    d_theta = np.cos(theta) ** 2 * scale / (1 - v) ** 2
    h = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], -1).reshape(-1, 3)
    d = np.array(terms.D_ggx(vectors(h), mi.Float(alpha[0]), mi.Float(alpha[1])), np.float64).reshape(n, n)
    integral = np.mean(d * np.cos(theta) * np.sin(theta) * d_theta) * 2 * np.pi
    assert integral == pytest.approx(1, abs=2e-5)  # 1e6 midpoints and float32 directions


@pytest.mark.parametrize("F0", [0.0, 0.04, 0.5, 1.0])
def test_F_is_the_twins_and_has_its_limits(llvm, F0):
    cos = np.linspace(0, 1, 1001).astype(np.float32)
    got = np.array(terms.F_schlick(mi.Float(cos), mi.Float(F0)))
    # the cancellation in 1 - cos costs absolute, not relative digits
    np.testing.assert_allclose(got, twin.F_schlick(cos.astype(np.float64), np.float32(F0)), rtol=ROUNDING, atol=1e-7)
    assert got[0] == 1 and got[-1] == np.float32(F0)
    assert (np.diff(got) <= 0).all() and got.min() >= np.float32(F0) and got.max() <= 1


@pytest.mark.parametrize("alpha", ALPHAS, ids=str)
def test_G_is_the_twins_and_a_fraction(llvm, alpha):
    wi, wo = directions(seed=1)
    a_x, a_y = np.float32(alpha).astype(np.float64)
    got = np.array(terms.G_smith_ggx(vectors(wi), vectors(wo), mi.Float(a_x), mi.Float(a_y)), np.float64)
    # The two forms, with cos and with tan, differ by what float32 directions miss of unit length: not at all.
    np.testing.assert_allclose(
        got, twin.G_smith_ggx(*(w.astype(np.float64) for w in (wi, wo)), a_x, a_y), rtol=ROUNDING
    )
    assert got.min() >= 0 and got.max() <= 1


def test_G_at_normal_incidence_is_one(llvm):
    up = mi.Vector3f(0, 0, 1)
    assert terms.G_smith_ggx(up, up, mi.Float(1), mi.Float(1))[0] == 1


def test_inv_E_is_the_twins_with_a_floor(llvm):
    ci, co = np.geomspace(1e-8, 1, 300).astype(np.float32), np.linspace(0, 1, 300).astype(np.float32)
    got = np.array(terms.inv_E(mi.Float(ci), mi.Float(co)), np.float64)
    np.testing.assert_allclose(got, twin.inv_E(ci.astype(np.float64), co.astype(np.float64)), rtol=ROUNDING)
    assert got.min() >= 0.25 and got[0] == pytest.approx(0.25e8, rel=1e-5)


def test_M_and_S_are_albedo_over_pi_and_albedo(llvm):
    np.testing.assert_allclose(
        np.array(terms.M_lambert(mi.Color3f(0.1, 0.2, 1.0)))[:, 0] * np.pi, [0.1, 0.2, 1], rtol=1e-6
    )
    assert np.array_equal(np.array(terms.S_constant(mi.Color3f(0, 2, 10)))[:, 0], [0, 2, 10])


@pytest.mark.parametrize("alpha", [(0.1, 0.1), (0.1, 0.6), (0.5, 0.3), (1.0, 1.0)], ids=str)
def test_analytic_ggx_is_mitsubas_rough_conductor(llvm, alpha):
    """eta = 0, k = 1 reflects everything (F = 1); GGX with F0 = 1 does too."""
    wi, wo = twin.pairs(20_000, seed=5, min_cos=1e-3)
    conductor = mi.load_dict({
        "type": "roughconductor", "distribution": "ggx", "alpha_u": alpha[0], "alpha_v": alpha[1],
        "eta": 0.0, "k": 1.0, "specular_reflectance": 1.0,
    })  # fmt: skip
    si = mi.SurfaceInteraction3f()
    si.wi, si.n, si.sh_frame = vectors(wi), mi.Normal3f(0, 0, 1), mi.Frame3f(mi.Normal3f(0, 0, 1))
    expected = np.array(conductor.eval(mi.BSDFContext(), si, vectors(wo))).T / wo[:, 2:]
    brdf = enhance("ggx", replace=())
    values = {
        "rho_d": 0,
        "rho_s": 1,
        "F0": 1,
        "n_x": 0,
        "n_y": 0,
        "t_theta": 0,
        "alpha_x": alpha[0],
        "alpha_y": alpha[1],
    }
    p = {q.name: (mi.Color3f if q.size == 3 else mi.Float)(values[q.name]) for q in brdf.parameters}
    got = np.array(brdf(vectors(wi), vectors(wo), p)).T
    assert parameters.count(brdf.parameters) == 12
    assert (expected > 0).all()  # Mitsuba flushed nothing here
    np.testing.assert_allclose(got, expected, rtol=TWO_CODES)
