"""The plugin ``enhanced``: its values, one material however it is given, and what it refuses."""

from __future__ import annotations

import mitsuba as mi
import numpy as np
import pytest
from plugin_scenes import SUMMATION, VALUES, ball, close, directions, evaluate, hit, material, scene, vectors

from mi_enhance.material.material import Material
from mi_enhance.system import bundled_files

N = 2000
RGB = {"type": "rgb", "value": [0.7, 0.5, 0.2]}

# --- evaluation -------------------------------------------------------------------------------------------------------


def test_eval_is_the_material_times_the_cosine_of_the_light(llvm):
    wi, wo = directions(N), directions(N, seed=1)
    m = material()
    expected = m.evaluate(wi, wo) * wo[:, 2:]
    close(evaluate(m.bsdf(), wi, wo), expected)
    assert expected.min() == 0 < np.median(expected)  # the tilt hides some


def test_light_is_wo_and_the_viewer_wi(llvm):
    """Reciprocal in f, so swapping both differs by the ratio of the cosines only."""
    wi, wo = directions(N), directions(N, seed=1)
    b = material().bsdf()
    close(evaluate(b, wi, wo) * wi[:, 2:], evaluate(b, wo, wi) * wo[:, 2:])


def test_below_the_horizon_everything_is_zero(llvm):
    wi, wo = directions(N, below=True), directions(N, seed=1, below=True)
    below = (wi[:, 2] <= 0) | (wo[:, 2] <= 0)
    b, ctx, si = material().bsdf(), mi.BSDFContext(), hit(wi)
    value, pdf = b.eval_pdf(ctx, si, vectors(wo))
    for result in (np.array(value).T, np.array(pdf), evaluate(b, wi, wo), np.array(b.pdf(ctx, si, vectors(wo)))):
        assert not result[below].any()
        assert result[~below].any()


def test_context_that_asks_for_something_else_gets_nothing(llvm):
    b = material().bsdf()
    ctx = mi.BSDFContext()
    ctx.type_mask = int(mi.BSDFFlags.DeltaTransmission)
    si, wo = hit(directions(9)), vectors(directions(9, seed=1))
    assert not np.array(b.eval(ctx, si, wo)).any() and not np.array(b.pdf(ctx, si, wo)).any()
    ctx.type_mask = int(mi.BSDFFlags.GlossyReflection)
    assert np.array(b.eval(ctx, si, wo)).any()


def test_diffuse_reflectance_is_rho_d(llvm):
    b = material().bsdf()
    np.testing.assert_allclose(
        np.array(b.eval_diffuse_reflectance(hit(directions(3)))).T[0], VALUES["rho_d"], rtol=1e-6
    )


def test_albedo_image_shows_rho_d(llvm):
    integrator = {"type": "aov", "aovs": "albedo:albedo"}
    image = np.array(mi.render(ball(material().to_dict(), integrator=integrator), spp=16))
    np.testing.assert_allclose(image[8, 8, -3:], VALUES["rho_d"], rtol=1e-5)


# --- however it is given ----------------------------------------------------------------------------------------------


def test_file_dictionary_and_instance_are_one(llvm, tmp_path):
    m = material()
    m.save(tmp_path / "gold.bsdf")
    (tmp_path / "scene.xml").write_text(
        '<scene version="3.0.0"><bsdf type="enhanced" id="m"> <string name="filename" value="gold.bsdf"/> </bsdf>'
        '<shape type="sphere"> <ref id="m"/> </shape></scene>'
    )
    from_xml = mi.load_file(str(tmp_path / "scene.xml")).shapes()[0].bsdf()  # the name is relative to the XML
    from_dict = mi.load_dict({"type": "enhanced", "filename": str(tmp_path / "gold.bsdf")})
    wi, wo = directions(N), directions(N, seed=1)
    expected = evaluate(m.bsdf(), wi, wo)
    images = [np.array(mi.render(ball(b))) for b in (m.bsdf(), from_xml, from_dict, m.to_dict())]
    for b in (from_xml, from_dict, mi.load_dict(m.to_dict())):
        np.testing.assert_array_equal(evaluate(b, wi, wo), expected)
    for image in images[1:]:
        close(image, images[0], SUMMATION)


def test_given_values_replace_those_of_the_file(llvm, tmp_path):
    m = material()
    m.save(tmp_path / "m.bsdf")
    text = f'<bsdf version="3.0.0" type="enhanced"> <string name="filename" value="{tmp_path / "m.bsdf"}"/> %s </bsdf>'
    xml = (
        '<rgb name="rho_d" value="0.7, 0.5, 0.2"/> <float name="rho_s" value="2"/> <float name="alpha_x" value="0.1"/>'
    )
    expected = m.edit(rho_d=RGB["value"], rho_s=2.0, alpha_x=0.1).bsdf()
    edited = {"rho_d": RGB, "rho_s": 2.0, "alpha_x": 0.1}
    wi, wo = directions(N), directions(N, seed=1)
    for b in (mi.load_string(text % xml), mi.load_dict({**m.to_dict(), **edited})):
        np.testing.assert_array_equal(evaluate(b, wi, wo), evaluate(expected, wi, wo))


def test_shipped_network_renders(llvm):
    name = str(bundled_files.network_file("ggx"))
    image = np.array(mi.render(ball({"type": "enhanced", "filename": name})))
    assert np.isfinite(image).all()
    close(image, np.array(mi.render(ball(Material.pretrained("ggx").bsdf()))), SUMMATION)


def test_materials_that_differ_in_a_number_stay_apart(llvm):
    """The parser merges equal objects: these are not."""
    shapes = {f"s{k}": {"type": "sphere", "bsdf": material(rho_d=k / 10).to_dict()} for k in range(3)}
    assert len({s.bsdf() for s in scene(shapes).shapes()}) == 3


def test_keys_are_names_without_addresses(llvm):
    shapes = {"m": material().to_dict(), "ball": {"type": "sphere", "bsdf": {"type": "ref", "id": "m"}}}
    keys = set(mi.traverse(scene(shapes)).keys())
    assert {f"m.{name}" for name in VALUES} <= keys
    assert not any(key.startswith("object_") or "0x" in key for key in keys)


def test_prints_what_the_material_shows(llvm):
    text = str(material().bsdf())
    assert text.startswith("Enhanced[\n  M + S * D * [F] [*] [G] * [1/E]\n") and "alpha_x  0.3" in text


# --- what it refuses --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "given, message",
    [
        ({"alpha_x": 2.0}, r'bsdf "enhanced" \("m"\): alpha_x must lie in \[0.0001, 1\]; got \[2.0\]'),
        ({"rho_d": [0.1, -0.2, 0.3]}, r"rho_d must lie in \[0, 1\]; got \[0.1, -0.2, 0.3\]"),
        ({"alpha_x": "rough"}, "alpha_x must be a number or texture; got 'rough'"),
        ({"F0": [0.1, 0.2, 0.3]}, r"F0 takes 1 number\(s\); got 3"),
        ({"roughness": 0.5}, "(?s)unreferenced property.*roughness"),
        ({"latent": 0.5}, "(?s)unreferenced property.*latent"),
        ({"filename": "gold.bsdf"}, "give filename or weights, not both"),
    ],
    ids=lambda v: "-".join(v) if isinstance(v, dict) else "",
)
def test_bad_value_is_refused(llvm, given, message):
    with pytest.raises(RuntimeError, match=message):
        mi.load_dict({**material().to_dict(), **given, "id": "m"})


def test_spectrum_as_a_number_is_refused_and_as_a_colour_is_not(llvm, tmp_path):
    material().save(tmp_path / "m.bsdf")
    text = (
        f'<bsdf version="3.0.0" type="enhanced"> <string name="filename" value="{tmp_path / "m.bsdf"}"/>'
        '<spectrum name="%s" value="400:0.25, 700:0.25"/> </bsdf>'
    )
    with pytest.raises(RuntimeError, match="F0 must be a number or texture; got .*Spectrum"):
        mi.load_string(text % "F0")
    grey = np.array(mi.load_string(text % "rho_d").eval_diffuse_reflectance(hit(directions(1)))).T
    np.testing.assert_allclose(grey, 0.25, rtol=0.01)


@pytest.mark.parametrize(
    "source, message",
    [
        (None, 'bsdf "enhanced": the parameter "filename" is missing. Name a file made by mi-enhance fit'),
        ("nope.bsdf", 'Material.load\\("nope.bsdf"\\): no such file'),
        ("measured", "this is a measured RGL file, not a material of mi_enhance. Fit it first: mi-enhance fit"),
    ],
)
def test_bad_file_is_refused(llvm, source, message):
    if source == "measured":
        source = str(bundled_files.demo_data("satin_rosaline_rgb.bsdf"))
    with pytest.raises(RuntimeError, match=message):
        mi.load_dict({"type": "enhanced", **({"filename": source} if source else {})})
