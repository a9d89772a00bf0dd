"""What samples leave open: the prior of the training materials, reciprocity on demand, colours that mean something."""

from __future__ import annotations

import dataclasses

import mi_enhance  # noqa: F401  (before mitsuba)

import mitsuba as mi  # isort: skip
import numpy as np
import pytest
import twin

from mi_enhance import Material, enhance, fit
from mi_enhance.analytic import parameter_space, parameters
from mi_enhance.data.directions import rusinkiewicz_to_directions, sample_pairs
from mi_enhance.data.measurements import Measurements
from mi_enhance.fitting.library_prior import Prior, coverage, from_library, weight
from mi_enhance.material.colour_normalization import normalize, plain
from mi_enhance.neural import mlp

SAME = 2e-5  # relative: a constant moved from a colour into an exponent, in float32


def network(seed=0, latent=4, strength=0.3):
    """A small network of ggx2 with a library of 30 materials around a mean."""
    brdf = enhance("ggx2", ("B", "G", "G2"), n_latent=latent, hidden=(8, 8), inputs="shape", modulated=True, seed=seed)
    weaker = strength * mlp.flatten(brdf.modules)
    brdf = dataclasses.replace(brdf, modules=mlp.unflatten(brdf.modules, weaker))
    rng = np.random.default_rng(seed)
    first = parameters.flatten(brdf.parameters, parameters.initial(brdf.parameters))
    library = np.tile(first, (30, 1))
    names = [p.name for p in brdf.parameters for _ in range(p.size)]
    moving = [name in ("latent", "alpha_x", "alpha_y") for name in names]
    library[:, moving] *= np.exp(rng.normal(0, 0.3, (30, sum(moving))))
    library[:, names.index("asymmetry")] = rng.normal(0, 0.7, 30)
    return Material(brdf, {}, library=library)


def measured(material, wi, wo):
    return Measurements(wi, wo, material.evaluate(wi, wo), "synthetic", "test")


def retro(n, seed=0):
    """Pairs within 3 degrees of each other, above the horizon."""
    rng = np.random.default_rng(seed)
    angle = lambda top: rng.uniform(0, top, n)  # noqa: E731
    wi, wo = rusinkiewicz_to_directions(angle(1.3), angle(6.28), angle(0.025), angle(6.28))
    return wi, wo


def test_coverage_is_the_part_of_the_angles_visited():
    everywhere = sample_pairs(20_000)
    assert 0.7 < coverage(*everywhere) <= 1
    assert coverage(*retro(20_000)) < 12 / 144  # one of twelve rows of theta_d
    assert coverage([[0, 0, 1]], [[0, 0, 1]]) == pytest.approx(1 / 144)


def test_prior_is_a_gaussian_over_shape_and_latent_numbers(llvm):
    material = network()
    prior = from_library(material, weight(*sample_pairs(500), 0.02))
    space = parameter_space.Space(material.brdf.parameters)
    u = space.to_free(material.library)
    assert prior.loss(u.mean(0)[None])[0] == pytest.approx(0, abs=1e-20)
    coloured = u.mean(0) + np.concatenate(
        [np.full(p.size, 0.3 if p.size == 3 else 0) for p in material.brdf.parameters]
    )
    assert prior.loss(coloured[None])[0] == pytest.approx(0, abs=1e-20)  # colours are free
    assert (prior.loss(u) > 0).all()
    numeric = twin.central_differences(lambda x: prior.loss(x[None])[0], u[3], step=1e-5)
    np.testing.assert_allclose((u[3] - prior.mean) @ prior.precision, numeric, rtol=1e-5, atol=1e-12)


def test_priors_add_up():
    """The sum differs from the two losses by a constant; one prior, or one for each of several problems."""
    rng = np.random.default_rng(0)
    a, b = Prior(rng.normal(size=3), np.diag([1.0, 2.0, 0.0])), Prior(rng.normal(size=(4, 3)), np.diag([3.0, 0.0, 0.0]))
    u = rng.normal(size=(2, 4, 3))
    first, second = ((a + b).loss(v) - a.loss(v) - b.loss(v) for v in u)
    np.testing.assert_allclose(first, second, atol=1e-9)
    np.testing.assert_allclose((a + b).of(np.array([2, 2])).loss(u[0, :2]), (a + b.of(np.array([2, 2]))).loss(u[0, :2]))


def test_retro_reflective_samples_leave_the_rest_to_the_training_materials(llvm):
    """Latent numbers that the samples say nothing about stay near the library; without it they wander."""
    truth = network().edit(rho_d=0.3, rho_s=0.5, rho_s2=0.1)
    samples = measured(truth, *retro(800))
    with_prior = fit(network(), samples)
    without = fit(dataclasses.replace(network(), library=None), samples)
    wi, wo = sample_pairs(3000, seed=9)
    error = {
        name: np.abs(np.log1p(truth.evaluate(wi, wo)) - np.log1p(m.evaluate(wi, wo))).mean()
        for name, m in (("with", with_prior), ("without", without))
    }
    assert error["with"] < error["without"]


def test_a_library_of_one_material_is_a_start_and_no_prior(llvm):
    """As of a network that was trained on one file: it has no variances, and the fit must not be NaN."""
    alone = dataclasses.replace(network(), library=network().library[:1])
    assert not from_library(alone, 1.0).precision.any()
    samples = measured(network().edit(rho_d=0.3, rho_s=0.5), *sample_pairs(500))
    found = fit(alone, samples)
    assert np.isfinite(found.as_vector()).all() and found.report["log_l1"] <= found.report["log_l1_analytic"]


def test_reciprocal_fit_is_reciprocal_and_the_other_follows_the_file(llvm):
    truth = network(strength=1.0).edit(rho_d=0.5, asymmetry=1.5)
    wi, wo = sample_pairs(2000, seed=3)
    samples = measured(truth, wi, wo)
    free, held = fit(network(strength=1.0), samples), fit(network(strength=1.0), samples, reciprocal=True)
    assert held.report["reciprocal"] and not free.report["reciprocal"]
    np.testing.assert_allclose(held.evaluate(wi, wo), held.evaluate(wo, wi), rtol=1e-5)
    assert free.report["log_l1"] < 0.5 * held.report["log_l1"]


def test_networks_of_raw_directions_cannot_be_held_reciprocal(llvm):
    raw = Material(enhance("ggx", hidden=(4,), inputs="directions"), {})
    with pytest.raises(ValueError, match="reads raw directions .* Choose a network with symmetric or shape inputs"):
        fit(raw, measured(Material.analytic("ggx"), *sample_pairs(50)), reciprocal=True)


@pytest.mark.parametrize("seed", range(3))
def test_normalized_material_is_the_same_brdf(llvm, seed):
    material = network(seed, strength=1.0).edit(rho_d=(0.1, 0.2, 0.3), rho_s=0.4, rho_s2=(0.2, 0.1, 0.05), F0=0.2)
    normal = normalize(material)
    wi, wo = sample_pairs(3000, seed=seed)
    np.testing.assert_allclose(normal.evaluate(wi, wo), material.evaluate(wi, wo), rtol=SAME)
    np.testing.assert_allclose(plain(normal).as_vector(), material.as_vector(), rtol=1e-9, atol=1e-12)
    assert normal.params["norm_B"] != 0


def test_normalized_diffuse_colour_is_the_albedo(llvm):
    """rho_d of a material without lobes, against a quadrature that knows nothing of sampling.py."""
    material = normalize(network(2, strength=1.0).edit(rho_d=(0.1, 0.2, 0.3), rho_s=0, rho_s2=0))
    rng = np.random.default_rng(1)
    w = rng.normal(size=(2, 60_000, 3))
    w /= np.linalg.norm(w, axis=-1, keepdims=True)
    w[..., 2] = np.abs(w[..., 2])
    wi, wo = w[0], w[1]
    # even light: 1/pi of int int f cos cos; uniform directions have the density 1 / (2 pi) each
    albedo = (material.evaluate(wi, wo) * (wi[:, 2:] * wo[:, 2:])).mean(0) * 4 * np.pi
    np.testing.assert_allclose(albedo, material.params["rho_d"], rtol=0.02)  # 60,000 random pairs


def test_a_colour_is_never_scaled_out_of_its_range(llvm):
    bright = network(5, strength=1.0).edit(rho_d=1.0)
    normal = normalize(bright)
    assert normal.params["rho_d"].max() <= 1
    wi, wo = sample_pairs(500)
    np.testing.assert_allclose(normal.evaluate(wi, wo), bright.evaluate(wi, wo), rtol=SAME)


def test_fixed_parameters_are_left_alone(llvm):
    space = parameter_space.Space([parameters.F0, parameters.norm("B")], hold=("F0",))
    assert (space.low == space.high).all() and space.low.tolist() == [0.04, 0.0]


def test_analytic_materials_have_nothing_to_normalize(llvm):
    material = Material.analytic("ggx").edit(rho_d=0.7)
    assert np.array_equal(normalize(material).as_vector(), material.as_vector())
    assert mi.variant() == "llvm_ad_rgb"
