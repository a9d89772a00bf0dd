"""Read-outs of low rank: codes times a basis that materials share, exactly a free read-out of one material."""

from __future__ import annotations

import dataclasses
import json

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from mi_enhance.data.directions import sample_pairs
from mi_enhance.material.description import describe
from mi_enhance.material.low_rank import LowRank, of_low_rank, with_basis
from mi_enhance.material.material import Material
from mi_enhance.material.material_file import _low_rank
from mi_enhance.material.material_maps import MaterialMaps
from mi_enhance.neural.enhance import with_trunk
from mi_enhance.neural.enhanced_brdf import EnhancedBRDF
from mi_enhance.numerics.arrays import vector3f

N = 3000
RANK = 4


def material(seed=1, channels=3, **values) -> Material:
    """A trunk and a basis with random weights, and a random code."""
    brdf, rng = with_trunk("ggx2", hidden=(8, 9, 10), channels=channels, rank=RANK, seed=1), np.random.default_rng(seed)
    start = {"rho_d": (0.3, 0.2, 0.1), "rho_s2": 0.2, "alpha_x": 0.1, "alpha_y": 0.2, "asymmetry": 0.4, **values}
    params = {"latent": rng.normal(0, 0.5, 8), "code": rng.normal(0, 0.5, 3 * RANK), **start}
    return Material(brdf, params)


def with_norms(m: Material) -> Material:
    n = m.brdf.trunk.channels
    norms = {f"norm_{slot}": np.linspace(-0.3, 0.4, n) + k / 5 for k, slot in enumerate(m.brdf.trunk.slots)}
    return dataclasses.replace(m, params={**m.params, **norms})


def in_plugin(bsdf, wi, wo, **uv) -> np.ndarray:
    si = dr.zeros(mi.SurfaceInteraction3f)
    si.wi = vector3f(wi)
    si.uv = mi.Point2f(*uv.get("uv", (0, 0)))
    return np.array(bsdf.eval(mi.BSDFContext(), si, vector3f(wo))).T


def test_a_code_of_0_is_the_analytic_model(llvm):
    m = material(code=0.0)
    wi, wo = sample_pairs(N, seed=1)
    plain = Material(EnhancedBRDF(m.brdf.model, {}), {p.name: m.params[p.name] for p in m.brdf.model.parameters})
    np.testing.assert_array_equal(m.evaluate(wi, wo), plain.evaluate(wi, wo))


@pytest.mark.parametrize("channels", [3, 1])
def test_it_is_a_free_read_out(llvm, channels):
    """The matrix of a free one, which has a float64 twin, is the sum over the code; norms go into its constants."""
    m = with_norms(material(channels=channels))
    free = m.free
    assert m.brdf.n_parameters == 17 + 1 + 8 + 3 * channels + 3 * RANK
    assert free.brdf.has_free_read_out and str(free.brdf) == str(m.brdf)
    w, b = m.brdf.trunk.basis.layers[0]
    rows = np.append(w, b[:, None], 1).reshape(3, RANK, channels, -1)
    matrix = np.einsum("sr,srck->sck", m.params["code"].reshape(3, RANK), rows)
    matrix[:, :, -1] += np.stack([m.params[f"norm_{slot}"] for slot in m.brdf.trunk.slots])
    np.testing.assert_allclose(free.params["read_out"], matrix.ravel(), rtol=1e-12)
    wi, wo = sample_pairs(N, seed=2)
    np.testing.assert_allclose(m.evaluate(wi, wo), free.evaluate(wi, wo), rtol=1e-4, atol=1e-7)  # order of the sums


def test_files_and_plugin_give_the_same(llvm, tmp_path):
    m = with_norms(material())
    m.save(tmp_path / "low.bsdf")
    again = Material.load(tmp_path / "low.bsdf")
    wi, wo = sample_pairs(N, seed=5)
    np.testing.assert_array_equal(again.evaluate(wi, wo), again.edit().evaluate(wi, wo))
    np.testing.assert_allclose(again.evaluate(wi, wo), m.evaluate(wi, wo), rtol=1e-5, atol=1e-7)  # params in float32
    expected = m.evaluate(wi, wo) * wo[:, 2:]
    many = [m.bsdf() for _ in range(10)]  # of which some have the read-out as constants, the rest the code as data
    literal = [bool(b.m_parameters.literal) for b in many]
    assert any(literal) and not all(literal)
    for bsdf in (many[0], many[-1]):
        np.testing.assert_allclose(in_plugin(bsdf, wi, wo), expected, rtol=3e-4, atol=1e-6)


def test_a_network_carries_both_forms(llvm, tmp_path):
    low = material()
    brdf, basis = with_basis(low.brdf, None), low.brdf.trunk.basis
    library = np.tile(low.as_vector(), (2, 1))
    Material(brdf, {"rho_d": 0.3}, low_rank=LowRank(basis, library)).save(tmp_path / "network.bsdf")
    found = of_low_rank(Material.load(tmp_path / "network.bsdf"), "test")
    np.testing.assert_array_equal(found.brdf.trunk.basis.layers[0][0], basis.layers[0][0])
    np.testing.assert_allclose(found.library, library, rtol=1e-6)
    assert not found.params["code"].any() and found.low_rank is None
    np.testing.assert_allclose(found.params["rho_d"], 0.3, rtol=1e-6)
    with pytest.raises(ValueError, match="numbers of its own.*low_rank=True"):
        of_low_rank(found.free, "test")


@pytest.mark.parametrize("rank", [-1, 0, 5000, "4", None])
def test_a_damaged_rank_is_refused(llvm, tmp_path, rank):
    low = material()
    network = Material(with_basis(low.brdf, None), {}, low_rank=LowRank(low.brdf.trunk.basis, low.as_vector()[None]))
    described = {**describe(network), "low_rank": rank}
    arrays = {"low_rank.library": low.as_vector()[None].astype(np.float32)}
    with pytest.raises(ValueError, match="low_rank"):
        _low_rank(network.brdf, json.loads(json.dumps(described))["low_rank"], arrays, "test")


def test_a_map_of_codes_is_each_material(llvm):
    """Texel by texel; a texture of codes is evaluated by the basis, a constant code by its read-out."""
    m, rng = material(), np.random.default_rng(3)
    codes = rng.normal(0, 0.5, (1, 2, 3 * RANK)).astype(np.float32)
    maps = MaterialMaps(m, {"code": codes})
    wi, wo = sample_pairs(N, seed=6)
    bsdf = maps.bsdf("nearest")
    for k, u in enumerate((0.25, 0.75)):
        expected = maps.at(0, k).evaluate(wi, wo) * wo[:, 2:]
        np.testing.assert_allclose(in_plugin(bsdf, wi, wo, uv=(u, 0.5)), expected, rtol=3e-4, atol=1e-6)


@pytest.mark.parametrize("textured", [False, True])
def test_gradients_of_a_code_in_the_plugin(llvm, textured):
    """Central differences; 2 %: float32."""
    m = material()
    wi, wo = sample_pairs(400, seed=7)
    maps = MaterialMaps(m, {"code": np.tile(m.params["code"].astype(np.float32), (1, 1, 1))})
    bsdf = maps.bsdf() if textured else m.bsdf()
    params = mi.traverse(bsdf)
    key = "code.data" if textured else "code"
    shape = params[key].shape
    put = lambda v: type(params[key])(mi.Float(v.tolist()), shape) if textured else mi.Float(v.tolist())  # noqa: E731
    start = m.params["code"].astype(np.float32)

    def value(v):
        params[key] = put(v)
        params.update()
        return float(in_plugin(bsdf, wi, wo).astype(np.float64).mean())

    params[key] = put(start)
    dr.enable_grad(params[key])
    params.update()
    si = dr.zeros(mi.SurfaceInteraction3f)
    si.wi = vector3f(wi)
    f = bsdf.eval(mi.BSDFContext(), si, vector3f(wo))
    dr.backward(dr.mean(f, axis=None))
    gradient = np.array(dr.grad(params[key])).ravel()
    for k in (0, RANK + 1, 3 * RANK - 1):
        step = np.zeros_like(start)
        step[k] = 2e-2
        numeric = (value(start + step) - value(start - step)) / 4e-2
        np.testing.assert_allclose(gradient[k], numeric, rtol=0.02, atol=1e-6)


@pytest.mark.parametrize("code", [-16.0, 16.0])
def test_extremes_are_finite(llvm, code):
    m = material(code=code, alpha_x=1e-3, alpha_y=1.0)
    wi, wo = sample_pairs(N, seed=8)
    wi[:100], wo[:100] = wo[:100], wi[:100]
    wi[0] = wo[0] = (0, 0, 1)
    wi[1] = wo[1] = (np.sqrt(1 - 1e-6), 0, 1e-3)
    f = m.evaluate(wi, wo)
    assert np.isfinite(f).all() and (f >= 0).all()


def test_an_edit_of_the_roughness_goes_into_the_norms(llvm):
    """They are what holds the mean of a factor; the code, and so the read-out, stays."""
    m = material().edit(alpha_x=0.3, alpha_y=0.3)
    np.testing.assert_array_equal(m.params["code"], material().params["code"])
    assert m.params["norm_G"].any()
    wi, wo = sample_pairs(N, seed=9)
    np.testing.assert_allclose(m.evaluate(wi, wo), m.free.evaluate(wi, wo), rtol=1e-4, atol=1e-7)
