"""Sampling from two lobes: density, histogram, shares and weights."""

from __future__ import annotations

import lanes
import mitsuba as mi
import numpy as np
import pytest
import twin
from plugin_scenes import cells, view

from mi_enhance import models
from mi_enhance.material.material import Material
from mi_enhance.sampling import albedo, importance, lobe_mixture

DRAWN = 5e-3  # three standard deviations of a fraction of 1e5 samples
N = 100_000

FLAT, TILTED = (0.0, 0.0, 0.0), (0.3, -0.2, 0.8)
PAIRS = {
    "narrow over wide": ((0.1, 0.1), (0.5, 0.5)),
    "wide over narrow": ((0.6, 0.6), (0.08, 0.08)),
    "crossed": ((0.1, 0.5), (0.5, 0.1)),
    "alike": ((0.3, 0.3), (0.3, 0.3)),
}
SHARES = (0.3, 0.5)  # of the lobes; 0.2 for the cosine
MODEL = models.get("ggx2")


def parameters(pair, frame=FLAT, **other):
    values = dict(zip(("n_x", "n_y", "t_theta"), frame, strict=True))
    values |= {"alpha_x": pair[0][0], "alpha_y": pair[0][1], "alpha_x2": pair[1][0], "alpha_y2": pair[1][1]}
    values |= {"rho_d": 0.2, "rho_s": 1.0, "rho_s2": 0.5, "F0": 0.5, **other}
    return {k: (mi.Color3f if k.startswith("rho") else mi.Float)(v) for k, v in values.items()}


def drawn(wi, p, shares, n=N, seed=0):
    """Samples (n, 3) for one view, or for each of the views (n, 3)."""
    u = [mi.Float(v) for v in np.random.default_rng(seed).random((3, n)).astype(np.float32)]
    wo = importance.sample(lanes.vectors(np.atleast_2d(wi)), p, floats(shares), u[0], mi.Point2f(u[1], u[2]), MODEL)
    return np.array(wo, np.float64).T


def density(wi, wo, p, shares):
    value = importance.pdf(lanes.vectors(np.atleast_2d(wi)), lanes.vectors(wo), p, floats(shares), MODEL)
    return np.array(value, np.float64)


def floats(shares):
    return [mi.Float(v) for v in shares]


# --- density ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("theta", [0, 30, 75])
@pytest.mark.parametrize("frame", [FLAT, TILTED], ids=["flat", "tilted"])
@pytest.mark.parametrize("pair", PAIRS)
def test_density_integrates_to_one_without_what_is_below_the_horizon(llvm, pair, frame, theta):
    wi, p = view(theta), parameters(PAIRS[pair], frame)
    integral = density(wi, cells(1, 1, 1000), p, SHARES).mean() * 2 * np.pi
    wo = drawn(wi, p, SHARES)
    above = np.mean((wo[:, 2] > 0) & (wo @ twin.frame(*frame)[2] > 0))
    # 2e-3: midpoints of a lobe a few degrees wide, and the horizon cut through them
    assert integral == pytest.approx(above, abs=2e-3 + DRAWN)
    assert above > 0.85 or theta or frame != FLAT  # from above, little of a lobe of alpha 0.5 goes down
    np.testing.assert_allclose(np.linalg.norm(wo, axis=1), 1, atol=1e-5)


@pytest.mark.parametrize("theta", [0, 50])
@pytest.mark.parametrize("pair", PAIRS)
def test_histogram_of_the_samples_is_the_density(llvm, pair, theta):
    """Pearson's chi-square over 16 x 32 cells, those that expect less than 10 samples thrown together."""
    wi, p = view(theta), parameters(PAIRS[pair], t_theta=0.4)
    wo = drawn(wi, p, SHARES, 4 * N)
    wo = wo[wo[:, 2] > 0]
    z, phi = np.minimum((wo[:, 2] * 16).astype(int), 15), np.arctan2(wo[:, 1], wo[:, 0]) % (2 * np.pi)
    counts = np.bincount(z * 32 + np.minimum((phi / (2 * np.pi) * 32).astype(int), 31), minlength=512)
    expected = density(wi, cells(16, 32, 40), p, SHARES).reshape(512, -1).mean(1) * 2 * np.pi / 512 * 4 * N
    few = expected < 10
    counts, expected = (np.append(v[~few], v[few].sum()) for v in (counts, expected))
    chi2, freedom = np.sum((counts - expected) ** 2 / np.maximum(expected, 1)), len(counts)
    # chi-square has mean `freedom` and variance 2 freedom: 5 standard deviations
    assert chi2 < freedom + 5 * np.sqrt(2 * freedom)


def test_density_is_that_of_each_lobe_in_proportion(llvm):
    """Two lobes with shares a and b, as ggx with each alone would say."""
    (first, second), wi = PAIRS["crossed"], view(40)
    wo = twin.pairs(1000, seed=3)[0]
    p = parameters((first, second))
    lobe = lambda a: {**p, "alpha_x": mi.Float(a[0]), "alpha_y": mi.Float(a[1])}  # noqa: E731
    single = [{k: v for k, v in lobe(alpha).items() if not k.endswith("2")} for alpha in (first, second)]
    one = [np.array(importance.pdf(lanes.vectors([wi]), lanes.vectors(wo), q, floats([1]))) for q in single]
    expected = 0.3 * one[0] + 0.5 * one[1] + 0.2 * wo[:, 2] / np.pi
    np.testing.assert_allclose(density(wi, wo, p, SHARES), expected, rtol=1e-5)


# --- shares -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "rho_d, rho_s, rho_s2, lobe, expected",
    [
        (0, 0, 0, 0.5, (0.05, 0.05)),
        (1, 0, 0, 0.5, (0.05, 0.05)),
        (0, 1, 0, 0.5, (0.90, 0.05)),
        (0, 0, 1, 0.5, (0.05, 0.90)),
        (0, 1, 1, 0.5, (0.475, 0.475)),
        (0.5, 0.5, 0.5, 0.5, (0.25, 0.25)),
        (0.5, 0.25, 0.75, 0.5, (0.15, 0.35)),  # of half the albedo 0.1 is promised, the rest shared 1 : 3
        (0.5, 1, 1, 0.0, (0.05, 0.05)),
        (0.1, 10, 0, 0.04, (0.75, 0.05)),
    ],
)
def test_shares_follow_the_strengths_and_never_leave_a_technique_out(llvm, rho_d, rho_s, rho_s2, lobe, expected):
    p = parameters(PAIRS["crossed"], rho_d=rho_d, rho_s=rho_s, rho_s2=rho_s2)
    got = [s[0] for s in lobe_mixture.shares(p, lobe, MODEL)]
    assert got == pytest.approx(expected, abs=1e-4)


def test_shares_of_any_material_are_probabilities(llvm):
    rng = np.random.default_rng(4)
    p = {k: rng.choice([0, 1e-7, 0.3, 1], (1000, 3)) for k in ("rho_d", "rho_s", "rho_s2")}
    p |= {k: np.full((1000, 1), 0.2) for k in ("alpha_x", "alpha_y", "alpha_x2", "alpha_y2")}
    p["rho_s"] *= 10
    for lobe in (0.0, 1e-3, 1.0, 1e4):
        a, b = (np.array(s) for s in lobe_mixture.shares(lanes.parameters(p), lobe, MODEL))
        assert min(a.min(), b.min()) >= 0.05 - 1e-6 and (a + b).max() <= 0.95 + 1e-6  # float32 sums
        stronger = p["rho_s"].mean(1) > p["rho_s2"].mean(1) + 1e-3
        assert (a >= b - 1e-6)[stronger].all() and (a <= b + 1e-6)[
            p["rho_s2"].mean(1) > p["rho_s"].mean(1) + 1e-3
        ].all()


@pytest.mark.parametrize("shares, expected", [((1, 0), 0.1), ((0, 1), 0.6)], ids=["first", "second"])
def test_share_of_one_draws_that_lobe_only(llvm, shares, expected):
    """Mean slope of the visible normals from above: alpha for GGX's median, tan(theta_h) = alpha."""
    wo = drawn(view(0), parameters(((0.1, 0.1), (0.6, 0.6))), shares)
    h = twin.unit(wo + view(0))
    assert np.median(np.hypot(h[:, 0], h[:, 1]) / h[:, 2]) == pytest.approx(expected, rel=0.02)


# --- weights ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("pair", [((1e-4, 1e-4), (1.0, 1.0)), ((1e-4, 1.0), (0.3, 1e-4)), *PAIRS.values()], ids=str)
def test_weights_are_bounded(llvm, pair):
    """f cos / pdf for views down to cos 1e-6: each summand of f against its own share of the density.

    rho_d / pi weighs rho_d / 0.2; a lobe rho_s F G1(wo) / share. Their ratio's maximum is at most the largest of them.
    """
    rng = np.random.default_rng(2)
    cos, phi = np.geomspace(1e-6, 1, N), rng.uniform(0, 2 * np.pi, N)
    wi = np.stack([np.sqrt(1 - cos**2) * np.cos(phi), np.sqrt(1 - cos**2) * np.sin(phi), cos], 1)
    p = parameters(pair)
    wo = drawn(wi, p, SHARES)
    chance = density(wi, wo, p, SHARES)
    f = np.array(Material.analytic("ggx2").brdf(lanes.vectors(wi), lanes.vectors(wo), p), np.float64).max(0)
    assert np.isfinite(chance).all() and (chance >= 0).all() and np.isfinite(f).all()
    lit = chance > 0
    weight = f[lit] * wo[lit, 2] / chance[lit]
    assert lit.mean() > 0.3
    assert weight.max() < 1.01 * max(0.2 / 0.2, 1.0 / 0.3, 0.5 / 0.5)


@pytest.mark.parametrize("pair", ["narrow over wide", "crossed"])
def test_lobe_albedo_is_that_of_all_lobes(llvm, pair):
    """Of rho_s = rho_s2 at 30 degrees, by quadrature of the twin."""
    values = {k: np.array(v).ravel() for k, v in parameters(PAIRS[pair], rho_s=2.0, rho_s2=2.0).items()}
    material = Material.analytic("ggx2").edit(**values)
    wi, wo = np.float32([0.5, 0, np.sqrt(0.75)]), cells(1, 1, 1000)
    f = twin.analytic("ggx2", np.tile(wi, (len(wo), 1)), wo, {**material.params, "rho_d": np.zeros(3)})[:, 0]
    # both lobes together for a strength of 4
    assert albedo.lobe_albedo(material.brdf, material.as_drjit()) == pytest.approx(
        np.mean(f * wo[:, 2]) * 2 * np.pi / 4, rel=0.05
    )
