"""A shared trunk: zero read-outs are the analytic model, colours stay outside, kernels follow a float64 twin."""

from __future__ import annotations

import dataclasses

import mitsuba as mi
import numpy as np
import pytest

from mi_enhance.analytic import parameters
from mi_enhance.analytic.geometry import quantities
from mi_enhance.data.directions import sample_pairs
from mi_enhance.material.material import Material
from mi_enhance.neural.enhance import first_latent, trunk_start, with_trunk
from mi_enhance.neural.enhanced_brdf import EnhancedBRDF
from mi_enhance.neural.inputs import named, names_of
from mi_enhance.neural.replacements import as_learned
from mi_enhance.numerics.arrays import vector3f

N = 3000


def material(seed=1, channels=3, **values) -> Material:
    """A trunk with random weights and read-outs."""
    brdf = with_trunk("ggx2", hidden=(8, 9, 10), channels=channels, seed=seed)
    rng = np.random.default_rng(seed)
    start = {"rho_d": (0.3, 0.2, 0.1), "rho_s2": 0.2, "alpha_x": 0.1, "alpha_y": 0.2, "asymmetry": 0.4, **values}
    read = rng.normal(0, 0.3, brdf.trunk.size)
    return Material(brdf, {"latent": rng.normal(0, 0.5, 8), "read_out": read, **start})


def test_a_read_out_of_0_is_the_analytic_model(llvm):
    m = material(read_out=0.0)
    wi, wo = sample_pairs(N, seed=1)
    plain = Material(EnhancedBRDF(m.brdf.model, {}), {p.name: m.params[p.name] for p in m.brdf.model.parameters})
    np.testing.assert_array_equal(m.evaluate(wi, wo), plain.evaluate(wi, wo))


def test_it_prints_as_its_equation(llvm):
    m = material()
    assert str(m.brdf) == "M * [B] + S * D * F * [G] * 1/E + S2 * D2 * F2 * [G2] * 1/E2"
    # 11 features -> 8 -> 9 -> 10 units, read out by 9 outputs
    assert m.brdf.multiply_adds == 11 * 8 + 8 * 9 + 9 * 10 + 10 * 9
    assert m.brdf.n_parameters == 17 + 1 + 8 + 9 * 11


@pytest.mark.parametrize("channels", [3, 1])
def test_follows_a_float64_twin(llvm, channels):
    """Factor = exp(read-out of the leaky ReLU of the trunk), times the analytic term; f is a sum over the slots."""
    m = material(channels=channels)
    wi, wo = sample_pairs(N, seed=2)
    trunk, params = m.brdf.trunk, m.as_drjit()
    graph, record, _ = EnhancedBRDF(m.brdf.model, {}).prepare(vector3f(wi), vector3f(wo), params)
    features = named(record)
    x = np.stack([np.array(features[name], np.float64) for name in names_of("shape")], 1)
    x = np.concatenate([np.tile(m.params["latent"], (N, 1)), x], 1)
    for w, b in trunk.mlp.layers:
        x = x @ w.T.astype(np.float64) + b
        x = np.maximum(x, 0.01 * x)
    y = np.append(x, np.ones((N, 1)), 1) @ trunk.matrix(m.params["read_out"]).T
    expected = np.zeros((N, 3))
    for k, slot in enumerate(trunk.slots):
        others = {s: (lambda record: mi.Float(0)) for s in trunk.slots if s != slot}
        part = np.array(mi.Color3f(graph.replace(others)(record)), np.float64).T
        expected += part * np.exp(y[:, channels * k : channels * (k + 1)])
    np.testing.assert_allclose(m.evaluate(wi, wo), expected, rtol=2e-4, atol=1e-6)


def test_linear_in_the_colours_and_blind_to_them(llvm):
    m = material(rho_s=0.0, rho_s2=0.0)
    wi, wo = sample_pairs(N, seed=3)
    np.testing.assert_allclose(2 * m.evaluate(wi, wo), m.edit(rho_d=(0.6, 0.4, 0.2)).evaluate(wi, wo), rtol=1e-5)


def test_reciprocal_where_asymmetry_is_0(llvm):
    m = material(asymmetry=0.0)
    wi, wo = sample_pairs(N, seed=4)
    np.testing.assert_allclose(m.evaluate(wi, wo), m.evaluate(wo, wi), rtol=1e-3, atol=1e-6)
    assert not np.allclose(material().evaluate(wi, wo), material().evaluate(wo, wi), rtol=1e-2)


def test_file_and_plugin_give_the_same(llvm, tmp_path):
    m = material()
    m.save(tmp_path / "trunk.bsdf")
    again = Material.load(tmp_path / "trunk.bsdf")
    wi, wo = sample_pairs(N, seed=5)
    np.testing.assert_array_equal(again.evaluate(wi, wo), dataclasses.replace(m).evaluate(wi, wo))
    bsdf, si = again.bsdf(), mi.SurfaceInteraction3f()
    si.wi = vector3f(wi)
    f = np.array(bsdf.eval(mi.BSDFContext(), si, vector3f(wo))).T
    np.testing.assert_allclose(f, m.evaluate(wi, wo) * wo[:, 2:], rtol=2e-4, atol=1e-6)


def test_an_edited_lobe_is_seen_as_pairs_that_were_learned(llvm):
    """Half vectors go back into the narrow lobe, and viewer and light with them, at the same difference angle."""
    wi, wo = (vector3f(v) for v in sample_pairs(N, seed=3, min_cos=0.05))
    record = {**quantities(wi, wo), "alpha_x": mi.Float(0.2), "alpha_y": mi.Float(0.4)}
    node = material().brdf.model.graph.find("G")
    seen = as_learned(record, node, {"alpha_x": 0.01, "alpha_y": 0.01})
    back = {k: np.array(v, np.float64) for k, v in quantities(seen["wi"], seen["wo"]).items()}
    h, at = np.array(record["h"], np.float64), np.array(seen["h"], np.float64)
    np.testing.assert_allclose(at[:2], h[:2] * [[0.05], [0.025]], rtol=1e-5)
    inside = (np.array(seen["wi"])[2] > 0) & (np.array(seen["wo"])[2] > 0)
    assert inside.mean() > 0.95
    np.testing.assert_allclose(back["h"][:, inside], at[:, inside], atol=1e-5)
    np.testing.assert_allclose(back["cos_theta_d"], np.array(record["cos_theta_d"]), atol=1e-5)
    for name in ("cos_theta_i", "cos_theta_o"):
        np.testing.assert_allclose(np.array(seen[name]), back[name], atol=1e-5)


def test_a_lobe_without_colour_is_left_out(llvm):
    m = material(rho_s2=0.0, asymmetry=0.0)
    bsdf, si = m.bsdf(), mi.SurfaceInteraction3f()
    wi, wo = sample_pairs(N, seed=6)
    si.wi = vector3f(wi)
    assert bsdf.m_compiled.form.brdf.read_slots == ("B", "G")
    f = np.array(bsdf.eval(mi.BSDFContext(), si, vector3f(wo))).T
    np.testing.assert_allclose(f, m.evaluate(wi, wo) * wo[:, 2:], rtol=2e-4, atol=1e-6)


def test_starts_of_fits(llvm):
    brdf = with_trunk("ggx2", n_latent=6)
    values = parameters.flatten(brdf.parameters, parameters.initial(brdf.parameters))
    start = parameters.unflatten(brdf.parameters, trunk_start(brdf, values))
    np.testing.assert_allclose(start["latent"], first_latent(brdf, values[None])[0])
    np.testing.assert_allclose(start["latent"][:2], np.log(0.2) / 4, rtol=1e-5)
    assert start["asymmetry"] == 0.3


def test_wrong_arguments_say_what_is_allowed():
    with pytest.raises(ValueError, match="slots of terms"):
        with_trunk("ggx2", ["F*G"])
    with pytest.raises(ValueError, match="channels must be 3"):
        with_trunk("ggx2", channels=2)
    with pytest.raises(KeyError, match="Slots"):
        with_trunk("ggx2", ["X"])
