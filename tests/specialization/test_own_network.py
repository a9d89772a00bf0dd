"""Networks of a material's own in RGB: exact gradients, better than the shared one, reversible, reciprocal."""

from __future__ import annotations

import dataclasses
import functools

import mitsuba as mi
import numpy as np
import pytest

from mi_enhance.data.directions import sample_pairs
from mi_enhance.data.measurements import Measurements
from mi_enhance.fitting.losses import log_l1
from mi_enhance.material.material import Material
from mi_enhance.neural.enhance import with_trunk
from mi_enhance.numerics import levenberg_marquardt
from mi_enhance.specialization import own_network as own
from mi_enhance.specialization.fit_best import fit_best
from mi_enhance.specialization.specialize import specialize


@functools.lru_cache
def truth() -> Measurements:
    """A satin whose highlight turns hue with theta_d."""
    mi.set_variant("llvm_ad_rgb")
    wi, wo = sample_pairs(6000, seed=1)
    base = Material.analytic("ggx").edit(rho_d=(0.3, 0.2, 0.1), rho_s=0.4, alpha_x=0.3, alpha_y=0.3, F0=0.2)
    cos_d = np.linalg.norm(wi + wo, axis=1)[:, None] / 2
    hue = np.exp(np.array([1.5, 0.0, -1.5]) * (cos_d - 0.5))
    return Measurements(wi, wo, (base.evaluate(wi, wo) * hue).astype(np.float32), "hue", "made up")


@functools.lru_cache
def start() -> Material:
    mi.set_variant("llvm_ad_rgb")
    return Material.analytic("ggx2").edit(
        rho_d=(0.3, 0.2, 0.1), rho_s=0.4, alpha_x=0.3, alpha_y=0.3, rho_s2=0.02, F0=0.2
    )


@functools.lru_cache
def fitted() -> tuple[Material, float]:
    return own.own_network(start(), *own.divided(truth(), 0), (6, 6))


def test_gradients_are_central_differences_of_the_loss(llvm):
    problem = own._problems(start().edit(alpha_y=0.2, n_x=0.05), (4, 5), False, False)(truth(), 700)
    rng = np.random.default_rng(0)
    u = problem.first(rng)
    q = problem.moving.shape[1]
    u[q:] += rng.normal(0, 0.05, len(u) - q)
    epsilon = 0.05
    smooth = lambda v: float(np.sqrt(problem.residuals(v).astype(np.float64) ** 2 + epsilon**2).mean())  # noqa: E731
    _, g, loss = problem.normal_equations(u[None], np.array([epsilon]))
    np.testing.assert_allclose(loss[0], smooth(u), rtol=1e-5)
    for k in (2, 3, 6, 9, 11, 12, 16, q, q + 7, q + 40, q + 60, len(u) - 60, len(u) - 1):
        step = np.zeros_like(u)
        step[k] = 2e-3
        np.testing.assert_allclose(
            g[0, k], (smooth(u + step) - smooth(u - step)) / 4e-3, rtol=0.05, atol=2e-5, err_msg=str(k)
        )


def test_starts_as_the_analytic_model(llvm):
    problem = own._problems(start(), (4, 4), False, False)(truth(), 500)
    u = problem.first(np.random.default_rng(0))
    f = start().evaluate(truth().wi[:500], truth().wo[:500])
    error = log_l1(f, truth().f[:500], truth().wo[:500, 2])
    np.testing.assert_allclose(problem.loss(u[None])[0], error, rtol=1e-4)


def test_material_is_what_was_learned(llvm):
    m, error = fitted()
    _, unseen = own.divided(truth(), 0)
    assert error < 0.2 * log_l1(start().evaluate(unseen.wi, unseen.wo), unseen.f, unseen.wo[:, 2])
    np.testing.assert_allclose(log_l1(m.evaluate(unseen.wi, unseen.wo), unseen.f, unseen.wo[:, 2]), error, rtol=1e-3)
    # isotropic: one roughness, no frame, no input of the azimuth
    assert m.params["alpha_x"] == m.params["alpha_y"] and not m.params["n_x"]
    assert not [name for name in m.brdf.distilled[0].inputs if "azimuth" in name]


def test_file_and_plugin_give_the_same(llvm, tmp_path):
    m = own.finished(fitted()[0])
    m.save(tmp_path / "own.bsdf")
    again = Material.load(tmp_path / "own.bsdf")
    wi, wo = sample_pairs(2000, seed=3)
    np.testing.assert_array_equal(again.evaluate(wi, wo), m.evaluate(wi, wo))
    np.testing.assert_allclose(m.evaluate(wi, wo), fitted()[0].evaluate(wi, wo), rtol=1e-4, atol=1e-6)  # colours moved
    si = mi.SurfaceInteraction3f()
    si.wi = mi.Vector3f(wi.T.astype(np.float32))
    f = np.array(again.bsdf().eval(mi.BSDFContext(), si, mi.Vector3f(wo.T.astype(np.float32)))).T
    np.testing.assert_allclose(f, m.evaluate(wi, wo) * wo[:, 2:], rtol=2e-4, atol=1e-6)


@pytest.mark.parametrize("network", ["cook_torrance", "ward", "ggx2"])
def test_takes_the_place_of_all_shared_networks(llvm, network, tmp_path):
    """Also of those of other slots, and of the numbers that only they read."""
    shared = Material.pretrained(network)
    norms = {name: 0.5 for name in shared.params if name.startswith("norm_")}
    seen, unseen = own.divided(truth(), 0)
    m, error = own.own_network(shared.edit(alpha_x=0.3, alpha_y=0.3, **norms), seen, unseen, (4, 4))
    assert own.error_of(m, unseen) == pytest.approx(error, rel=1e-3)
    done = own.finished(m)
    np.testing.assert_allclose(done.evaluate(seen.wi, seen.wo), m.evaluate(seen.wi, seen.wo), rtol=1e-4, atol=1e-6)
    assert not m.brdf.evaluated and m.unspecialized.brdf.evaluated.keys() == shared.brdf.modules.keys()
    # a renderer is handed what is evaluated, and nothing of the networks that are not
    assert not {"latent", *norms} & set(done.bsdf().m_parameters.values)
    done.save(tmp_path / "own.bsdf")
    back = Material.load(tmp_path / "own.bsdf").unspecialized
    expected = shared.edit(alpha_x=0.3, alpha_y=0.3, **norms).evaluate(seen.wi, seen.wo)
    np.testing.assert_allclose(back.evaluate(seen.wi, seen.wo), expected, rtol=1e-4, atol=1e-6)


def test_networks_with_other_inputs_are_no_company(llvm):
    with pytest.raises(ValueError, match='inputs "symmetric".*Leave the measurements out'):
        specialize(Material.pretrained("paper"), truth())


def test_reciprocal_on_request(llvm):
    m, _ = own.own_network(start(), *own.divided(truth(), 0), (4, 4), reciprocal=True)
    wi, wo = sample_pairs(500, seed=4)
    np.testing.assert_allclose(m.evaluate(wi, wo), m.evaluate(wo, wi), rtol=2e-3, atol=1e-5)


@pytest.mark.slow
def test_best_is_chosen_on_samples_that_were_not_learned(llvm, tmp_path):
    network = Material(with_trunk("ggx2", hidden=(4, 4, 4)), {})  # not trained: worse than a network of its own
    m = fit_best(network, truth(), size=6)
    assert m.report["chosen"].startswith("own network 6-6") and m.brdf.distilled
    m.save(tmp_path / "best.bsdf")
    back = Material.load(tmp_path / "best.bsdf").unspecialized
    shared = fit_best(network, truth(), own="never")
    wi, wo = sample_pairs(500, seed=5)
    np.testing.assert_allclose(back.evaluate(wi, wo), shared.evaluate(wi, wo), rtol=1e-4, atol=1e-6)
    assert "chosen" not in back.report and back.report["log_l1"] == pytest.approx(shared.report["log_l1"], rel=1e-3)
    assert "asked for" in shared.report["chosen"] and not shared.brdf.distilled


def test_few_samples_keep_the_shared_network(llvm):
    few, _ = own.divided(truth(), 0)
    network = Material(with_trunk("ggx2", hidden=(4, 4, 4)), {})
    few = Measurements(few.wi[:400], few.wo[:400], few.f[:400], "few", "made up")
    assert "400 samples" in fit_best(network, few).report["chosen"]
    five = Measurements(few.wi[:5], few.wo[:5], few.f[:5], "five", "made up")
    with pytest.raises(ValueError, match="at least 10 samples.*got 5"):
        fit_best(network, five, own="always")


@pytest.mark.slow
def test_the_error_in_the_report_is_that_of_the_material(llvm):
    """Also where a colour cannot take over all that its network says: f of a million."""
    wi, wo = sample_pairs(400, seed=0)
    bright = Measurements(wi, wo, np.full((400, 3), 1e6, np.float32), "bright", "made up")
    m = fit_best(Material(with_trunk("ggx2", hidden=(4, 4, 4)), {}), bright, own="always", size=4)
    assert m.report["log_l1"] == pytest.approx(log_l1(m.evaluate(wi, wo), bright.f, wo[:, 2]), rel=1e-3)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [({"own": "big"}, "auto, always, never"), ({"size": 0}, "1 to 64"), ({"size": 8.5}, "1 to 64")],
)
def test_wrong_arguments_say_what_is_allowed(llvm, arguments, message):
    with pytest.raises(ValueError, match=message):
        fit_best(start(), truth(), **arguments)


@pytest.mark.slow
def test_a_shared_network_is_learned_without_measurements(llvm):
    """Colours and roughnesses stay; the error is the one that the report states."""
    shared = fit_best(Material(with_trunk("ggx2", hidden=(8, 8, 8)), {}), truth(), own="never")
    fast = specialize(shared, size=8)
    wi, wo = sample_pairs(4000, seed=6)
    error = log_l1(fast.evaluate(wi, wo), shared.evaluate(wi, wo), wo[:, 2])
    np.testing.assert_allclose(fast.report["specialize_error"], error, rtol=0.15)
    assert error < 0.01 and fast.brdf.multiply_adds < 450
    np.testing.assert_allclose(fast.params["alpha_x"], shared.params["alpha_x"])


def test_levenberg_marquardt_never_loses(llvm):
    problem = own._problems(start(), (4, 4), False, False)(truth(), 500)
    low, high = problem.box()
    u = problem.first(np.random.default_rng(0))[None]
    found = levenberg_marquardt.minimize(problem.loss, problem.normal_equations, u, low, high, steps=3)
    assert found[1] < problem.loss(u)


@pytest.mark.slow
def test_an_edit_and_then_undo_is_undo_and_then_the_edit(llvm):
    """Roughness rescales factors: of the network that is used, and of the shared one that comes back."""
    wi, wo = sample_pairs(2000, seed=5)
    shared = Material.pretrained().edit(rho_d=(0.3, 0.2, 0.1), rho_s=0.4, alpha_x=0.3, alpha_y=0.3, F0=0.2)
    rng = np.random.default_rng(0)
    shared = shared.edit(read_out=rng.normal(0, 0.02, shared.params["read_out"].shape))
    m = Measurements(wi, wo, shared.evaluate(wi, wo), "grey")
    both = specialize(shared, m, size=3)
    change = {"alpha_x": 0.03, "alpha_y": 0.04, "rho_d": 0.5}
    edited = both.edit(**change).unspecialized
    expected = shared.edit(**change)
    np.testing.assert_allclose(edited.evaluate(wi, wo), expected.evaluate(wi, wo), rtol=1e-4)
    assert np.abs(expected.params["read_out"] - shared.params["read_out"]).max() > 1e-3  # something was rescaled
    again = both.edit(alpha_x=0.1).edit(**change).unspecialized  # in two steps
    np.testing.assert_allclose(again.evaluate(wi, wo).mean(0), expected.evaluate(wi, wo).mean(0), rtol=0.02)


def test_report_after_specialize_is_of_the_material_it_is_with(llvm):
    m = truth()
    error = lambda x: log_l1(x.evaluate(m.wi, m.wo), m.f, m.wo[:, 2])  # noqa: E731
    given = dataclasses.replace(start(), report={"log_l1": 0.5, "chosen": "shared network"})
    given = dataclasses.replace(given, brdf=with_trunk(given.brdf.model, hidden=(4, 4), n_latent=2))
    small = specialize(given, m, size=2)
    assert small.report["log_l1"] == pytest.approx(error(small)) and "chosen" not in small.report
    assert small.unspecialized.report["log_l1"] == 0.5
