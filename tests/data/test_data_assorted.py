"""Made-up training materials: positive, reciprocal where they say so, repeatable, and as bright as was asked for."""

from __future__ import annotations

import numpy as np
import pytest

from mi_enhance import data
from mi_enhance.data import nps
from mi_enhance.data.directions import cosine_hemisphere, sample_pairs
from mi_enhance.data.random_terms import assorted
from mi_enhance.training.augmentation import warp
from mi_enhance.training.sources import build

ROUNDING = 1e-9  # float64 sums in another order, through exponentials
NPS = "mi_enhance/bundled/nps/merl.npz"


def at(seed, wi, wo):
    """An assorted material at pairs of one's own."""
    with pytest.MonkeyPatch.context() as m:

        def given(n, seed):
            sample_pairs(n, seed=seed)  # the generator moves on as it would
            return np.asarray(wi), np.asarray(wo)

        m.setattr("mi_enhance.data.random_terms.sample_pairs", given)
        return assorted(seed, len(wi))


def awkward_pairs(n):
    """Down to cosines of 1e-4, some mirrored, some equal: what the pairs of a training set never are."""
    wi, wo = (w.astype(np.float64) for w in sample_pairs(n, seed=1))
    wo[::3] = wi[::3] * [-1, -1, 1]
    wi[1::3, 2] *= 1e-2
    wi /= np.linalg.norm(wi, axis=1, keepdims=True)
    wo[::5] = wi[::5]
    return wi, wo


# --- assorted ---------------------------------------------------------------------------------------------------------


def test_assorted_materials_are_positive_finite_and_bounded():
    for seed in range(60):
        m = assorted(seed, 500)
        assert m.name == f"assorted_{seed}" and len(m.f) == 500
        assert np.isfinite(m.f).all() and (m.f > 0).all() and m.f.max() <= 1e4, seed


def test_assorted_materials_are_reciprocal():
    wi, wo = sample_pairs(400, seed=2)
    for seed in range(40):
        np.testing.assert_allclose(at(seed, wi, wo).f, at(seed, wo, wi).f, rtol=ROUNDING, err_msg=str(seed))


def test_assorted_materials_are_repeatable_and_all_different():
    again, other = [assorted(seed, 50) for seed in (3, 3)], [assorted(seed, 50).f for seed in range(20)]
    assert np.array_equal(again[0].f, again[1].f) and np.array_equal(again[0].wi, again[1].wi)
    medians = np.array([np.median(f) for f in other])
    assert len(set(medians)) == 20 and medians.max() > 3 * medians.min()


def test_assorted_materials_are_coloured_and_some_are_anisotropic():
    """Pairs turned together by 90 degrees about the normal: 4 in 10 materials change."""
    turn = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]])
    wi, wo = sample_pairs(300, seed=2)
    changed, grey = 0, 0
    for seed in range(60):
        f = [at(seed, *pair).f for pair in ((wi, wo), (wi @ turn, wo @ turn))]
        changed += np.abs(f[0] / f[1] - 1).max() > 1e-3
        grey += np.ptp(f[0] / f[0].mean(1, keepdims=True), axis=1).max() < 1e-6
    # three standard deviations of 60 draws of 0.4 are 0.19
    assert 0.2 * 60 < changed < 0.6 * 60 and grey == 0


# --- warp -------------------------------------------------------------------------------------------------------------


def test_warp_is_positive_finite_and_no_material_of_its_own():
    """Within a few hundred even at cosines of 1e-4: a factor, not a highlight."""
    for wi, wo in (sample_pairs(1000, seed=3), awkward_pairs(1000)):
        for seed in range(60):
            w = warp(wi, wo, seed)
            assert w.shape == (1000, 3) and np.isfinite(w).all() and (w > 0).all(), seed
    ordinary = np.stack([warp(*sample_pairs(1000, seed=3), seed) for seed in range(60)])
    assert 0.3 < np.median(ordinary) < 3 and 1e-4 < ordinary.min() and ordinary.max() < 1e3


def test_warp_is_reciprocal_for_half_of_the_seeds():
    """The others tell viewer from light, by a factor that is 1 for equal cosines."""
    wi, wo = sample_pairs(1000, seed=4)
    ratios = np.stack([warp(wi, wo, seed) / warp(wo, wi, seed) for seed in range(200)])
    largest = np.abs(np.log(ratios)).max((1, 2))
    reciprocal = largest < ROUNDING
    assert reciprocal.sum() + (largest > 1e-3).sum() == 200  # nothing in between
    assert 100 - 21 <= reciprocal.sum() <= 100 + 21  # three standard deviations of 200 coins
    assert np.ptp(np.log(ratios[~reciprocal]), axis=2).max() < ROUNDING  # the same for all channels
    level = wi @ np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]])  # the same cosine, another azimuth
    for seed in np.flatnonzero(~reciprocal):
        np.testing.assert_allclose(warp(wi, level, seed), warp(level, wi, seed), rtol=1e-6)  # of float32 directions


def test_warp_is_isotropic_smooth_and_repeatable():
    wi, wo = (w.astype(np.float64) for w in sample_pairs(500, seed=5, min_cos=0.05))
    c, s = np.cos(1.0), np.sin(1.0)
    turn = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    near = wo + 1e-5 * np.random.default_rng(0).normal(size=wo.shape)
    near /= np.linalg.norm(near, axis=1, keepdims=True)
    for seed in range(30):
        w = warp(wi, wo, seed)
        assert np.array_equal(w, warp(wi, wo, seed))
        np.testing.assert_allclose(warp(wi @ turn, wo @ turn, seed), w, rtol=1e-6)  # arccos of float32 lengths near 1
        # a slope of some 100 per radian at most, at theta_d = 0 where half the angle is a root of what moves
        assert np.abs(warp(wi, near, seed) / w - 1).max() < 0.01
    assert not np.allclose(warp(wi, wo, 0), warp(wi, wo, 1))


# --- cosine_hemisphere ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("n", [512, 4096])
def test_cosine_hemisphere_integrates_smooth_functions(n):
    """Density cos / pi: moments of the cosine are 2 / (k + 2), those of x and y 0 and 1/4."""
    w = cosine_hemisphere(n)
    np.testing.assert_allclose(np.linalg.norm(w, axis=1), 1, atol=1e-12)
    assert w.shape == (n, 3) and w[:, 2].min() > 0
    for k in (1, 2, 4):
        # midpoints of z^2: an error of 1 / n^2, and n^-1.5 at the horizon where the root of 1 - u has its end
        assert np.mean(w[:, 2] ** k) == pytest.approx(2 / (k + 2), abs=n**-1.5)
    # Vogel's spiral is even to a cell in every direction: 1 / n, with a small factor
    assert np.abs(w[:, :2].mean(0)).max() < 3 / n
    np.testing.assert_allclose((w[:, :2] ** 2).mean(0), 0.25, atol=5 / n)
    assert np.abs(np.mean(w[:, 0] * w[:, 1])) < 5 / n


# --- the training set -------------------------------------------------------------------------------------------------


def mixtures(tmp_path, **options):
    source = {"kind": "nps-mixtures", "path": NPS, "count": 12, **options}
    return build([source], n_samples=400, seed=7, cache=tmp_path)


def test_assorted_in_a_training_set(tmp_path):
    s = build([{"kind": "assorted", "count": 3}], n_samples=100, seed=5, cache=tmp_path)
    assert s.names == ["assorted_5", "assorted_6", "assorted_7"] and s.kinds == ["assorted"] * 3
    np.testing.assert_allclose(s.material(2).f, assorted(7, 100).f, rtol=1e-6)  # float32
    again = build([{"kind": "assorted", "count": 3}], n_samples=100, seed=5, cache=tmp_path)
    assert np.array_equal(again.samples, s.samples) and len(list(tmp_path.iterdir())) == 1


def test_unknown_kind_is_refused_with_the_choices(tmp_path):
    with pytest.raises(ValueError, match='kind "assort" is unknown. Choose one of: nps, .*two-lobes, assorted, .*file'):
        build([{"kind": "assort", "count": 1}], n_samples=10, seed=0, cache=tmp_path)


def test_warped_mixtures_are_mixtures_times_their_warp(tmp_path):
    plain, warped = mixtures(tmp_path), mixtures(tmp_path, warp=True)
    assert plain.names == warped.names
    for k in range(12):
        a, b = plain.material(k), warped.material(k)
        assert np.array_equal(a.wi, b.wi)
        expected = np.minimum(a.f * warp(a.wi, a.wo, 7 + k), 1e4)
        np.testing.assert_allclose(b.f, expected, rtol=1e-5)  # stored as float32, cosines of 0.01 in a logarithm


@pytest.mark.slow
def test_albedo_of_mixtures_is_scaled_into_the_range(tmp_path):
    """Seen from above, brightest channel; what is darker than 1/30 of what was asked for stays dark."""
    names, latents = nps.read_latents(NPS)
    decoder, plain, wo = (
        nps.read_decoder("mi_enhance/bundled/nps/decoder.npz"),
        mixtures(tmp_path),
        sample_cosine(20_000),
    )
    albedo = []
    for k in range(12):
        rng = np.random.default_rng(7 + k)
        i, j = rng.choice(len(names), 2, replace=False)
        t = rng.random()
        f = nps.decode(decoder, (1 - t) * latents[i] + t * latents[j], np.tile((0.0, 0.0, 1.0), (len(wo), 1)), wo)
        albedo.append(np.pi * f.mean(0).max())
    for low, high in ((0.5, 0.5), (0.2, 0.7)):
        scaled, found = mixtures(tmp_path, albedo=[low, high]), []
        for k in range(12):
            a, b = plain.material(k).f, scaled.material(k).f
            factor = b[a > 1e-4] / a[a > 1e-4]
            assert np.ptp(factor) < 1e-4 * factor.mean() and factor.mean() < 30.01  # one number for all of a material
            found.append(albedo[k] * factor.mean())
        # 5 %: a narrow highlight falls between 512 directions, and 20,000 random ones scatter
        assert 0.95 * low < min(found) and max(found) < 1.05 * high
        if low == high:
            assert np.median(found) == pytest.approx(low, rel=0.01)
        else:
            assert np.ptp(found) > 0.5 * (high - low)


def sample_cosine(n):
    """Random directions of density cos / pi."""
    u, phi = np.random.default_rng(0).random(n), np.random.default_rng(1).random(n) * 2 * np.pi
    return np.stack([np.sqrt(u) * np.cos(phi), np.sqrt(u) * np.sin(phi), np.sqrt(1 - u)], 1)


def test_measurements_accept_every_kind(tmp_path):
    """Stored and read back: unit vectors above the horizon, finite and not negative."""
    s = build(
        [{"kind": k, "count": 2} for k in ("assorted", "two-lobes", "synthetic")], n_samples=50, seed=1, cache=tmp_path
    )
    for k in range(6):
        assert isinstance(s.material(k), data.Measurements)
