"""Bounded energy: no view reflects more than it receives, whatever a material is edited to."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from plugin_scenes import ball, bitmap, directions, evaluate

from mi_enhance.evaluation.check import ALBEDO, RECIPROCITY, albedo
from mi_enhance.material.material import Material
from mi_enhance.sampling import energy_bound
from mi_enhance.system.bundled_files import network_file

BRIGHT = {"rho_d": 1.0, "rho_s": 1.0}
COSINES = np.array([1, 0.97, 0.8, 0.6, 0.45, 0.3, 0.2, 0.12, 0.07, 0.04, 0.02, 0.008, 0.003, 1e-3, 1e-4, 1e-6])


def albedos(bsdf, azimuths=5, n=1 << 13):
    """Largest channel at views between the nodes and the azimuths of the table, by samples that it was not made of."""
    return albedo(bsdf, COSINES, (np.arange(azimuths) + 0.3) / azimuths * 2 * np.pi, n, first=4096)[0].max(2)


@pytest.mark.parametrize(
    "name, values",
    [
        ("ward", {"rho_s": 1.0}),
        ("ward", {"rho_s": 5.0, "alpha_x": 0.05, "alpha_y": 0.4, "n_x": 0.2, "t_theta": 0.7}),
        ("ggx2", {"rho_s": 3.0, "rho_s2": (10.0, 0.0, 1.0), "F0": 1.0}),
        ("ashikhmin_shirley", {**BRIGHT, "rho_s": 2.0, "n_u": 1e4, "n_v": 5.0, "F0": 0.5}),
        ("cook_torrance", {**BRIGHT, "alpha_x": 0.02, "alpha_y": 0.02, "F0": 1.0}),
        ("abc", {"A": 1e4, "B": 1e3, "C": 0.6}),
    ],
)
def test_no_view_reflects_more_than_it_receives(llvm, name, values):
    m = Material.analytic(name).edit(**values)
    assert albedos(m.bsdf()).max() > 1.2  # there is something to bound
    assert albedos(m.bounded().bsdf()).max() <= ALBEDO


@pytest.mark.parametrize("network", ["ggx2", "paper"])
def test_networks_are_bounded_too(llvm, network):
    m = Material.load(network_file(network)).edit(rho_d=1.0, rho_s=10.0, F0=1.0)
    assert albedos(m.bsdf()).max() > 1.2
    assert albedos(m.bounded().bsdf()).max() <= ALBEDO


def test_a_dark_material_is_left_alone(llvm):
    m, wi, wo = Material.analytic("ggx").edit(rho_d=0.3, rho_s=0.4), directions(1000), directions(1000, seed=1)
    np.testing.assert_array_equal(evaluate(m.bounded().bsdf(), wi, wo), evaluate(m.bsdf(), wi, wo))


def test_the_bound_costs_little_where_it_is_needed(llvm):
    """A white furnace with 20 % too much comes out at 0.95 or more: the bound is not darker than it has to be."""
    m = Material.analytic("ggx").edit(rho_d=1.0, rho_s=1.0, F0=0.2, alpha_x=0.3, alpha_y=0.3)
    free, bound = albedos(m.bsdf()), albedos(m.bounded().bsdf())
    assert (free[:8] > 1.05).all()  # down to a cosine of 0.12; then shadowing and the smaller of two nodes count more
    assert bound[:8].min() > 0.95


def test_bounded_materials_are_as_reciprocal(llvm):
    b = Material.analytic("ward").edit(rho_s=(5.0, 2.0, 1.0), n_x=0.1, alpha_x=0.4).bounded().bsdf()
    wi, wo = (np.float32(directions(20_000, seed=k)) for k in (0, 1))
    one, other = evaluate(b, wi, wo) / wo[:, 2:], evaluate(b, wo, wi) / wi[:, 2:]
    assert (np.abs(one - other) <= RECIPROCITY * np.maximum(one, other)).all()


def test_edits_in_a_scene_stay_bounded(llvm):
    """The table follows the parameters; giving them back gives the table back."""
    m = Material.analytic("ward").edit(rho_d=0.1, rho_s=0.2).bounded()
    b = m.bsdf()
    before = np.array(b.m_bound)
    params = mi.traverse(b)
    params["rho_s"] = mi.Color3f(4, 2, 1)
    params.update()
    assert albedos(b).max() <= ALBEDO and np.array(b.m_bound).min() < before.min() - 0.1
    params["rho_s"] = mi.Color3f(0.2)
    params.update()
    np.testing.assert_array_equal(np.array(b.m_bound), before)


def test_scene_switches_it_on_and_off(llvm):
    m = Material.analytic("ward").edit(rho_s=2.0)
    on, off = mi.load_dict({**m.to_dict(), "energy": True}), mi.load_dict({**m.bounded().to_dict(), "energy": False})
    wi, wo = directions(1000), directions(1000, seed=1)
    np.testing.assert_array_equal(evaluate(on, wi, wo), evaluate(m.bounded().bsdf(), wi, wo))
    np.testing.assert_array_equal(evaluate(off, wi, wo), evaluate(m.bsdf(), wi, wo))


def test_colours_of_the_scene_count(llvm):
    """Given as a spectrum, which Mitsuba makes a texture of."""
    b = mi.load_dict(
        {**Material.analytic("ward").bounded().to_dict(), "rho_s": {"type": "rgb", "value": [0.9, 0.5, 0]}}
    )
    assert albedos(b).max() <= ALBEDO and np.array(b.m_bound).min() < 0.9


@pytest.mark.parametrize("name", ["rho_d", "alpha_x"])
def test_textures_are_refused(llvm, name):
    texture = bitmap(np.full((2, 2, 3 if name == "rho_d" else 1), 0.5))
    with pytest.raises(RuntimeError, match=f"one material at a time; {name} must not be textured"):
        mi.load_dict({**Material.analytic("ggx").bounded().to_dict(), name: texture})


def test_evaluate_is_what_is_rendered(llvm):
    m = Material.analytic("ward").edit(rho_s=2.0).bounded()
    wi, wo = (np.float32(directions(1000, seed=k)) for k in (0, 1))
    # 2e-5: the table is made of the same samples, by kernels that round differently
    np.testing.assert_allclose(m.evaluate(wi, wo), evaluate(m.bsdf(), wi, wo) / wo[:, 2:], rtol=2e-5)


def test_file_keeps_it(llvm, tmp_path):
    m = Material.analytic("ward").edit(rho_s=2.0).bounded()
    m.save(tmp_path / "m.bsdf")
    loaded = Material.load(tmp_path / "m.bsdf")
    assert loaded.bound_energy and loaded.edit(rho_d=0.1).bound_energy and "at most 1" in loaded.show()
    assert not Material.analytic("ward").bound_energy


def test_optimization_and_frozen_functions_work(llvm, no_collection):
    """Gradients pass through f; a recorded render sees the table of the parameters as they have become."""
    scene = ball({**Material.analytic("ward").edit(rho_s=2.0).bounded().to_dict(), "id": "m"})
    params = mi.traverse(scene)
    (key,) = (k for k in params.keys() if k.endswith("rho_s"))
    frozen = dr.freeze(lambda s: mi.render(s, spp=4, seed=0))
    for k in (3.0, 2.0, 5.0):
        params[key] = mi.Color3f(k, 1, 0.5)
        params.update()
        np.testing.assert_allclose(np.array(frozen(scene)), np.array(mi.render(scene, spp=4, seed=0)), rtol=1e-4)
    colour = mi.Color3f(2)
    dr.enable_grad(colour)
    params[key] = colour
    params.update()
    dr.backward(dr.mean(mi.render(scene, params, spp=4), axis=None))
    assert (np.array(dr.grad(colour)) > 0).all()


def test_factor_is_between_its_nodes(llvm):
    s = mi.Float(np.linspace(0.1, 1, 51))
    cos = np.float32([0, 1e-7, 0.3, 1, 2])
    expected = np.interp(np.clip(cos, 0, 1) ** 0.25 * 50, np.arange(51), np.linspace(0.1, 1, 51))
    np.testing.assert_allclose(
        np.array(energy_bound._between(s, mi.Float(cos))), expected, rtol=1e-5
    )  # two roots in float32
