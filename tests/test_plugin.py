"""The plugin ``enhanced``: one material however it is given, in every wrapper, textured or not; and what it refuses."""

from __future__ import annotations

import mitsuba as mi
import numpy as np
import pytest
from plugin_scenes import SUMMATION, VALUES, analytic, ball, bitmap, directions, evaluate, hit, material, scene, vectors

from mi_enhance import _files
from mi_enhance.material import Material

ROUNDING = 2e-5  # relative: float32, and sums in another order where a texture is in the way
N = 2000
RGB = {"type": "rgb", "value": [0.7, 0.5, 0.2]}


def close(a, b, rel=ROUNDING):
    np.testing.assert_allclose(a, b, rtol=rel, atol=rel * np.abs(b).max())


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
    name = str(_files.network_file("ggx"))
    image = np.array(mi.render(ball({"type": "enhanced", "filename": name})))
    assert np.isfinite(image).all()
    close(image, np.array(mi.render(ball(Material.network("ggx").bsdf()))), SUMMATION)


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


# --- textures ---------------------------------------------------------------------------------------------------------

TEXELS = {
    "rho_d": ((0.1, 0.4, 0.9), (0.8, 0.2, 0.3)), "rho_s": ((0.2, 1.0, 3.0), (0.0, 0.5, 1.0)), "alpha_x": (0.05, 0.7),
    "alpha_y": (0.15, 0.9), "F0": (0.0, 0.8), "t_theta": (-2.0, 0.6), "n_x": (-0.2, 0.3), "n_y": (0.1, -0.3),
}  # fmt: skip


def textures(names):
    return {name: bitmap(np.reshape(TEXELS[name], (1, 2, -1))) for name in names}


SLOW = [pytest.param((n,), marks=pytest.mark.slow, id=n) for n in TEXELS if n not in ("rho_d", "alpha_x")]


@pytest.mark.parametrize("names", [("rho_d",), ("alpha_x",), tuple(TEXELS), *SLOW], ids=lambda v: "-".join(v))
def test_textured_parameter_is_the_value_at_the_point(llvm, names):
    wi, wo = directions(N), directions(N, seed=1)
    ctx, si = mi.BSDFContext(), hit(wi)
    b = mi.load_dict({**material().to_dict(), **textures(names)})
    for k, u in enumerate((0.25, 0.75)):
        plain = material(**{name: TEXELS[name][k] for name in names}).bsdf()
        value = evaluate(b, wi, wo, uv=(u, 0.5))
        close(value, evaluate(plain, wi, wo))
        assert value.any()
        si.uv = mi.Point2f(u, 0.5)
        close(np.array(b.pdf(ctx, si, vectors(wo))), np.array(plain.pdf(ctx, si, vectors(wo))))


@pytest.mark.parametrize("value", (-1.0, 0.0, 5.0))
def test_texture_out_of_range_counts_as_the_bound(llvm, value):
    """0 is what a black texel of a roughness map holds; without the bound it would give NaN."""
    names = ("rho_d", "alpha_x", "F0", "n_x")
    wi, wo = directions(N), directions(N, seed=1)
    b = mi.load_dict({**material().to_dict(), **{name: bitmap(np.full((1, 1, 1), value)) for name in names}})
    plain = {p.name: float(np.clip(value, p.low, p.high)) for p in material().brdf.parameters if p.name in names}
    close(evaluate(b, wi, wo), evaluate(material(**plain).bsdf(), wi, wo))


def test_mesh_attributes_are_textures(llvm):
    values = {"rho_d": (0.7, 0.5, 0.2), "alpha_x": 0.1, "alpha_y": 0.6}
    attributes = {k: {"type": "mesh_attribute", "name": f"vertex_{k}"} for k in values}
    images = []
    for bsdf in ({**material().to_dict(), **attributes}, material(**values).to_dict()):
        props = mi.Properties()
        props["bsdf"] = mi.load_dict(bsdf)
        mesh = mi.Mesh("quad", 4, 2, props=props, has_vertex_texcoords=True)
        p = mi.traverse(mesh)
        p["vertex_positions"] = [-1, -1, 0, 1, -1, 0, 1, 1, 0, -1, 1, 0]
        p["vertex_texcoords"] = [0, 0, 1, 0, 1, 1, 0, 1]
        p["faces"] = [0, 1, 2, 0, 2, 3]
        p.update()
        for k, v in values.items():
            mesh.add_attribute(f"vertex_{k}", np.size(v), np.tile(v, 4).astype(np.float32))
        images.append(np.array(mi.render(scene({"quad": mesh}))))
    close(*images, rel=1e-4)


# --- wrappers ---------------------------------------------------------------------------------------------------------

BUMPS = np.random.default_rng(0).random((8, 8, 1))
WRAPPERS = {
    "twosided": {"type": "twosided"},
    "normalmap": {"type": "normalmap", "normalmap": (0.6, 0.45, 0.95)},
    "bumpmap": {"type": "bumpmap", "bump": BUMPS, "scale": 0.02},
    "mask": {"type": "mask", "opacity": 0.3},
    "blendbsdf": {"type": "blendbsdf", "weight": 0.25, "other": {"type": "diffuse"}},
}


def _not_grazing(w):
    """Out of the reach of our floor for cosines, which Mitsuba's plugin does not have, also in a perturbed frame."""
    w[:, 2] += 0.3 * np.sign(w[:, 2])
    return w / np.linalg.norm(w, axis=1, keepdims=True)


@pytest.mark.parametrize("name", WRAPPERS)
def test_wrapper_does_with_it_what_it_does_with_a_built_in_plugin(llvm, name):
    """Plain GGX with F0 = 1 is Mitsuba's roughconductor without a Fresnel term."""
    wrapper = dict(WRAPPERS[name])
    if name == "normalmap":
        wrapper["normalmap"] = bitmap(np.reshape(wrapper["normalmap"], (1, 1, 3)))
    if name == "bumpmap":
        wrapper["bump"] = {**bitmap(wrapper["bump"]), "filter_type": "bilinear"}
    ours = analytic(alpha_x=0.2, alpha_y=0.5, F0=1.0, rho_d=0.0, rho_s=1.0).to_dict()
    conductor = {"type": "roughconductor", "distribution": "ggx", "alpha_u": 0.2, "alpha_v": 0.5, "material": "none"}
    wi, wo = (_not_grazing(directions(N, seed=k, below=True)) for k in range(2))
    first, second = (evaluate(mi.load_dict({**wrapper, "nested": b}), wi, wo, uv=(0.3, 0.6)) for b in (ours, conductor))
    assert second.any()
    close(first, second, rel=1e-4)


def test_albedo_image_shows_rho_d(llvm):
    integrator = {"type": "aov", "aovs": "albedo:albedo"}
    image = np.array(mi.render(ball(material().to_dict(), integrator=integrator), spp=16))
    np.testing.assert_allclose(image[8, 8, -3:], VALUES["rho_d"], rtol=1e-5)


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
        source = str(_files.demo_data("satin_rosaline_rgb.bsdf"))
    with pytest.raises(RuntimeError, match=message):
        mi.load_dict({"type": "enhanced", **({"filename": source} if source else {})})
