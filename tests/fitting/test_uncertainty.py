"""What a fit says of its own certainty: against repeated fits of noisy data, and for samples that leave things open."""

from __future__ import annotations

import numpy as np
import pytest
import twin

import mi_enhance  # noqa: F401  (before mitsuba)
from mi_enhance import Material, enhance, fit
from mi_enhance.data.directions import sample_pairs
from mi_enhance.data.measurements import Measurements
from mi_enhance.fitting.uncertainty import determined

TRUTH = {
    "n_x": 0.0, "n_y": 0.0, "t_theta": 0.0, "rho_d": [0.3, 0.2, 0.1], "rho_s": [0.6, 0.8, 1.0],
    "alpha_x": 0.3, "alpha_y": 0.3, "F0": 0.3,
}  # fmt: skip


def noisy(b, seed, n=1500, **changed):
    """Samples of GGX whose logarithms are off by Laplace noise of mean size b, as the loss sees them."""
    wi, wo = sample_pairs(n, seed=0, min_cos=0.1)
    cos = wo[:, 2:].astype(np.float64)
    logs = np.log1p(twin.brdf(wi, wo, {**TRUTH, **changed}) * cos)
    noise = np.random.default_rng(seed).laplace(0, b, (n, 3)) if b else 0.0
    return Measurements(wi, wo, np.maximum(np.expm1(logs + noise), 0) / cos)


def open_names(material):
    return {name.partition(".")[0] for name in material.report["undetermined"]}


def test_standard_deviations_are_those_of_repeated_fits(llvm):
    fits = [fit(Material.analytic("ggx").edit(**TRUTH), noisy(0.005, seed)) for seed in range(16)]
    for name in ("rho_d", "rho_s", "F0", "n_x"):  # alpha: one of two axes, t_theta: of an isotropic material
        values = np.array([m.params[name] for m in fits])
        predicted = np.median([m.report["std"][name] for m in fits], axis=0)
        # 16 fits know their own spread to a fifth; the loss is rounded off below a tenth of its mean
        np.testing.assert_array_less(0.5, values.std(0) / predicted)
        np.testing.assert_array_less(values.std(0) / predicted, 2)


def test_of_an_isotropic_material_only_the_turn_is_open(llvm):
    assert determined(Material.analytic("ggx").edit(**TRUTH), noisy(0, 0), 0.01)[1] == ["t_theta"]


def test_the_turn_of_an_isotropic_material_is_open_and_that_of_another_is_not(llvm):
    m = fit(Material.analytic("ggx").edit(**TRUTH), noisy(0.002, 1, alpha_x=0.1, alpha_y=0.5))
    assert "t_theta" not in open_names(m) and m.report["std"]["t_theta"][0] < 0.05


def test_a_black_material_says_nothing_of_its_lobe(llvm):
    wi, wo = sample_pairs(500, seed=1)
    m = fit(Material.analytic("ggx"), Measurements(wi, wo, np.zeros((500, 3))))
    assert {"alpha_x", "alpha_y", "t_theta"} <= open_names(m) and "rho_d" not in open_names(m)
    assert "not determined by the samples: " in m.show() and "t_theta" in m.show()


def test_one_sample_determines_next_to_nothing(llvm):
    m = fit(Material.analytic("ggx"), Measurements([[0, 0, 1]] * 9, [[0.6, 0, 0.8]] * 9, [[0.2, 0.3, 0.4]] * 9))
    assert len(m.report["undetermined"]) >= 12 - 3  # three numbers were measured
    assert np.isfinite(np.concatenate(list(m.report["std"].values()))).all()


def test_more_and_better_samples_determine_more(llvm):
    material = Material.analytic("ggx").edit(**TRUTH)
    few, many = (determined(material, noisy(0, 0, n), 0.01)[0] for n in (200, 3200))
    rough = determined(material, noisy(0, 0, 3200), 0.04)[0]
    for name in ("rho_d", "alpha_x", "F0"):
        assert np.divide(few[name], many[name]) == pytest.approx(4, rel=0.3)
        assert np.divide(rough[name], many[name]) == pytest.approx(4, rel=0.1)


def test_latent_numbers_count_one_by_one_and_what_was_held_does_not(llvm):
    brdf = enhance("ggx2", ("B",), inputs="shape", n_latent=3, hidden=(4,), seed=1)
    wi, wo = sample_pairs(300, seed=1)
    std, undetermined = determined(Material(brdf, {}), Measurements(wi, wo, np.ones((300, 3))), 0.1, ("asymmetry",))
    assert {"rho_s2.R", "alpha_x2", "t_theta"} & set(undetermined) and "norm_B" not in undetermined
    assert len(std["latent"]) == 3 and std["asymmetry"] == [0.0] and "asymmetry" not in undetermined
    free = determined(Material(brdf, {}), Measurements(wi, wo, np.ones((300, 3))), 0.1)[0]
    assert free["asymmetry"][0] > 0


@pytest.mark.slow
def test_colours_are_told_for_the_factors_as_they_are(llvm):
    """A constant could move from a read-out into the colour; yet rho_d is the albedo, which the samples tell."""
    wi, wo = sample_pairs(2000, seed=1)
    m = fit(Material.pretrained(), Measurements(wi, wo, np.full((len(wi), 3), 0.2), "even"))
    np.testing.assert_allclose(m.params["rho_d"], 0.2 * np.pi, rtol=0.02)
    assert "rho_d" not in open_names(m)
    assert max(m.report["std"]["rho_d"]) < 0.02
