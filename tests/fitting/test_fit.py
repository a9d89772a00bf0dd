"""Fits: known materials come back, and nothing a file may hold makes a fit fail or return nonsense."""

from __future__ import annotations

import mitsuba as mi
import numpy as np
import pytest
import twin

from mi_enhance.data.directions import sample_pairs
from mi_enhance.data.measurements import Measurements, clamp_negative
from mi_enhance.fitting.fit import fit
from mi_enhance.material.material import Material
from mi_enhance.neural.enhance import enhance
from mi_enhance.specialization.fit_best import fit_best

RECOVERED = 2e-4  # log-L1 of a fit to what the model can be: 1 % of what GGX leaves on measured materials
SMALL = {"hidden": (8, 8), "n_latent": 4}  # kernels of a small network compile quickly; the code is the same
N = 2000


def measured(f_of, n=N, seed=5, **record):
    wi, wo = sample_pairs(n, seed=seed, min_cos=0.05)
    return Measurements(wi, wo, f_of(wi, wo), **record)


def analytic_truth(alpha=(0.2, 0.2), frame=(0.0, 0.0, 0.0)):
    return {
        "n_x": frame[0], "n_y": frame[1], "t_theta": frame[2], "rho_d": [0.3, 0.2, 0.05], "rho_s": [0.6, 0.8, 1.0],
        "alpha_x": alpha[0], "alpha_y": alpha[1], "F0": 0.2,
    }  # fmt: skip


def network_material(seed=1):
    """A network, and a material of it with parameters of its own."""
    brdf = enhance("ggx", seed=seed, **SMALL)
    p = twin.parameters(1, seed=7, latent=4, alpha=(0.1, 0.4), tilt=0.05)
    return Material(brdf, {}), Material(brdf, {k: v[0] for k, v in p.items()})


def check_sound(material, m):
    """The report is what the material does, and all of it is finite."""
    value = twin.log_l1(
        material.evaluate(m.wi, m.wo).astype(np.float64), m.f.astype(np.float64), m.wo[:, 2].astype(np.float64)
    )
    assert np.isfinite(material.as_vector()).all() and np.isfinite(value)
    assert material.report["log_l1"] == pytest.approx(value, rel=1e-3, abs=1e-6)
    assert np.isfinite(material.lobe_albedo) and material.lobe_albedo >= 0
    for p in material.brdf.parameters:
        assert p.low <= material.params[p.name].min() and material.params[p.name].max() <= p.high


@pytest.mark.parametrize(
    "alpha, frame",
    [((0.2, 0.2), (0, 0, 0)), ((0.1, 0.4), (0, 0, 0.7)), ((0.3, 0.08), (0.1, -0.05, -1.2)), ((0.03, 0.03), (0, 0, 0))],
    ids=["isotropic", "anisotropic", "tilted", "glossy"],
)
def test_known_ggx_is_recovered(llvm, alpha, frame):
    truth = analytic_truth(alpha, frame)
    m = measured(lambda wi, wo: twin.brdf(wi, wo, truth))
    fitted = fit(Material.analytic("ggx"), m)
    assert fitted.report["log_l1"] < RECOVERED
    check_sound(fitted, m)
    wi, wo = sample_pairs(N, seed=77, min_cos=0.05)  # and where nothing was measured
    got = fitted.evaluate(wi, wo).astype(np.float64)
    assert twin.log_l1(got, twin.brdf(wi, wo, truth), wo[:, 2].astype(np.float64)) < 2 * RECOVERED
    np.testing.assert_allclose(fitted.params["rho_d"], truth["rho_d"], atol=0.02)
    assert sorted([fitted.params["alpha_x"][0], fitted.params["alpha_y"][0]]) == pytest.approx(sorted(alpha), rel=0.05)


def test_enhanced_material_is_recovered(llvm):
    """Of a random network: GGX cannot say what it says, the network itself can."""
    network, truth = network_material()
    m = measured(truth.evaluate)
    report = fit(network, m).report
    assert report["log_l1"] < 0.1 * report["log_l1_analytic"]
    assert report["log_l1"] < 5e-3


def test_same_seed_gives_the_same_material(llvm):
    network, truth = network_material()
    m = measured(truth.evaluate, 5000)
    a, b = fit(network, m, seed=3), fit(network, m, seed=3)
    np.testing.assert_array_equal(a.as_vector(), b.as_vector())


def test_fitted_material_is_a_start_of_the_next_fit(llvm):
    """A second fit cannot be worse than the first."""
    network, truth = network_material()
    m = measured(truth.evaluate)
    first = fit(network, m)
    assert fit(first, m).report["log_l1"] <= first.report["log_l1"] * (1 + 1e-6)


def test_report_says_what_the_command_line_promises(llvm):
    network, truth = network_material()
    m = measured(truth.evaluate, 300, name="gold", source="made here", clamped_fraction=0.25)
    report = fit(network, m, seed=4).report
    assert report["model"] == "M + S * D * [F] [*] [G] * [1/E]"
    assert (report["n_samples"], report["n_parameters"]) == (300, 12 + 4)
    assert (report["name"], report["source"], report["clamped_fraction"]) == ("gold", "made here", 0.25)
    assert (report["method"], report["seed"]) == ("lm", 4)
    assert 0 < report["seconds_analytic"] < report["seconds"]
    assert report["log_l1_analytic"] == pytest.approx(
        fit(Material.analytic("ggx"), m, seed=4).report["log_l1"], rel=1e-4
    )


# ---------------------------------------------------------------------- stiff and hostile data


def stiff(kind):
    if kind == "black":
        return measured(lambda wi, wo: np.zeros((len(wi), 3)))
    if kind == "one sample":
        return Measurements(
            np.tile([[0, 0, 1]], (1000, 1)), np.tile([[0.6, 0, 0.8]], (1000, 1)), np.full((1000, 3), 0.2)
        )
    if kind == "three rows":
        return Measurements([[0, 0, 1]] * 3, [[0, 0, 1], [0.6, 0, 0.8], [0, 0.8, 0.6]], [[0.1, 0.2, 0.3]] * 3)
    if kind == "50 samples":
        return measured(lambda wi, wo: twin.brdf(wi, wo, analytic_truth()), 50)
    if kind == "near mirror":
        return measured(lambda wi, wo: twin.brdf(wi, wo, analytic_truth((0.003, 0.003))))
    if kind == "huge":
        return measured(lambda wi, wo: np.full((len(wi), 3), 1e30))
    rng = np.random.default_rng(0)  # a third of the values was negative
    wi, wo = sample_pairs(N, seed=5, min_cos=0.05)
    f, share = clamp_negative(rng.normal(0.05, 0.1, (N, 3)))
    assert 0.25 < share < 0.4
    return Measurements(wi, wo, f, clamped_fraction=share)


@pytest.mark.parametrize("model", ["analytic", "enhanced"])
@pytest.mark.parametrize(
    "kind", ["black", "one sample", "three rows", "50 samples", "near mirror", "huge", "clamped noise"]
)
def test_stiff_data_gives_a_sound_material_no_worse_than_the_start(llvm, kind, model):
    start = Material.analytic("ggx") if model == "analytic" else network_material()[0]
    m = stiff(kind)
    fitted = fit(start, m)
    check_sound(fitted, m)
    before = twin.log_l1(
        start.evaluate(m.wi, m.wo).astype(np.float64), m.f.astype(np.float64), m.wo[:, 2].astype(np.float64)
    )
    assert fitted.report["log_l1"] <= before * (1 + 1e-5)
    if kind in ("black", "one sample", "three rows"):  # any albedo does
        assert fitted.report["log_l1"] < 1e-3
    if kind == "near mirror":
        assert fitted.report["log_l1"] < 0.1 * before


def test_operators_alone_can_be_fitted(llvm):
    """A state of the search: no network reads parameters, so there are none to add to the twelve."""
    network = Material(enhance("ggx", ("F*G",), hidden=(4,)), {})
    m = measured(lambda wi, wo: twin.brdf(wi, wo, analytic_truth()), 200)
    assert fit(network, m).report["n_parameters"] == 12


# ---------------------------------------------------------------------- the reference method, and what is refused


def test_rmsprop_improves_on_the_default_start_and_lm_on_rmsprop(llvm):
    m = measured(lambda wi, wo: twin.brdf(wi, wo, analytic_truth()), 500)
    start = Material.analytic("ggx")
    report = fit(start, m, method="rmsprop").report
    before = twin.log_l1(
        start.evaluate(m.wi, m.wo).astype(np.float64), m.f.astype(np.float64), m.wo[:, 2].astype(np.float64)
    )
    assert report["method"] == "rmsprop" and report["log_l1"] == report["log_l1_analytic"]
    assert fit(start, m).report["log_l1"] < report["log_l1"] < 0.9 * before


@pytest.mark.parametrize("function", [fit, fit_best])
def test_what_is_no_material_or_no_measurements_is_named(function):
    with pytest.raises(TypeError, match=r"fit.*\(\): material is 'ggx', of type str; .* Get one by Material"):
        function("ggx", None)
    with pytest.raises(TypeError, match=r"measurements is 'gold.csv', of type str; .* Get one by data.load"):
        function(Material.analytic("ggx"), "gold.csv")


def test_unknown_method_is_refused():
    with pytest.raises(ValueError, match=r'fit\(\): method "sgd" is unknown\. Choose one of: lm, rmsprop\.'):
        fit(Material.analytic("ggx"), stiff("three rows"), method="sgd")


@pytest.mark.parametrize("variant", ["llvm_ad_spectral", "llvm_mono", "scalar_rgb"])
def test_variant_without_rgb_gradients_is_refused(llvm, variant):
    if variant not in mi.variants():
        pytest.skip(f"{variant} is not part of this Mitsuba")
    mi.set_variant(variant)
    with pytest.raises(
        RuntimeError, match=rf'fit\(\): needs an RGB variant with gradients; "{variant}" is active\. Call'
    ):
        fit(Material.analytic("ggx"), stiff("three rows"))


def test_progress_tells_stage_step_and_loss(llvm):
    seen = []
    m = measured(lambda wi, wo: twin.brdf(wi, wo, analytic_truth()), 200)
    fit(Material.analytic("ggx"), m, progress=seen.append)
    assert len(seen) > 3 and {p.stage for p in seen} == {"analytic, 200 samples"}
    assert all(1 <= p.step <= p.total and np.isfinite(p.values["loss"]) for p in seen)
