"""Fits with read-outs: exact gradients, never worse than the analytic ancestor, reciprocal on request."""

from __future__ import annotations

import dataclasses
import functools

import mitsuba as mi
import numpy as np
import pytest

from mi_enhance.analytic import parameters
from mi_enhance.data.directions import sample_pairs
from mi_enhance.data.measurements import Measurements
from mi_enhance.fitting import fit as fit_module
from mi_enhance.fitting.fit import fit
from mi_enhance.fitting.fit_texels import fit_texels
from mi_enhance.fitting.problems import stacked
from mi_enhance.material.material import Material
from mi_enhance.neural.enhance import trunk_start, with_trunk


def small(seed=0, **how) -> Material:
    return Material(with_trunk("ggx2", hidden=(8, 8, 8), seed=seed, **how), {})


@functools.lru_cache
def measured(noise=0.0) -> Measurements:
    """What GGX cannot say: a diffuse term that turns hue with the angle, under a lobe."""
    mi.set_variant("llvm_ad_rgb")
    wi, wo = sample_pairs(2000, seed=2)
    m = Material.analytic("ggx").edit(rho_d=(0.5, 0.3, 0.2), rho_s=0.3, alpha_x=0.2, alpha_y=0.2)
    hue = np.stack([wo[:, 2], 0 * wo[:, 2] + 0.5, 1 - wo[:, 2]], 1) * 2
    f = (
        m.evaluate(wi, wo) * hue * np.random.default_rng(0).normal(1, noise, (len(wi), 3))
        if noise
        else (m.evaluate(wi, wo) * hue)
    )
    return Measurements(wi, wo, f.astype(np.float32), "hue", "made up")


@pytest.mark.parametrize("how", [{}, {"rank": 3}, {"rank": 2, "channels": 1}], ids=["free", "rank 3", "scalar"])
def test_gradients_are_central_differences_of_the_loss(llvm, how):
    """Of every kind of unknown: frame, colours, roughness, F0, asymmetry, latent, numbers of the read-out; of two
    problems at once."""
    brdf, rng = small(**how).brdf, np.random.default_rng(0)
    wi, wo = sample_pairs(800, seed=1)
    f = rng.exponential(0.3, (2, 400, 3))
    problem = stacked(brdf, wi.reshape(2, 400, 3), wo.reshape(2, 400, 3), f)
    values = parameters.flatten(brdf.parameters, parameters.initial(brdf.parameters))
    u = np.tile(problem.space.to_free(trunk_start(brdf, values)), (2, 1))
    names = np.array([p.name for p in brdf.parameters for _ in range(p.size)])
    u[:, names == "rho_s2"], u[:, names == "alpha_x"] = 0.3, -1.2
    own = np.flatnonzero(np.isin(names, ("read_out", "code")))
    u[:, own] = rng.normal(0, 0.05 if not how else 0.3, (2, len(own)))
    epsilon = 0.05

    def smooth(v):
        r = np.stack([np.array(c, np.float64).reshape(2, 400) for c in problem.residuals(v)], 1)
        return np.sqrt(r**2 + epsilon**2).mean((1, 2))

    _, g, loss = problem.normal_equations(u, np.full(2, epsilon))
    np.testing.assert_allclose(loss, smooth(u), rtol=1e-5)
    for k in [*(int(np.flatnonzero(names == n)[0]) for n in ("t_theta", "rho_d", "rho_s", "alpha_x", "F0", "rho_s2",
              "alpha_y2", "asymmetry", "latent")), *own[[0, 2, len(own) // 2, -1]]]:  # fmt: skip
        step = np.zeros_like(u)
        step[:, k] = 2e-3
        numeric = (smooth(u + step) - smooth(u - step)) / 4e-3
        np.testing.assert_allclose(g[:, k], numeric, rtol=0.05, atol=5e-6, err_msg=names[k])


def test_follows_a_hue_that_turns_with_the_angle(llvm):
    report = fit(small(), measured()).report
    assert report["log_l1"] < 0.35 * report["log_l1_analytic"]


def test_never_worse_than_the_ancestor(llvm, monkeypatch):
    """On a pure GGX metal read-outs have nothing to add; a stage of few samples must not take anything away."""
    monkeypatch.setattr(fit_module, "_READ_OUT_STAGES", (fit_module.Stage(64, None, 5),))
    wi, wo = sample_pairs(3000, seed=3)
    metal = Material.analytic("ggx2").edit(rho_d=0, rho_s=(0.9, 0.6, 0.3), F0=0.8, alpha_x=0.15, alpha_y=0.15)
    report = fit(small(), Measurements(wi, wo, metal.evaluate(wi, wo), "metal", "ggx")).report
    assert report["log_l1"] <= report["log_l1_analytic"] * (1 + 1e-6)


def test_reciprocal_on_request(llvm):
    m = fit(small(), measured(), reciprocal=True)
    wi, wo = sample_pairs(500, seed=4)
    np.testing.assert_allclose(m.evaluate(wi, wo), m.evaluate(wo, wi), rtol=2e-3, atol=1e-5)
    assert m.report["reciprocal"] and m.brdf.inputs == "reciprocal"


def test_colours_mean_albedo_after_a_fit(llvm):
    """The diffuse term with factors reflects as much as a Lambertian one of rho_d, channel by channel."""
    m = fit(small(), measured()).edit(rho_s=0, rho_s2=0)
    rng = np.random.default_rng(0)
    u = rng.random((4, 20000))
    hemisphere = lambda a, b: np.stack(  # noqa: E731
        [np.sqrt(a) * np.cos(2 * np.pi * b), np.sqrt(a) * np.sin(2 * np.pi * b), np.sqrt(1 - a) + 1e-6], 1
    )
    albedo = np.pi * m.evaluate(
        *(w / np.linalg.norm(w, axis=1)[:, None] for w in (hemisphere(*u[:2]), hemisphere(*u[2:])))
    )
    np.testing.assert_allclose(albedo.mean(0), m.params["rho_d"], rtol=0.03)


def test_a_free_read_out_is_not_for_texels(llvm):
    wi, wo = sample_pairs(8, seed=0)
    with pytest.raises(ValueError, match="numbers of its own.*low_rank=True"):
        fit_texels(small(), wi, wo, np.ones((2, 8, 3)))


def test_codes_are_for_texels(llvm):
    """Two texels whose diffuse terms turn hue one way and the other, which colours alone cannot follow."""
    m = measured()
    f = np.stack([m.f[:200], m.f[:200, ::-1]])
    found = fit_texels(small(rank=4), m.wi[:200], m.wo[:200], f)
    assert (found.log_l1 < 0.7 * found.log_l1_analytic).all()
    assert found.maps.maps["code"].shape == (1, 2, 12) and "norm_B" not in found.maps.maps
    again = found.maps.at(0, 1).evaluate(m.wi[:200], m.wo[:200])
    cos = m.wo[:200, 2:]
    assert abs(np.abs(np.log1p(again * cos) - np.log1p(f[1] * cos)).mean() / found.log_l1[0, 1] - 1) < 0.01


def test_codes_are_for_fits(llvm):
    """Never worse than the ancestor, and reciprocal on request; colours mean albedo, by the norms."""
    m = fit(small(rank=4), measured(), reciprocal=True)
    assert m.report["log_l1"] < 0.7 * m.report["log_l1_analytic"] and m.reciprocal
    assert "code" not in m.report["std"] and m.params["norm_B"].any() and m.library is None
    wi, wo = sample_pairs(500, seed=4)
    np.testing.assert_allclose(m.evaluate(wi, wo), m.free.evaluate(wi, wo), rtol=1e-4, atol=1e-6)
    again = fit(m, measured(), reciprocal=True)  # the norms go back into the colours first
    assert again.report["log_l1"] < 1.02 * m.report["log_l1"]


@pytest.mark.parametrize("edit", [{"alpha_x": 0.05, "alpha_y": 0.05}, {"alpha_x": 0.6, "alpha_y": 0.6}, {"F0": 0.5}])
def test_edits_of_shape_keep_their_meaning(llvm, edit):
    """To the analytic lobes of the same numbers, the albedo stays what it was."""
    m = fit(small(), measured())

    def albedo(x: Material) -> float:
        plain = Material.analytic("ggx2").edit(**{p.name: x.params[p.name] for p in x.brdf.model.parameters})
        return _reflected(x) / _reflected(plain)

    assert 0.6 < albedo(m.edit(**edit)) / albedo(m) < 1.6
    kept = dataclasses.replace(m, params={**m.params, **{k: np.array([v]) for k, v in edit.items()}})
    assert abs(albedo(m.edit(**edit)) / albedo(m) - 1) <= abs(albedo(kept) / albedo(m) - 1) + 0.02


def _reflected(m: Material) -> float:
    """Albedo at 30 degrees, drawn by the plugin."""
    bsdf, si, n = m.bsdf(), mi.SurfaceInteraction3f(), 20000
    u = np.random.default_rng(1).random((3, n)).astype(np.float32)
    si.wi = mi.Vector3f(0.5, 0, 0.8660254)
    point = mi.Point2f(mi.Float(u[1].tolist()), mi.Float(u[2].tolist()))
    _, weight = bsdf.sample(mi.BSDFContext(), si, mi.Float(u[0].tolist()), point)
    return float(np.array(weight).mean())
