"""Nearest parameters of other models: our evaluators are those models, a model is found again, the files are read."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ET

import mi_enhance  # noqa: F401  (before mitsuba)

import mitsuba as mi  # isort: skip
import numpy as np
import pytest

from mi_enhance import Material
from mi_enhance.cli.main import main
from mi_enhance.data.directions import cosine_hemisphere, sample_pairs
from mi_enhance.evaluation.reflectance import reflectance
from mi_enhance.export import gltf, microfacets, openpbr, principled
from mi_enhance.export.microfacets import Pairs
from mi_enhance.export.nearest import _named, _vector, nearest
from mi_enhance.fitting.losses import log_l1

MODELS = [principled.MODEL, openpbr.MODEL, gltf.MODEL]
ids = ["principled", "openpbr", "gltf"]
PAINT = {"alpha_x": 0.2, "alpha_y": 0.2, "rho_d": (0.3, 0.1, 0.05)}


def value(model, given, wi, wo):
    unknowns = model.unknowns
    return model.evaluate(Pairs.of(wi, wo), _named(unknowns, _vector(unknowns, given)[None]))[0]


def drawn(model, seed, **fixed):
    rng = np.random.default_rng(seed)
    # 0.05: what is 0 is left out of the plugin for good
    pick = lambda u: rng.uniform(u.low + 0.05 * (u.high - u.low), u.high, u.size)  # noqa: E731
    values = {u.name: pick(u).tolist() if u.size > 1 else float(pick(u)[0]) for u in model.unknowns}
    return {**values, **fixed}


@pytest.mark.parametrize("seed", range(8))
def test_our_principled_is_mitsuba_s(llvm, seed):
    wi, wo = sample_pairs(2000, seed=seed)
    given = drawn(principled.MODEL, seed)
    plugin = {k: {"type": "rgb", "value": v} if isinstance(v, list) else v for k, v in given.items()}
    theirs = reflectance(mi.load_dict({"type": "principled", **plugin}), wi, wo)
    np.testing.assert_allclose(value(principled.MODEL, given, wi, wo), theirs, rtol=1e-4, atol=1e-6)  # float32


@pytest.mark.parametrize("model", MODELS, ids=ids)
def test_every_value_in_the_box_gives_a_reflectance(model):
    """Finite and not negative, the corners included."""
    wi, wo = sample_pairs(300, seed=0)
    rng = np.random.default_rng(0)
    for _ in range(60):
        given = {u.name: rng.choice([u.low, u.high], u.size).tolist() for u in model.unknowns}
        f = value(model, {k: v if len(v) > 1 else v[0] for k, v in given.items()}, wi, wo)
        assert np.isfinite(f).all() and (f >= 0).all()


def test_openpbr_reflects_what_it_receives_and_not_more():
    """A white furnace: the diffuse part takes what the gloss leaves; 5 % are the split sum."""
    white = {"base_color": [0.999] * 3, "specular_color": [1.0] * 3, "specular_roughness_anisotropy": 0.0}
    wo = cosine_hemisphere(20_000).astype(np.float32)
    for metal, rough in ((0.0, 0.3), (0.0, 0.8), (1.0, 0.3), (1.0, 0.8)):
        given = {**white, "base_metalness": metal, "base_diffuse_roughness": 0.5, "specular_roughness": rough}
        given |= {"specular_ior": 1.5, "coat_weight": 0.0, "coat_roughness": 0.2}
        for theta in (0.2, 0.9):
            wi = np.broadcast_to(np.float32([np.sin(theta), 0, np.cos(theta)]), wo.shape)
            albedo = np.pi * value(openpbr.MODEL, given, wi, wo).mean()
            assert albedo == pytest.approx(1, abs=0.05)


def test_albedo_of_a_lobe_is_its_integral():
    wo = cosine_hemisphere(40_000).astype(np.float32)
    for theta, alpha in ((0.1, 0.3), (0.8, 0.3), (1.2, 0.6), (0.5, 0.9)):
        wi = np.broadcast_to(np.float32([np.sin(theta), 0, np.cos(theta)]), wo.shape)
        p, a = Pairs.of(wi, wo), np.full((1, 1), alpha)
        lobe = microfacets.ggx(p.h, a, a) * microfacets.smith(p, a, a)
        got = np.array(microfacets.albedo(np.array(np.cos(theta)), np.array(alpha)))
        weight = (1 - p.cos_d) ** 5
        np.testing.assert_allclose(
            got, np.pi * np.array([(lobe * (1 - weight)).mean(), (lobe * weight).mean()]), atol=0.01
        )


def test_gltf_is_the_formula_of_its_specification():
    """At one pair of directions, by hand: appendix B.2 and B.3."""
    given = {"baseColorFactor": [0.8, 0.4, 0.2], "metallicFactor": 0.25, "roughnessFactor": 0.5}
    given |= {"specularColorFactor": [1.0] * 3, "clearcoatFactor": 0.0, "clearcoatRoughnessFactor": 0.5}
    given |= {"anisotropyStrength": 0.0, "anisotropyRotation": 0.0}
    wi, wo = np.float32([[0, 0, 1]]), np.float32([[0.6, 0, 0.8]])
    cos_h = np.sqrt(0.9)  # of half the angle whose cosine is 0.8; both directions have it to h
    a2 = 0.0625
    d = a2 / (np.pi * (cos_h**2 * (a2 - 1) + 1) ** 2)
    # G / (4 cos cos) of Smith, with chi = 1
    v = 0.5 / (0.8 * np.sqrt(1 * (1 - a2) + a2) + 1 * np.sqrt(0.64 * (1 - a2) + a2))
    weight = (1 - cos_h) ** 5
    base = np.array([0.8, 0.4, 0.2])
    f = 0.04 + 0.96 * weight
    expected = 0.75 * ((1 - f) * base / np.pi + f * d * v) + 0.25 * (base + (1 - base) * weight) * d * v
    np.testing.assert_allclose(value(gltf.MODEL, given, wi, wo)[0], expected, rtol=1e-5)


def test_gltf_lobes_turn_with_their_tangent():
    given = drawn(gltf.MODEL, 0, anisotropyStrength=0.7, anisotropyRotation=0.6)
    wi, wo = sample_pairs(200, seed=0)
    c, s = np.cos(0.6), np.sin(0.6)
    turn = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])  # of row vectors, by 0.6
    turned = value(gltf.MODEL, given, wi @ turn, wo @ turn)
    np.testing.assert_allclose(turned, value(gltf.MODEL, {**given, "anisotropyRotation": 0.0}, wi, wo), rtol=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("model", MODELS, ids=ids)
def test_a_model_is_found_again(model):
    found = []
    for seed in range(3):
        given = drawn(model, seed)
        found.append(nearest(model, lambda wi, wo, g=given: value(model, g, wi, wo)).log_l1)
    assert max(found) < 2e-3 and sorted(found)[1] < 5e-4  # a good fit of a measured material has 0.01


def test_what_principled_says_is_found_in_mitsuba(llvm, tmp_path, capsys):
    """The file is a scene for stock Mitsuba; its BSDF has the error that was printed."""
    m = Material.analytic("ggx").edit(**PAINT)
    m.save(tmp_path / "m.bsdf")
    assert main(["export", str(tmp_path / "m.bsdf"), "-o", str(tmp_path / "paint.xml"), "--json"]) == 0
    facts = json.loads(capsys.readouterr().out.splitlines()[-1])
    (tmp_path / "scene.xml").write_text('<scene version="3.0.0"><include filename="paint.xml"/></scene>')
    tree = ET.parse(tmp_path / "paint.xml")
    assert tree.find("bsdf").get("id") == "paint"
    mi.load_file(str(tmp_path / "scene.xml"))
    bsdf = mi.load_string(ET.tostring(tree.find("bsdf"), "unicode").replace("<bsdf", '<bsdf version="3.0.0"', 1))
    wi, wo = sample_pairs(20_000, seed=9)
    error = log_l1(reflectance(bsdf, wi, wo), m.evaluate(wi, wo), wo[:, 2])
    assert error == pytest.approx(facts["log_l1"], rel=0.1) and error < 4e-3  # GGX is in it, its masking is another


@pytest.mark.slow
def test_materialx_takes_the_document(llvm, tmp_path):
    mx = pytest.importorskip("MaterialX", reason="pip install materialx")
    path = tmp_path / "3 paint.mtlx"
    facts = openpbr.write_mtlx(Material.analytic("ggx").edit(**PAINT), path)
    assert facts["log_l1"] < 6e-3
    document = mx.createDocument()
    mx.readFromXmlFile(document, str(path))
    library = mx.createDocument()
    mx.loadLibraries(mx.getDefaultDataLibraryFolders(), mx.getDefaultDataSearchPath(), library)
    document.setDataLibrary(library)
    valid, message = document.validate()
    assert valid, message
    (material,) = document.getMaterialNodes()
    (surface,) = mx.getShaderNodes(material)
    assert (material.getName(), surface.getCategory()) == ("_3_paint", "open_pbr_surface")
    definition = surface.getNodeDef()
    for one in surface.getInputs():
        assert definition.getActiveInput(one.getName()).getType() == one.getType()
    assert surface.getInputValue("specular_ior") == pytest.approx(facts["specular_ior"], rel=1e-5)


def test_gltf_file_is_one(llvm, tmp_path):
    facts = gltf.write_gltf(Material.analytic("ggx").edit(**PAINT), tmp_path / "paint.gltf")
    assert facts["log_l1"] < 4e-3
    asset = json.loads((tmp_path / "paint.gltf").read_text())
    (material,) = asset["materials"]
    assert asset["asset"]["version"] == "2.0" and material["name"] == "paint"
    assert set(material["extensions"]) == set(asset["extensionsUsed"])
    factors = material["pbrMetallicRoughness"]
    assert len(factors["baseColorFactor"]) == 4
    assert all(
        0 <= v <= 1 for v in [*factors["baseColorFactor"], factors["metallicFactor"], factors["roughnessFactor"]]
    )
