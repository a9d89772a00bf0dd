"""Made-up kinds of training materials: reciprocal, no more light than there is, and each with what it is named for."""

from __future__ import annotations

import functools

import numpy as np
import pytest

from mi_enhance.data import optics
from mi_enhance.data.directions import direction, half_difference, sample_pairs, with_peaks
from mi_enhance.data.lobe_material import Lobe, Material
from mi_enhance.data.made_up import KINDS, material, measured
from mi_enhance.data.random_terms import assorted
from mi_enhance.data.synthetic import ggx_anisotropic, two_lobes
from mi_enhance.training.sources import build

SEEDS = range(12)
ROUNDING = 1e-9  # float64 sums in another order, through exponentials


def pairs(n=300):
    return (w.astype(np.float64) for w in sample_pairs(n, seed=2))


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_is_reciprocal_finite_and_repeatable(kind):
    wi, wo = pairs()
    for seed in SEEDS:
        m = material(kind, seed)
        f = m(wi, wo)
        assert f.shape == (300, 3) and np.isfinite(f).all() and (f >= 0).all()
        np.testing.assert_allclose(m(wo, wi), f, rtol=ROUNDING, err_msg=f"{kind} {seed}")
    again, other = measured(kind, 3, 50), measured(kind, 4, 50)
    assert np.array_equal(again.f, measured(kind, 3, 50).f) and not np.array_equal(again.f, other.f)


@pytest.mark.parametrize("kind", KINDS)
def test_no_kind_reflects_more_light_than_there_is(kind):
    """Albedo below 1.05 also between the angles that are looked at when a material is drawn."""
    for seed in SEEDS:
        m = material(kind, seed)
        albedo = np.array([m.albedo(np.radians(a)) for a in (0, 10, 35, 60)])
        assert 0.002 < albedo.max() < 1.05 and albedo.min() > 0, f"{kind} {seed}"


def test_albedo_is_that_of_a_mirror_however_sharp():
    """D G F over all directions: 1 for F = 1, but for what shadowing takes (nothing at roughness 0.003)."""
    for lobe in (Lobe(0.003, 0.003), Lobe(0.03, 0.003, 0.7), Lobe(0.003, 0.003, back=True), Lobe(0.01, 0.01, tail=3.0)):
        white = Material(((lobe, lambda cos: np.ones((len(cos), 3))),), lambda i, o: np.zeros((len(i), 3)))
        # 2 %: samples of GGX under another tail
        np.testing.assert_allclose(white.albedo(0.5), 1, atol=0.02)
    grey = Material((), lambda i, o: np.full((len(i), 3), 0.5 / np.pi))
    np.testing.assert_allclose(grey.albedo(1.0), 0.5, atol=0.005)


@pytest.mark.parametrize("kind", ["thin-film", "coated", "near-mirror", "anisotropic"])
def test_the_peak_is_at_the_mirror_direction(kind):
    """At 30 degrees, along the plane of incidence: a lobe of Fresnel, shadowing and cosines moves it by its width."""
    theta = np.radians(np.linspace(1, 80, 1581))
    wo = direction(theta, 0.3)
    for seed in SEEDS:
        m = material(kind, seed)
        sharp = m.lobes[0][0]
        if sharp.alpha_x > 0.1:
            continue
        f = m(np.broadcast_to(direction(np.radians(30), 0.3 + np.pi), wo.shape), wo).sum(1)
        assert abs(theta[np.argmax(f)] - np.radians(30)) < max(sharp.alpha_x, 0.001), f"{kind} {seed}"


def test_the_hue_of_a_thin_film_turns_with_the_angle():
    """Which channel is the brightest in the mirror direction changes from 0 to 80 degrees, for most films."""
    theta = np.radians(np.linspace(0, 80, 41))
    turned = 0
    for seed in range(40):
        (_, film), *_ = material("thin-film", seed).lobes
        brightest = np.argmax(film(np.cos(theta)), 1)
        turned += len(set(brightest)) > 1
    assert turned > 20
    metal = optics.conductor(np.cos(theta)[:, None], *optics.metal_index([0.9, 0.7, 0.4], 0.5))
    assert (np.diff(metal) < 0).all()  # a metal's order stays


def test_a_film_is_its_base_without_thickness_and_swings_about_it_by_the_wavelength():
    cos = np.linspace(0.05, 1, 20)
    bare = optics.dielectric(cos, 1.5)
    np.testing.assert_allclose(optics.thin_film(cos, 0.0, 2.0, 1.5 + 0j)[:, 0], bare, rtol=1e-9)
    # a quarter of the wave in a film of the root of both indices: no reflection (Born and Wolf, section 1.6.4)
    green = optics.WAVELENGTHS[1, 1]
    assert optics.thin_film([1.0], green / 4 / np.sqrt(1.5), np.sqrt(1.5), 1.5 + 0j)[0, 1] < 1e-4


def test_a_coat_hides_its_base_at_grazing_angles():
    """The colour of the base goes, off the highlight, as both Fresnel terms take the light."""
    for seed in SEEDS:
        m = material("coated", seed)
        wi = direction(np.radians([20, 88]), np.pi / 2)
        f = m.base(wi, direction(np.radians([25, 88]), 0.0))
        assert (f[1] < 0.25 * f[0]).all()


def test_cloth_is_brighter_at_grazing_angles_and_has_no_highlight():
    for seed in SEEDS:
        m = material("cloth", seed)
        assert m.lobes == ()
        f = m(direction([0.3, 1.4], 0.0), direction([0.3, 1.4], np.pi))
        back = m(direction([1.4], 0.0), direction([1.4], 0.0))
        assert (back > f[0]).all()


def test_retro_materials_shine_back():
    """At 50 degrees more light goes back than to a place as far from the mirror direction."""
    for seed in SEEDS:
        m = material("retro", seed)
        wi = direction([0.9, 0.9], 0.0)
        f = m(wi, direction([0.9, 0.9], [0.0, np.pi / 2])).sum(1)
        assert f[0] > f[1]


def test_anisotropic_materials_change_when_both_directions_turn():
    turn = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]])
    wi, wo = pairs()
    ratios = []
    for seed in SEEDS:
        m = material("anisotropic", seed)
        assert np.abs(m(wi @ turn, wo @ turn) / m(wi, wo) - 1).max() > 0.1
        ratios.append(m.lobes[0][0].alpha_x / m.lobes[0][0].alpha_y)
    assert min(ratios) > 1.4 and 8 < max(ratios) < 21


def test_a_share_of_the_pairs_sees_the_peak():
    """Within a lobe of 0.01 lies half of GGX's normals, and 1 % of pairs uniform in the half angle."""
    rng = np.random.default_rng(0)
    plain = sample_pairs(4000, seed=rng)
    state = rng.bit_generator.state
    assert with_peaks(*plain, 0, rng) == plain
    axes = Lobe(0.01, 0.01, 0.4).axes
    for share in (0.3, 1.0):
        wi, wo = with_peaks(*plain, share, rng, alpha=(0.01, 0.01), axes=axes)
        kept = (wi == plain[0]).all(1)
        assert abs(kept.mean() - (1 - share)) < 0.03  # four standard deviations of 4000 draws
        assert min(wi[:, 2].min(), wo[:, 2].min()) >= np.float32(0.01)
        inside = np.mean(half_difference(wi[~kept], wo[~kept])[0] < 0.01)
        assert abs(inside - 0.5) < 0.06
    assert rng.bit_generator.state == state  # what comes after does not depend on the share


def noiseless_ggx(*args, **options):
    return ggx_anisotropic(*args, noise=0, **options)[0]


@pytest.mark.parametrize("draw", [noiseless_ggx, two_lobes, assorted, functools.partial(measured, "retro")])
def test_peaks_leave_the_material_as_it_is(draw):
    plain, peaked = draw(5, 400), draw(5, 400, peaks=0.3)
    same = (plain.wi == peaked.wi).all(1)
    assert 200 < same.sum() < 360
    np.testing.assert_allclose(peaked.f[same], plain.f[same], rtol=1e-6)


def test_new_kinds_in_a_training_set(tmp_path):
    sources = [{"kind": kind, "count": 1, "peaks": 0.3} for kind in KINDS]
    s = build(sources, n_samples=60, seed=1, cache=tmp_path)
    assert s.kinds == list(KINDS) and s.names[0] == "thin-film_1"
    assert all(len(s.material(k).f) == 60 for k in range(len(KINDS)))
    with pytest.raises(ValueError, match="peaks is 1.5; it must be a number from 0 to 1"):
        build([{"kind": "cloth", "count": 1, "peaks": 1.5}], n_samples=60, seed=1, cache=tmp_path)


def test_half_vectors_of_peaks_are_uniform_in_the_difference_angle():
    """theta_d of pairs in a peak: as without, where the horizon takes nothing."""
    rng = np.random.default_rng(1)
    wi, wo = with_peaks(*sample_pairs(3000, seed=rng), 1.0, rng, alpha=(0.003, 0.003))
    theta_d = np.arccos(np.minimum(half_difference(wi, wo)[2][:, 2], 1))
    assert abs(theta_d.mean() - np.pi / 4) < 0.05
