"""The terms: against the twin, the limits of physics, and Mitsuba's own rough conductor."""

from __future__ import annotations

import mi_enhance  # noqa: F401  (before mitsuba)

import drjit as dr  # isort: skip
import mitsuba as mi
import numpy as np
import pytest
import twin
from lanes import vectors

from mi_enhance import enhance, terms
from mi_enhance.analytic import geometry, parameters

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


@pytest.mark.parametrize("D", ["D_ggx", "D_beckmann"])
@pytest.mark.parametrize("alpha", [(0.05, 0.05), (0.05, 0.5), (0.3, 0.1), (1.0, 1.0)], ids=str)
def test_D_times_cosine_integrates_to_one(llvm, alpha, D):
    """Midpoints in (tan(theta_h) scaled to the lobe, phi_h)."""
    n = 1000
    v, phi = np.meshgrid((np.arange(n) + 0.5) / n, (np.arange(n) + 0.5) / n * 2 * np.pi)
    scale = np.sqrt((alpha[0] * np.cos(phi)) ** 2 + (alpha[1] * np.sin(phi)) ** 2)
    theta = np.arctan(scale * v / (1 - v))
    d_theta = np.cos(theta) ** 2 * scale / (1 - v) ** 2
    h = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], -1).reshape(-1, 3)
    d = np.array(getattr(terms, D)(vectors(h), mi.Float(alpha[0]), mi.Float(alpha[1])), np.float64).reshape(n, n)
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


def finite_gradients(f, *arguments):
    """Value of a term, after its derivatives with respect to all arguments have been found finite."""
    dr.enable_grad(*arguments)
    value = f(*arguments)
    dr.backward(value, dr.ADFlag.ClearNone)
    for a in arguments:
        assert np.isfinite(np.array(dr.grad(a))).all()
    return np.array(dr.detach(value), np.float64)


def lanes(n, *values):
    return [mi.Float(np.full(n, v, np.float32)) for v in values]


@pytest.mark.parametrize("D", ["D_beckmann", "D_ward"])
@pytest.mark.parametrize("alpha", ALPHAS, ids=str)
def test_gaussian_lobes_are_the_twins(llvm, alpha, D):
    h = np.concatenate([*directions(), [[1, 0, 1e-7], [1, 0, 0]]]).astype(np.float32)
    a_x, a_y = np.float32(alpha).astype(np.float64)
    got = finite_gradients(getattr(terms, D), vectors(h), *lanes(len(h), a_x, a_y))
    with np.errstate(all="ignore"):  # the twin has no floor at h_z = 0
        expected = np.nan_to_num(getattr(twin, D)(h.astype(np.float64), a_x, a_y))
    # the exponent's rounding counts in full: 80 times at exp(-80), which is 1e-35, where float32 ends
    np.testing.assert_allclose(got, expected, rtol=80 * ROUNDING, atol=1e-34 / (a_x * a_y))
    near = expected > 1e-2 / (np.pi * a_x * a_y)
    assert near.any()
    np.testing.assert_allclose(got[near], expected[near], rtol=5 * ROUNDING)


@pytest.mark.parametrize("alpha", [(0.1, 0.1), (0.2, 0.6), (1.0, 1.0)], ids=str)
def test_D_beckmann_is_mitsubas(llvm, alpha):
    h = np.concatenate(directions())
    h = h[h[:, 2] > 0.05]
    expected = np.array(mi.MicrofacetDistribution(mi.MicrofacetType.Beckmann, *alpha).eval(vectors(h)))
    got = np.array(terms.D_beckmann(vectors(h), mi.Float(alpha[0]), mi.Float(alpha[1])))
    large = expected > 1e-6  # Mitsuba flushes what is tiny
    assert large.sum() > 50
    np.testing.assert_allclose(got[large], expected[large], rtol=20 * ROUNDING)  # exponents up to 20


@pytest.mark.parametrize("B, C", [(1, 10), (30, 1.7), (2e5, 1.1), (8e6, 0.024), (1e8, 10)])
def test_D_abc_is_the_twins(llvm, B, C):
    """Also in the middle of the narrowest lobe, where 1 - cos(theta_h) itself has no digit left."""
    theta = np.concatenate([np.geomspace(1e-6, np.pi / 2, 400), [0.0]])
    h = np.stack([np.sin(theta), 0 * theta, np.cos(theta)], 1).astype(np.float32)
    got = finite_gradients(terms.D_abc, vectors(h), *lanes(len(h), B, C))
    expected = twin.D_abc(h.astype(np.float64), np.float64(np.float32(B)), np.float64(np.float32(C)))
    assert got[-1] == 1 and (np.diff(got[:-1]) <= 0).all()
    np.testing.assert_allclose(got, expected, rtol=(3 + C * np.log1p(B)) * 1e-6, atol=1e-37)  # the exponent's rounding


@pytest.mark.parametrize("n_u, n_v", [(1, 1), (1, 1e6), (100, 20), (1e4, 1e4), (1e6, 1e6)])
def test_D_ashikhmin_shirley_is_the_twins(llvm, n_u, n_v):
    """Also in the middle of the narrowest lobe, where the exponent is 0 / 0 and log(h_z) has no digit left."""
    theta = np.concatenate([np.geomspace(1e-8, np.arccos(2e-4), 400), [0.0]])
    phi = np.concatenate([np.linspace(0, 2 * np.pi, 400), [0.0]])
    h = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], 1).astype(np.float32)
    got = finite_gradients(terms.D_ashikhmin_shirley, vectors(h), *lanes(len(h), n_u, n_v))
    # cos(theta) from its sine: float32's h_z near 1 is what the term does without
    h = h.astype(np.float64)
    sin2 = h[:, 0] ** 2 + h[:, 1] ** 2
    h[:, 2] = np.where(sin2 < 0.01, np.sqrt(1 - np.minimum(sin2, 0.5)), h[:, 2])
    expected = twin.D_ashikhmin_shirley(h, np.float64(np.float32(n_u)), np.float64(np.float32(n_v)))
    # the exponent's rounding counts in full: 80 times at exp(-80), where float32 ends
    np.testing.assert_allclose(got, expected, rtol=80 * ROUNDING, atol=1e-33 * expected.max())
    near = expected > 1e-2 * expected.max()
    np.testing.assert_allclose(got[near], expected[near], rtol=5 * ROUNDING)
    below = finite_gradients(terms.D_ashikhmin_shirley, vectors([[1, 0, 1e-7], [0, 1, 0]]), *lanes(2, n_u, n_v))
    assert (0 <= below).all() and (below <= 1e-4 * expected.max()).all()


@pytest.mark.parametrize("n_u, n_v", [(1, 1), (3, 80), (500, 20)])
def test_D_ashikhmin_shirley_integrates_to_one_without_a_cosine(llvm, n_u, n_v):
    """Midpoints in (cos(theta_h)^n, phi_h), n of the wider side."""
    n, k = 1000, min(n_u, n_v) + 1
    v, phi = np.meshgrid((np.arange(n) + 0.5) / n, (np.arange(n) + 0.5) / n * 2 * np.pi)
    z = v ** (1 / k)
    h = np.stack([np.sqrt(1 - z**2) * np.cos(phi), np.sqrt(1 - z**2) * np.sin(phi), z], -1).reshape(-1, 3)
    d = np.array(terms.D_ashikhmin_shirley(vectors(h), mi.Float(n_u), mi.Float(n_v)), np.float64).reshape(n, n)
    assert np.mean(d * v ** (1 / k - 1) / k) * 2 * np.pi == pytest.approx(1, abs=1e-3)  # midpoints of a tall, thin lobe


def test_F_dielectric_is_the_twins_and_mitsubas(llvm):
    cos = np.concatenate([[0, 1e-6, 1e-4, 1e-3], np.linspace(0.01, 1, 500)]).astype(np.float32)
    for ior in (1.0, 1.0001, 1.04, 1.5, 3.0, 100.0):
        got = finite_gradients(terms.F_dielectric, mi.Float(cos), *lanes(len(cos), ior))
        expected = twin.F_dielectric(cos.astype(np.float64), np.float64(np.float32(ior)))
        # 2e-13: what is left at Brewster's angle and index 1.0001 of two float64 numbers that cancel
        np.testing.assert_allclose(got, expected, rtol=10 * ROUNDING, atol=2e-13)
        assert got.min() >= 0 and got.max() <= 1 + 1e-6
        if 1.01 < ior < 10:
            mitsuba = np.array(mi.fresnel(mi.Float(cos[3:]), mi.Float(ior))[0])
            np.testing.assert_allclose(got[3:], mitsuba, rtol=1e-4, atol=1e-6)  # Mitsuba's differences of equal numbers


@pytest.mark.parametrize("F0", [0.0, 1e-10, 1e-4, 0.04, 0.5, 0.99, 1.0])
def test_F_cook_torrance_is_the_twins_and_has_its_limits(llvm, F0):
    cos = np.concatenate([[0, 1e-6, 1e-4, 1e-3], np.linspace(0.01, 1, 500)]).astype(np.float32)
    got = finite_gradients(terms.F_cook_torrance, mi.Float(cos), *lanes(len(cos), F0))
    expected = twin.F_cook_torrance(cos.astype(np.float64), np.float64(np.float32(F0)))
    if F0 == 1e-10:  # below the floor of the root: too small at grazing angles
        assert (got <= expected * (1 + 1e-6)).all()
    else:
        np.testing.assert_allclose(got, expected, rtol=20 * ROUNDING, atol=1e-10)
    assert got[-1] == pytest.approx(F0, rel=1e-6, abs=1e-12) and got.min() >= 0 and got.max() <= 1 + 1e-6


def test_G_v_cavity_is_the_twins_and_a_fraction(llvm):
    wi, wo = directions(seed=1)
    q = geometry.quantities(vectors(wi), vectors(wo))
    names = ("cos_theta_h", "cos_theta_i", "cos_theta_o", "cos_theta_d")
    got = finite_gradients(terms.G_v_cavity, *(mi.Float(q[name]) for name in names))
    expected = twin.G_v_cavity(*(w.astype(np.float64) for w in (wi, wo, twin.unit(wi.astype(np.float64) + wo))))
    # directions that nearly oppose each other: h and cos_theta_d keep 6e-8 / 1e-6 of their digits
    np.testing.assert_allclose(got, expected, rtol=ROUNDING, atol=1e-6)
    assert got.min() >= 0 and got.max() <= 1
    q = geometry.quantities(mi.Vector3f(0, 0, 1), mi.Vector3f(0, 0, 1))
    assert terms.G_v_cavity(*(q[name] for name in names))[0] == 1


@pytest.mark.parametrize(
    "f, expected",
    [
        ("inv_E_pi", lambda i, o: 1 / (np.pi * np.maximum(i, 1e-4) * np.maximum(o, 1e-4))),
        ("inv_E_ward", lambda i, o: 0.25 / np.sqrt(np.maximum(i, 1e-4) * np.maximum(o, 1e-4))),
    ],
    ids=["inv_E_pi", "inv_E_ward"],
)
def test_other_normalizations_have_a_floor(llvm, f, expected):
    ci, co = np.geomspace(1e-8, 1, 300).astype(np.float32), np.linspace(0, 1, 300).astype(np.float32)
    got = finite_gradients(getattr(terms, f), mi.Float(ci), mi.Float(co))
    np.testing.assert_allclose(got, expected(ci.astype(np.float64), co.astype(np.float64)), rtol=ROUNDING)


def test_normalization_of_ashikhmin_shirley_has_a_floor(llvm):
    d, i, o = (np.random.default_rng(0).permutation(np.geomspace(1e-8, 1, 300)).astype(np.float32) for _ in range(3))
    got = finite_gradients(terms.inv_E_ashikhmin_shirley, *(mi.Float(v) for v in (d, i, o)))
    expected = twin.inv_E_ashikhmin_shirley(*(v.astype(np.float64) for v in (d, i, o)))
    np.testing.assert_allclose(got, expected, rtol=ROUNDING)


@pytest.mark.parametrize("F0", [0.0, 0.04, 1.0])
def test_diffuse_term_of_ashikhmin_shirley_leaves_room_for_the_specular_one(llvm, F0):
    """Its albedo is (1 - F0) (1 - (1 - cos/2)^5) from every view, which is what their 28/23 is for, and below 1 - F."""
    n = 400
    cos = (np.arange(n) + 0.5) / n
    ci, co = (v.ravel().astype(np.float32) for v in np.meshgrid(cos, cos, indexing="ij"))
    b = finite_gradients(terms.B_ashikhmin_shirley, mi.Float(ci), mi.Float(co), *lanes(n * n, F0)).reshape(n, n)
    albedo = np.mean(b * cos, 1) * 2
    np.testing.assert_allclose(albedo, (1 - F0) * (1 - (1 - cos / 2) ** 5), rtol=1e-4)  # 400 midpoints, float32
    assert (albedo <= 1 - twin.F_schlick(cos, F0) + 1e-6).all() and (b >= 0).all()
