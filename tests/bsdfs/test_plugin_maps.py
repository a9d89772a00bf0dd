"""Textures on the plugin, and the plugin in Mitsuba's wrappers."""

from __future__ import annotations

import mitsuba as mi
import numpy as np
import pytest
from plugin_scenes import analytic, bitmap, close, directions, evaluate, hit, material, scene, vectors

from mi_enhance.material.material_maps import MaterialMaps

N = 2000

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


# --- maps ----------------------------------------------------------------------------------------------------------


def _turn():
    return mi.ScalarTransform3f().translate([0.25, 0.1]).rotate(30).scale([3, 2])


def _maps() -> MaterialMaps:
    rng = np.random.default_rng(0)
    return MaterialMaps(material(), {"rho_d": rng.random((3, 4, 3)), "latent": rng.random((3, 4, 27))})


@pytest.mark.parametrize("uv", [(0.3, 0.6), (-0.4, 1.7)])
@pytest.mark.parametrize("wrap_mode", ["repeat", "mirror", "clamp"])
@pytest.mark.parametrize("to_uv", [False, True], ids=["as it is", "turned"])
def test_maps_are_placed_as_a_bitmap_is(llvm, wrap_mode, to_uv, uv):
    """Colours by Mitsuba's own bitmap, latent numbers by ours: the value at the point is that of bitmaps."""
    maps, how = _maps(), {"wrap_mode": wrap_mode, **({"to_uv": _turn()} if to_uv else {})}
    b = mi.load_dict({**maps.to_dict(), **how})
    si, values = hit(directions(1), uv), {}
    for name, channels in maps.maps.items():
        numbers = []
        for k in range(channels.shape[2]):
            data = mi.TensorXf(np.ascontiguousarray(channels[..., k : k + 1]))
            numbers.append(mi.load_dict({"type": "bitmap", "data": data, "raw": True, **how}).eval_1(si)[0])
        values[name] = np.array(numbers)
    wi, wo = directions(N), directions(N, seed=1)
    close(evaluate(b, wi, wo, uv), evaluate(maps.material.edit(**values).bsdf(), wi, wo), 1e-4)


def test_maps_are_turned_by_traverse(llvm):
    b, wi, wo = _maps().bsdf(), directions(N), directions(N, seed=1)
    params = mi.traverse(b)
    for name in ("rho_d", "latent"):
        params[f"{name}.to_uv"] = _turn()
    params.update()
    expected = mi.load_dict({**_maps().to_dict(), "to_uv": _turn()})
    close(evaluate(b, wi, wo, (0.3, 0.6)), evaluate(expected, wi, wo, (0.3, 0.6)))


def test_maps_of_a_file_take_to_uv_from_xml(llvm, tmp_path):
    maps = _maps()
    maps.material.save(tmp_path / "m.bsdf")
    maps.save(tmp_path / "m.exr")
    (tmp_path / "s.xml").write_text(
        '<scene version="3.0.0"><shape type="sphere"><bsdf type="enhanced"><string name="filename" value="m.bsdf"/>'
        '<string name="maps" value="m.exr"/><string name="wrap_mode" value="mirror"/>'
        '<transform name="to_uv"><scale x="3" y="2"/></transform></bsdf></shape></scene>'
    )
    b = mi.load_file(str(tmp_path / "s.xml")).shapes()[0].bsdf()
    how = {"wrap_mode": "mirror", "to_uv": mi.ScalarTransform3f().scale([3, 2])}
    wi, wo = directions(N), directions(N, seed=1)
    close(evaluate(b, wi, wo, (0.7, 0.2)), evaluate(mi.load_dict({**maps.to_dict(), **how}), wi, wo, (0.7, 0.2)))


@pytest.mark.parametrize("key", ["wrap_mode", "filter_type"])
def test_unknown_mode_of_maps_is_refused(llvm, key):
    with pytest.raises(RuntimeError, match=rf'bsdf "enhanced": {key} "tile" is unknown. Choose one of: '):
        mi.load_dict({**_maps().to_dict(), key: "tile"})


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
