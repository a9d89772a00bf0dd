"""Maps over a surface: files, rendering, gradients, and what is refused."""

from __future__ import annotations

import dataclasses

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from plugin_scenes import analytic, ball, bitmap, close, directions, evaluate, material, scene

from mi_enhance.material.material_maps import MaterialMaps

N = 500


def varying(height=2, width=3, seed=0, **values):
    """The paper's state with every parameter a map: random, well inside of the ranges."""
    rng = np.random.default_rng(seed)
    base = material(n_x=0.0, n_y=0.0, **values)
    spread = {"latent": 1.0, "n_x": 0.1, "n_y": 0.1}
    names = [p for p in base.brdf.parameters if not p.fixed]
    low = {p.name: 0.1 for p in names} | {name: -v for name, v in spread.items()}
    return MaterialMaps(base, {p.name: rng.uniform(low[p.name], 0.9, (height, width, p.size)) for p in names})


def refused(maps, match, **changed):
    with pytest.raises(ValueError, match=match):
        dataclasses.replace(maps, maps={**maps.maps, **changed})


def test_file_holds_all_and_names_its_channels(llvm, tmp_path):
    import OpenEXR

    maps = varying()
    maps.save(tmp_path / "cup.exr")
    again = MaterialMaps.load(tmp_path / "cup.exr", maps.material)
    assert again.maps.keys() == maps.maps.keys()
    for name in maps.maps:
        np.testing.assert_array_equal(again.maps[name], maps.maps[name])
    with OpenEXR.File(str(tmp_path / "cup.exr"), separate_channels=True) as file:
        names = set(file.channels())
    assert {"rho_d.R", "alpha_x", "latent.00", "latent.26"} <= names and len(names) == maps.material.brdf.n_parameters
    assert [p.name for p in tmp_path.iterdir()] == ["cup.exr"]  # no temporary file is left


@pytest.mark.parametrize("how", ("memory", "file"))
def test_each_texel_is_the_material_it_stands_for(llvm, tmp_path, how):
    """Row 0 is at the top of the image, v = 0, as in Mitsuba's bitmaps; latent numbers lie where the colours lie."""
    maps = varying()
    if how == "memory":
        bsdf = maps.bsdf("nearest")
    else:
        maps.material.save(tmp_path / "cup.bsdf")
        maps.save(tmp_path / "cup.exr")
        names = {"filename": str(tmp_path / "cup.bsdf"), "maps": str(tmp_path / "cup.exr"), "filter_type": "nearest"}
        bsdf = mi.load_dict({"type": "enhanced", **names})
    wi, wo = directions(N), directions(N, seed=1)
    for row, column in ((0, 0), (0, 2), (1, 1)):
        value = evaluate(bsdf, wi, wo, uv=((column + 0.5) / 3, (row + 0.5) / 2))
        close(value, evaluate(maps.at(row, column).bsdf(), wi, wo))
        assert value.any()


def test_bilinear_latent_is_the_mean_between_two_texels(llvm):
    maps = varying(1, 2)
    maps = dataclasses.replace(maps, maps={"latent": maps.maps["latent"]})
    wi, wo = directions(N), directions(N, seed=1)
    middle = maps.material.edit(latent=maps.maps["latent"].mean((0, 1)))
    close(evaluate(maps.bsdf(), wi, wo, uv=(0.5, 0.5)), evaluate(middle.bsdf(), wi, wo), rel=1e-4)  # weights of 2^-8


def test_constant_maps_render_as_the_constant_material(llvm):
    one = material(n_x=0.0, n_y=0.0)
    constant = MaterialMaps(one, {name: np.tile(v, (3, 4, 1)) for name, v in one.params.items()})
    images = [np.array(mi.render(ball(m.to_dict()), seed=3)) for m in (constant, one)]
    close(*images, rel=1e-3)  # the same random numbers; rounding turns a few paths aside


def test_values_out_of_range_count_as_the_bound(llvm):
    maps = dataclasses.replace(varying(1, 1), maps={"latent": np.full((1, 1, 27), 99.0), "alpha_x": [[[0.0]]]})
    wi, wo = directions(N), directions(N, seed=1)
    at_bound = maps.material.edit(latent=16.0, alpha_x=1e-4)
    close(evaluate(maps.bsdf(), wi, wo), evaluate(at_bound.bsdf(), wi, wo))
    assert np.array_equal(maps.at(0, 0).as_vector(), at_bound.as_vector())


def test_parameter_given_in_the_scene_comes_first(llvm):
    maps = varying(1, 1)
    bsdf = mi.load_dict({**maps.to_dict(), "rho_d": bitmap([[[0.1, 0.2, 0.3]]]), "alpha_x": 0.5})
    wi, wo = directions(N), directions(N, seed=1)
    edited = maps.at(0, 0).edit(rho_d=(0.1, 0.2, 0.3), alpha_x=0.5)
    close(evaluate(bsdf, wi, wo), evaluate(edited.bsdf(), wi, wo))


def test_only_what_varies_is_a_texture(llvm):
    maps = dataclasses.replace(varying(), maps={"rho_d": varying().maps["rho_d"]})
    keys = set(mi.traverse(maps.bsdf()).keys())
    assert {"rho_d.data", "latent", "alpha_x"} <= keys and not {"rho_d", "latent.data", "alpha_x.data"} & keys


def test_update_of_a_latent_map_is_seen(llvm):
    maps, other = varying(1, 1), varying(1, 1, seed=5)
    maps = dataclasses.replace(maps, maps={"latent": maps.maps["latent"]})
    bsdf = maps.bsdf()
    p = mi.traverse(bsdf)
    p["latent.data"] = mi.TensorXf(other.maps["latent"])
    p.update()
    wi, wo = directions(N), directions(N, seed=1)
    close(evaluate(bsdf, wi, wo), evaluate(maps.material.edit(latent=other.maps["latent"][0, 0]).bsdf(), wi, wo))


def test_gradients_of_texels_are_central_differences(llvm):
    """`prb` leaves out that sampling changes, differences do not: noise of 260,000 paths."""
    maps = varying()
    maps = dataclasses.replace(maps, maps={name: maps.maps[name] for name in ("latent", "rho_d")})
    shapes = {"m": maps.to_dict(), "quad": {"type": "rectangle", "bsdf": {"type": "ref", "id": "m"}}}
    s = scene(shapes, integrator={"type": "prb", "max_depth": 2, "hide_emitters": True})
    p, keys = mi.traverse(s), ("m.latent.data", "m.rho_d.data")
    weight = mi.TensorXf(np.linspace(0.5, 1.5, 16 * 16 * 3, dtype=np.float32).reshape(16, 16, 3))
    brightness = lambda spp=64: dr.mean(weight * mi.render(s, p, seed=1, spp=spp), axis=None)  # noqa: E731
    for key in keys:
        dr.enable_grad(p[key])
    p.update()
    value = brightness()
    dr.backward(value)
    gradient = {key: np.array(dr.grad(p[key])) for key in keys}
    for key in keys:
        dr.disable_grad(p[key])
    for key in keys:
        start, entry = np.array(p[key]), int(np.abs(gradient[key]).argmax())
        ends = []
        for sign in (1, -1):
            moved = start.copy()
            moved.flat[entry] += sign * 0.05
            p[key] = mi.TensorXf(moved)
            p.update()
            ends.append(brightness(1024).array[0])
        p[key] = mi.TensorXf(start)
        p.update()
        difference = (ends[0] - ends[1]) / 0.1
        assert gradient[key].flat[entry] == pytest.approx(difference, rel=0.06, abs=1e-3 * value.array[0]), key


# --- errors -----------------------------------------------------------------------------------------------------------


def test_what_maps_cannot_be_is_refused(llvm):
    maps = varying()
    bad = maps.maps["rho_d"].copy()
    bad[1, 2, 0] = np.nan
    refused(maps, "rho_d is nan at row 1, column 2", rho_d=bad)
    refused(maps, r"rho_d has shape \(2, 3, 1\); \(2, 3, 3\) is needed", rho_d=np.zeros((2, 3, 1)))
    refused(maps, r"F0 has shape \(5, 5, 1\); \(2, 3, 1\) is needed", F0=np.zeros((5, 5, 1)))
    refused(maps, 'unknown parameter "gloss". Choose from: n_x', gloss=np.zeros((2, 3, 1)))
    with pytest.raises(ValueError, match="no map at all"):
        MaterialMaps(analytic(), {})


def test_files_of_other_networks_or_with_other_channels_are_refused(llvm, tmp_path):
    import OpenEXR

    maps, path = varying(), tmp_path / "cup.exr"
    maps.save(path)
    with pytest.raises(ValueError, match=r"these maps belong to M \+ .* Give the material that was saved"):
        MaterialMaps.load(path, analytic())
    with OpenEXR.File(str(path), separate_channels=True) as file:
        header, channels = dict(file.header()), {name: np.array(c.pixels) for name, c in file.channels().items()}

    def rewritten(channels, header=header):
        keep = {k: v for k, v in header.items() if k in ("compression", "type", "mi_enhance")}
        with OpenEXR.File(keep, channels) as file:
            file.write(str(path))

    rewritten({name: v for name, v in channels.items() if name != "latent.07"})
    with pytest.raises(ValueError, match='channel "latent.07" is missing; latent has 27'):
        MaterialMaps.load(path, maps.material)
    rewritten({**channels, "gloss": channels["F0"]})
    with pytest.raises(ValueError, match='unknown channel "gloss"'):
        MaterialMaps.load(path, maps.material)
    rewritten(channels, {k: v for k, v in header.items() if k != "mi_enhance"})
    with pytest.raises(ValueError, match='its header has no "mi_enhance"'):
        MaterialMaps.load(path, maps.material)
    path.write_bytes(path.read_bytes()[:200])
    with pytest.raises(ValueError, match="cannot read this file"):
        MaterialMaps.load(path, maps.material)
    path.write_bytes(b"\x89PNG\r\n\x1a\n")
    with pytest.raises(ValueError, match="this is no OpenEXR file"):
        MaterialMaps.load(path, maps.material)
    with pytest.raises(FileNotFoundError, match="no such file"):
        MaterialMaps.load(tmp_path / "none.exr", maps.material)


def _windows(data, display):
    """Windows of an EXR header, each (left, top, width, height)."""
    box = lambda x, y, w, h: (np.array([x, y], np.int32), np.array([x + w - 1, y + h - 1], np.int32))  # noqa: E731
    return {"dataWindow": box(*data), "displayWindow": box(*display)}


def _resaved(path, pad=0, tiled=False, **header):
    """The file with other attributes, and `pad` more texels on every side."""
    import OpenEXR

    with OpenEXR.File(str(path), separate_channels=True) as file:
        text = file.header()["mi_enhance"]
        channels = {name: np.pad(c.pixels, pad, mode="symmetric") for name, c in file.channels().items()}
    header |= {"compression": OpenEXR.ZIP_COMPRESSION, "mi_enhance": text}
    header["type"] = OpenEXR.tiledimage if tiled else OpenEXR.scanlineimage
    if tiled:
        header["tiles"] = OpenEXR.TileDescription()
    with OpenEXR.File(header, channels) as file:
        file.write(str(path))


@pytest.mark.parametrize(
    "how",
    [{"tiled": True}, _windows((7, 5, 3, 2), (7, 5, 3, 2)), {"pad": 2, **_windows((-2, -2, 7, 6), (0, 0, 3, 2))}],
    ids=["tiles", "moved", "overscan"],
)
def test_maps_lie_in_the_display_window(llvm, tmp_path, how):
    maps = varying(2, 3)
    maps.save(tmp_path / "cup.exr")
    _resaved(tmp_path / "cup.exr", **how)
    again = MaterialMaps.load(tmp_path / "cup.exr", maps.material)
    for name, v in maps.maps.items():
        np.testing.assert_array_equal(again.maps[name], v)


@pytest.mark.parametrize("display", [(0, 0, 8, 6), (-4, 0, 7, 2), (1, 0, 3, 2)])
def test_cropped_maps_are_refused(llvm, tmp_path, display):
    """What lies outside of the data window has no material."""
    maps = varying(2, 3)
    maps.save(tmp_path / "cup.exr")
    _resaved(tmp_path / "cup.exr", **_windows((0, 0, 3, 2), display))
    with pytest.raises(ValueError, match=r"is cropped: its data window is 3 x 2 texels from column .* Save it without"):
        MaterialMaps.load(tmp_path / "cup.exr", maps.material)


def test_damaged_headers_are_refused(llvm, tmp_path):
    """Every byte of the header, flipped or cut: an error of ours, or the maps as they are."""
    maps, path = varying(2, 3), tmp_path / "cup.exr"
    maps.save(path)
    whole = path.read_bytes()
    rng = np.random.default_rng(0)
    for k in rng.integers(0, len(whole), 300):
        damaged = bytearray(whole)
        damaged[k] ^= 1 << rng.integers(8)
        path.write_bytes(damaged if k % 2 else whole[:k])
        try:
            loaded = MaterialMaps.load(path, maps.material)
        except ValueError as error:
            assert "MaterialMaps.load(" in str(error)
        else:
            assert loaded.shape == maps.shape


def test_scene_with_an_unknown_filter_is_refused(llvm):
    with pytest.raises(RuntimeError, match='filter_type "cubic" is unknown. Choose one of: bilinear, nearest'):
        mi.load_dict(varying().to_dict("cubic"))
