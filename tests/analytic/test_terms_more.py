"""Distributions with tails, the back vector, and the rough diffuse term: twins, limits, and what the search can do."""

from __future__ import annotations

import lanes
import numpy as np
import pytest
import twin

import mi_enhance  # noqa: F401  (before mitsuba)

import mitsuba as mi  # isort: skip
from mi_enhance import enhance, models, terms
from mi_enhance.analytic import alternative_terms
from mi_enhance.material.material import Material
from mi_enhance.sampling import importance

ROUNDING = 2e-6  # relative; float32 has 6e-8
TAILS = {"D_generalized_beckmann": (0.2, 0.5, 1, 2, 4), "D_hyper_cauchy": (1.5, 2, 10), "D_student_t": (1.5, 2, 8, 40)}
CASES = [(name, shape) for name, shapes in TAILS.items() for shape in shapes]


def normals(alpha, n=3000, seed=0):
    """Normals whose slopes are around the roughness, and grazing ones."""
    rng = np.random.default_rng(seed)
    r, phi = np.geomspace(1e-3, 1e3, n), rng.random(n) * 2 * np.pi
    h = np.stack([alpha[0] * r * np.cos(phi), alpha[1] * r * np.sin(phi), np.ones(n)], 1)
    return twin.unit(h[r * max(alpha) < 1e3]).astype(np.float32)


@pytest.mark.parametrize("alpha", [(1e-3, 0.5), (0.1, 0.1), (1.0, 0.3)], ids=str)
@pytest.mark.parametrize("name, shape", CASES)
def test_tails_are_the_twins(llvm, name, shape, alpha):
    h = normals(alpha)
    values = [mi.Float(v) for v in (*alpha, shape)]
    got = np.array(getattr(terms, name)(lanes.vectors(h), *values), np.float64)
    a_x, a_y, k = (np.float64(np.float32(v)) for v in (*alpha, shape))
    with np.errstate(all="ignore"):
        expected = np.nan_to_num(getattr(twin, name)(h.astype(np.float64), a_x, a_y, k))
    assert np.isfinite(got).all()
    peak = expected.max()
    # the rounding of an exponent counts in full: gamma log(1e6), or a power up to 80
    np.testing.assert_allclose(got, expected, rtol=300 * ROUNDING, atol=1e-12 * peak)
    near = expected > 1e-2 * peak
    np.testing.assert_allclose(got[near], expected[near], rtol=30 * ROUNDING)


@pytest.mark.parametrize("alpha", [(0.05, 0.5), (0.3, 0.3)], ids=str)
@pytest.mark.parametrize("name, shape", CASES)
def test_tails_integrate_to_one_against_the_cosine(llvm, name, shape, alpha):
    """Midpoints in the logarithm of the slope and in phi: D cos dw is D cos^4 over the slopes."""
    n, low, high = 800, 1e-8, 1e5
    log, phi = np.meshgrid(
        np.log(low) + (np.arange(n) + 0.5) / n * np.log(high / low), (np.arange(64) + 0.5) / 64 * 2 * np.pi
    )
    r = np.exp(log)
    h = twin.unit(np.stack([alpha[0] * r * np.cos(phi), alpha[1] * r * np.sin(phi), np.ones_like(r)], -1))
    d = getattr(twin, name)(h, *alpha, shape)
    integral = np.mean(d * h[..., 2] ** 4 * r**2) * 2 * np.pi * alpha[0] * alpha[1] * np.log(high / low)
    assert integral == pytest.approx(1, abs=2e-4)  # 1.5: 1e-5 of the tail lies beyond
    # and the term is the twin: the test above


def test_tails_hold_ggx_and_beckmann(llvm):
    h = lanes.vectors(normals((0.2, 0.4)))
    a = mi.Float(0.2), mi.Float(0.4)
    np.testing.assert_allclose(terms.D_student_t(h, *a, mi.Float(2)), terms.D_ggx(h, *a), rtol=2e-5)
    np.testing.assert_allclose(terms.D_hyper_cauchy(h, *a, mi.Float(2)), terms.D_ggx(h, *a), rtol=2e-5)
    beckmann = np.array(terms.D_beckmann(h, *a))
    got = np.array(terms.D_generalized_beckmann(h, *a, mi.Float(1)))
    np.testing.assert_allclose(got, beckmann, rtol=2e-4, atol=1e-12)  # exponents up to 80


@pytest.mark.parametrize("name", TAILS)
def test_tails_start_where_the_usual_term_is(llvm, name):
    alpha = np.array([0.1, 0.3])
    start = alternative_terms.start(models.get("ggx2"), "D2", name, {"alpha_x": alpha / 2, "alpha_x2": alpha})
    (key,) = start
    assert key.endswith("2") and np.array_equal(start[key], np.full(2, 1.0 if "beckmann" in name else 2.0))


# ---- the back vector


def test_retro_terms_are_the_twins(llvm):
    wi, wo = twin.pairs(3000, seed=3)
    wo[:500] = wi[:500]
    i, o = wi.astype(np.float64), wo.astype(np.float64)
    for a in ((0.003, 0.2), (0.3, 0.3)):
        got = np.array(terms.D_retro_ggx(lanes.vectors(wi), lanes.vectors(wo), mi.Float(a[0]), mi.Float(a[1])))
        # 6e-8 of h over a roughness of 0.003
        np.testing.assert_allclose(got, twin.D_retro_ggx(i, o, *(np.float64(np.float32(v)) for v in a)), rtol=2e-4)
        swapped = np.array(terms.D_retro_ggx(lanes.vectors(wo), lanes.vectors(wi), mi.Float(a[0]), mi.Float(a[1])))
        np.testing.assert_array_equal(got, swapped)
    got = np.array(terms.F_retro_schlick(lanes.vectors(wi), lanes.vectors(wo), mi.Float(0.04)))
    np.testing.assert_allclose(got, twin.F_retro_schlick(i, o, 0.04), rtol=1e-5)


def test_retro_lobe_peaks_towards_the_light(llvm):
    material = Material.analytic("ggx_retro").edit(rho_d=0, rho_s=0, rho_s2=1.0, alpha_x2=0.1, alpha_y2=0.1, F0=1)
    angles = np.deg2rad(np.arange(-80, 81, 5))
    wi = np.stack([np.sin(angles), 0 * angles, np.cos(angles)], 1)
    light = np.tile([np.sin(0.7), 0, np.cos(0.7)], (len(wi), 1))
    f = material.evaluate(wi, light)[:, 0]
    assert abs(angles[f.argmax()] - 0.7) < np.deg2rad(5)


@pytest.mark.parametrize("theta", [0, 40, 75])
@pytest.mark.parametrize("frame", [(0.0, 0.0, 0.0), (0.2, -0.1, 0.5)], ids=["flat", "tilted"])
def test_retro_lobe_is_sampled_by_its_density(llvm, theta, frame):
    """The histogram of a direction function of the samples is its integral against the density."""
    model = models.get("ggx_retro")
    values = dict(zip(("n_x", "n_y", "t_theta"), frame, strict=True))
    values |= dict(rho_d=0.2, rho_s=1.0, rho_s2=1.0, F0=0.5, alpha_x=0.3, alpha_y=0.3, alpha_x2=0.2, alpha_y2=0.1)
    p = {k: (mi.Color3f if k.startswith("rho") else mi.Float)(v) for k, v in values.items()}
    shares = [mi.Float(0.2), mi.Float(0.6)]
    wi = mi.Vector3f(float(np.sin(np.deg2rad(theta))), 0, float(np.cos(np.deg2rad(theta))))
    u = [mi.Float(v) for v in np.random.default_rng(0).random((3, 200_000)).astype(np.float32)]
    wo = importance.sample(wi, p, shares, u[0], mi.Point2f(u[1], u[2]), model)
    drawn = np.array(wo, np.float64).T
    drawn = drawn[(drawn[:, 2] > 0) & (drawn @ twin.frame(*frame)[2] > 0)]

    rng = np.random.default_rng(1)
    cells = twin.unit(rng.normal(size=(2_000_000, 3)))
    cells[:, 2] = np.abs(cells[:, 2])
    density = np.array(importance.pdf(wi, lanes.vectors(cells.astype(np.float32)), p, shares, model), np.float64)
    for test in (lambda w: w[:, 0], lambda w: w[:, 0] ** 2, lambda w: w[:, 1] ** 2, lambda w: np.ones(len(w))):
        expected = np.mean(density * test(cells)) * 2 * np.pi
        # 1.5e-2: four standard deviations of the two estimates
        assert test(drawn).sum() / 200_000 == pytest.approx(expected, abs=1.5e-2)


def test_retro_weights_are_bounded(llvm):
    """The lobe that the model has is the one that is sampled: f cos / pdf stays near the albedo."""
    material = Material.analytic("ggx_retro").edit(rho_d=0, rho_s=0, rho_s2=1.0, alpha_x2=0.05, alpha_y2=0.05, F0=1)
    bsdf, si = material.bsdf(), mi.SurfaceInteraction3f()
    si.wi = mi.Vector3f(0.5, 0, 0.75**0.5)
    u = [mi.Float(v) for v in np.random.default_rng(0).random((3, 100_000)).astype(np.float32)]
    _, weight = bsdf.sample(mi.BSDFContext(), si, u[0], mi.Point2f(u[1], u[2]))
    weight = np.array(weight)[0]
    assert weight.mean() == pytest.approx(0.97, abs=0.05) and weight.max() < 25  # a share of 0.05 is a weight of 20


# ---- the rough diffuse term


@pytest.mark.parametrize("r", [0.0, 0.3, 1.0])
def test_B_eon_is_the_twins_and_keeps_the_albedo(llvm, r):
    wi, wo = twin.pairs(3000, seed=4, min_cos=1e-3)
    got = np.array(terms.B_eon(lanes.vectors(wi), lanes.vectors(wo), mi.Float(r)), np.float64)
    expected = twin.B_eon(wi.astype(np.float64), wo.astype(np.float64), r)
    np.testing.assert_allclose(got, expected, rtol=3e-3, atol=5e-4)  # the source's fit of the albedo
    assert got.min() > 0
    for theta in (0, 45, 80):
        one = np.tile([np.sin(np.deg2rad(theta)), 0, np.cos(np.deg2rad(theta))], (100_000, 1)).astype(np.float32)
        k = np.arange(100_000) + 0.5
        rho, phi = np.sqrt(k / 100_000), k * np.pi * (3 - np.sqrt(5))
        light = np.stack([rho * np.cos(phi), rho * np.sin(phi), np.sqrt(1 - k / 100_000)], 1).astype(np.float32)
        albedo = np.array(terms.B_eon(lanes.vectors(one), lanes.vectors(light), mi.Float(r))).mean()
        assert albedo == pytest.approx(1, abs=2e-3)


def test_B_eon_stands_in_the_slot_of_lambert(llvm):
    model = alternative_terms.with_terms(models.get("ggx2"), {"B": "B_eon"})
    assert model.extra == ("diffuse_roughness",) and "M * B_eon + S * D" in str(model)
    start = alternative_terms.start(models.get("ggx2"), "B", "B_eon", {"alpha_x": np.array([0.1, 0.2])})
    assert np.array_equal(start["diffuse_roughness"], [0, 0])
    wi, wo = twin.pairs(100, seed=5)
    p = {q.name: np.full(q.size, q.initial) for q in models.get("ggx2").parameters}
    plain = lanes.evaluate(enhance("ggx2", ()), wi, wo, {k: np.tile(v, (100, 1)) for k, v in p.items()})
    p["diffuse_roughness"] = np.zeros(1)
    rough = lanes.evaluate(enhance(model, ()), wi, wo, {k: np.tile(v, (100, 1)) for k, v in p.items()})
    np.testing.assert_allclose(rough, plain, rtol=1e-6)
