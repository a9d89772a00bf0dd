"""Fits of many texels at once: what each finds, and that it does not depend on the others."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from mi_enhance.analytic import parameter_space, parameters
from mi_enhance.data.directions import sample_pairs
from mi_enhance.fitting import multistart
from mi_enhance.fitting.analytic_fit import fit_analytic
from mi_enhance.fitting.fit_texels import fit_texels, log_l1_of_texels
from mi_enhance.fitting.problems import stacked
from mi_enhance.material.material import Material
from mi_enhance.neural.enhance import enhance
from mi_enhance.numerics import levenberg_marquardt

S = 48


def surface(height, width, seed=0):
    """GGX whose colour and roughness differ from texel to texel, and its parameters."""
    rng = np.random.default_rng(seed)
    wi, wo = sample_pairs(S, seed=seed)
    base, f, alpha = Material.analytic("ggx"), [], rng.uniform(0.2, 0.6, (height, width))
    for a in alpha.ravel():
        f.append(base.edit(alpha_x=a, alpha_y=a, rho_d=rng.uniform(0, 0.5, 3), F0=0.5).evaluate(wi, wo))
    return wi, wo, np.reshape(f, (height, width, S, 3)), alpha


@pytest.fixture(scope="module")
def network():
    """A small network over GGX, without a library."""
    return lambda: Material(enhance("ggx", ("G",), n_latent=3, hidden=(4,), inputs="shape", seed=1), {})


def test_analytic_texels_are_recovered(llvm):
    wi, wo, f, alpha = surface(3, 4)
    found = fit_texels(Material.analytic("ggx"), wi, wo, f)
    maps = found.maps
    assert maps.shape == found.log_l1.shape == found.log_l1_analytic.shape == (3, 4)
    right = found.log_l1 < 1e-4
    assert right.mean() > 0.8 and found.log_l1.max() < 0.003  # another minimum explains the samples nearly as well
    mean = (maps.maps["alpha_x"] + maps.maps["alpha_y"])[..., 0] / 2
    np.testing.assert_allclose(mean[right], alpha[right], rtol=0.01)
    report = found.report
    assert maps.material.report == report
    assert report["n_texels"] == 12 and report["n_samples"] == S and report["seconds_per_1000"] > 0
    assert report["log_l1"] == pytest.approx(found.log_l1.mean())


def test_an_executor_finds_the_same(llvm, network, monkeypatch):
    """Batches and network go to it as other processes would get them."""
    monkeypatch.setattr(multistart, "LANES", 3 * S)  # 2 batches
    wi, wo, f, _ = surface(1, 5)
    here = fit_texels(network(), wi, wo, f, seed=1)
    with ThreadPoolExecutor(2) as pool:
        there = fit_texels(network(), wi, wo, f, seed=1, executor=pool)
    np.testing.assert_array_equal(there.log_l1, here.log_l1)
    for name, values in here.maps.maps.items():
        np.testing.assert_array_equal(there.maps.maps[name], values)


def test_errors_are_those_of_the_maps(llvm):
    """What the fit says of a texel is what the material of that texel says of the samples."""
    wi, wo, f, _ = surface(2, 2)
    found = fit_texels(Material.analytic("ggx"), wi, wo, f)
    np.testing.assert_allclose(log_l1_of_texels(found.maps, wi, wo, f), found.log_l1, rtol=1e-3, atol=1e-6)
    cos = wo[:, 2:]
    one = np.abs(np.log1p(f[1, 0] * cos) - np.log1p(found.maps.at(1, 0).evaluate(wi, wo) * cos)).mean()
    assert one == pytest.approx(found.log_l1[1, 0], rel=1e-3, abs=1e-6)  # float32 maps


def test_many_problems_end_where_each_ends_alone(llvm):
    """The batched Levenberg-Marquardt against one problem at a time: a few steps, before rounding sets them apart."""
    wi, wo, f, _ = surface(1, 5)
    brdf = Material.analytic("ggx").brdf
    space = parameter_space.Space(brdf.parameters)
    start = space.to_free(parameters.flatten(brdf.parameters, parameters.initial(brdf.parameters)))

    def run(f):
        problem = stacked(brdf, wi, wo, f)
        u = np.tile(start, (len(f), 1))
        equations = problem.normal_equations
        return levenberg_marquardt.minimize(problem.loss, equations, u, space.low, space.high, steps=4, tolerance=-1)

    together, losses = run(f[0])
    for k in range(5):
        alone, loss = run(f[0, k : k + 1])
        np.testing.assert_allclose(alone[0], together[k], atol=2e-3)  # float32 sums in another order, amplified
        assert loss[0] == pytest.approx(losses[k], rel=1e-3)


def test_texels_fit_as_well_as_the_fit_of_single_materials(llvm):
    wi, wo, f, _ = surface(1, 4)
    brdf = Material.analytic("ggx").brdf
    problem = stacked(brdf, wi, wo, f[0])
    values = fit_analytic(brdf, problem.wi, problem.wo, _colours(f[0]), S)
    reference = problem.loss(problem.space.to_free(values))
    found = fit_texels(Material.analytic("ggx"), wi, wo, f)
    assert (found.log_l1[0] < reference + 1e-3).all()


def _colours(f):
    import mitsuba as mi

    return mi.Color3f(np.ascontiguousarray(f.reshape(-1, 3).T))


def test_directions_of_each_texel_are_its_own(llvm):
    """The same texels, each with its samples in an order of its own and its own arrays of directions."""
    wi, wo, f, _ = surface(1, 3)
    rng = np.random.default_rng(1)
    orders = [rng.permutation(S) for _ in range(3)]
    own = [np.stack([a[o] for o in orders])[None] for a in (wi, wo)]
    shuffled = np.stack([f[0, k, o] for k, o in enumerate(orders)])[None]
    found = fit_texels(Material.analytic("ggx"), *own, shuffled)
    assert np.median(found.log_l1) < 1e-4
    np.testing.assert_allclose(log_l1_of_texels(found.maps, wi, wo, f), found.log_l1, rtol=1e-3, atol=1e-6)


def test_network_follows_what_its_analytic_model_cannot(llvm, network):
    """Texels of a network's own materials, with noise; smoothness makes neighbours alike and costs little."""
    wi, wo = sample_pairs(S, seed=4)
    rng = np.random.default_rng(4)
    truth = network().edit(alpha_x=0.4, alpha_y=0.4, F0=0.5, rho_d=0.1)
    latent = rng.uniform(-3, 3, (9, 3))
    f = np.stack([truth.edit(latent=v).evaluate(wi, wo) for v in latent]).reshape(3, 3, S, 3)
    noisy = f * rng.lognormal(0, 0.05, f.shape)
    rough = fit_texels(network(), wi, wo, noisy)
    assert rough.log_l1.mean() < 0.8 * rough.log_l1_analytic.mean()
    smooth = fit_texels(network(), wi, wo, noisy, smoothness=10.0)

    def steps(found):
        return np.abs(np.diff(found.maps.maps["latent"], axis=0)).mean()

    assert steps(smooth) < 0.7 * steps(rough)
    assert smooth.report["log_l1"] < 2 * rough.report["log_l1"]


def test_sweeps_that_pull_hard_at_first_leave_neighbours_closer(llvm, monkeypatch):
    """Equal texels with noise: the last sweep pulls as hard in both."""
    wi, wo, f, _ = surface(1, 1)
    noisy = f * np.random.default_rng(0).lognormal(0, 0.1, (3, 3, S, 3))

    def steps(factors):
        monkeypatch.setattr("mi_enhance.fitting.fit_texels._SWEEPS", factors)
        found = fit_texels(Material.analytic("ggx"), wi, wo, noisy, smoothness=1)
        return np.abs(np.diff(np.log(found.maps.maps["alpha_x"]), axis=0)).mean()

    assert steps((10.0, 3.0, 1.0)) < 0.8 * steps((1.0, 1.0, 1.0))


def test_wrong_arguments_are_refused(llvm):
    wi, wo, f, _ = surface(1, 2)
    m = Material.analytic("ggx")
    bad = f.copy()
    bad[0, 1, 3, 0] = -1
    for args, match in (
        ((wi, wo, bad), r"f\[0, 1, 3, 0\] is -1.0; it must be finite and >= 0"),
        ((wi[:-1], wo, f), r"wi has shape \(47, 3\); \(48, 3\) or \(1, 2, 48, 3\) is needed"),
        ((wi, -wo, f), "above the horizon"),
        ((wi, wo, f[..., 0]), r"f has shape \(1, 2, 48\)"),
    ):
        with pytest.raises(ValueError, match=match):
            fit_texels(m, *args)
    with pytest.raises(ValueError, match="smoothness is -1"):
        fit_texels(m, wi, wo, f, smoothness=-1)
    with pytest.raises(ValueError, match="smoothness needs neighbours"):
        fit_texels(m, wi, wo, f[0], smoothness=1)
    maps = fit_texels(m, wi, wo, f).maps
    with pytest.raises(ValueError, match=r"f is for \(1, 1\) texels, the maps have \(1, 2\)"):
        log_l1_of_texels(maps, wi, wo, f[:, :1])


def test_progress_counts_texels(llvm):
    wi, wo, f, _ = surface(1, 2)
    seen = []
    fit_texels(Material.analytic("ggx"), wi, wo, f, smoothness=1, progress=seen.append)
    assert [(p.stage, p.step, p.total) for p in seen] == [
        ("analytic", 2, 2), ("sweep 1", 2, 2), ("sweep 2", 2, 2), ("sweep 3", 2, 2)
    ]  # fmt: skip


def test_memory_is_bounded_where_one_texel_has_many_samples():
    """A texel alone may be above the bound; nothing is split into empty parts."""
    for n, lanes in ((1, 3 * multistart.LANES), (5, 0.5 * multistart.LANES), (7, 1)):
        parts = multistart.batches(np.arange(n), lanes)
        assert np.concatenate(parts).tolist() == list(range(n))
        assert all(1 <= len(p) and (len(p) == 1 or len(p) * lanes <= multistart.LANES) for p in parts)
