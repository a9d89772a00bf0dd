"""Measurements from photographs with known normals and lights: what goes in comes out, in every set-up."""

from __future__ import annotations

import json

import mitsuba as mi
import numpy as np
import pytest

from mi_enhance import data
from mi_enhance.data.lights import Light, read_light
from mi_enhance.data.photometric_file import PhotometricFile
from mi_enhance.fitting.fit import fit
from mi_enhance.material.material import Material

PAINT = Material.analytic("ggx")
SIZE = 24
LIGHTS = [(0.0, 0.0, 1.0), (0.6, 0.0, 0.8), (0.0, -0.6, 0.8), (-0.48, 0.36, 0.8)]


@pytest.fixture(scope="module")
def paint():
    mi.set_variant("llvm_ad_rgb")
    return PAINT.edit(rho_d=(0.3, 0.1, 0.05), rho_s=0.5, alpha_x=0.3, alpha_y=0.3, F0=0.08)


def write(path, image):
    mi.Bitmap(np.ascontiguousarray(image, np.float32)).write(str(path))


def sphere_normals():
    x, y = np.meshgrid((np.arange(SIZE) + 0.5) / SIZE * 2 - 1, 1 - (np.arange(SIZE) + 0.5) / SIZE * 2)
    z = np.sqrt(np.maximum(1 - x**2 - y**2, 0))
    return np.where(((x**2 + y**2) < 0.98)[..., None], np.stack([x, y, z], -1), 0)


def tangent_frames(n):
    """As docs/photographs.md has them: x along the world's x, as far as the surface lets it."""
    x = np.array([1.0, 0, 0]) - n[:, :1] * n
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    return np.stack([x, np.cross(n, x), n], 1)


def shaded(material, n, view, light, irradiance):
    """Radiance of points with normals n, by the definition of a BRDF."""
    to_local = tangent_frames(n)
    wi, wo = (np.einsum("pij,pj->pi", to_local, np.broadcast_to(v, n.shape)) for v in (view, light))
    up = (wi[:, 2] > 1e-3) & (wo[:, 2] > 1e-3)
    value = np.zeros(n.shape)
    value[up] = material.evaluate(wi[up], wo[up]) * wo[up, 2:]
    return value * irradiance


def photographed(folder, material, **more):
    """A sphere under distant lights, the last one held out, as files."""
    normals = sphere_normals()
    inside = normals.any(-1)
    frames = []
    for k, direction in enumerate(LIGHTS):
        intensity = np.array([1.0, 2.0, 3.0]) + k
        image = np.zeros((SIZE, SIZE, 3))
        image[inside] = 0.5 * shaded(material, normals[inside], (0, 0, 1), direction, intensity)
        write(folder / f"{k}.exr", image)
        light = {"type": "directional", "direction": direction, "intensity": intensity.tolist()}
        split = "test" if k == 3 else "train"
        frames.append({"file_path": f"{k}.exr", "light": light, "exposure_factor": 0.5, "split": split})
    np.save(folder / "normals.npy", normals.astype(np.float32))
    content = {"normals": "normals.npy", "frames": frames, **more}
    (folder / "photometric.json").write_text(json.dumps(content))
    return content


def test_reflectance_of_a_sphere_is_what_it_was_painted_with(paint, tmp_path):
    content = photographed(tmp_path, paint)
    m = data.photometric(tmp_path)
    assert (m.f > 0).all() and m.clamped_fraction == 0
    np.testing.assert_allclose(paint.evaluate(m.wi, m.wo), m.f, rtol=1e-4, atol=1e-6)  # float32, as normals are
    held_out = data.photometric(tmp_path, split="test")
    one = {**content, "exposure_factor": 0.5}
    for frame in one["frames"]:
        del frame["exposure_factor"]
    (tmp_path / "photometric.json").write_text(json.dumps(one))  # of all frames
    assert (data.photometric(tmp_path).f == m.f).all()
    assert len(held_out.f) < len(m.f) and "1 photographs" in held_out.source
    assert len(data.load(tmp_path / "photometric.json", n_samples=100).f) == 100  # the command line's way


def test_a_fit_to_photographs_finds_the_material(paint, tmp_path):
    photographed(tmp_path, paint)
    assert fit(PAINT, data.photometric(tmp_path)).report["log_l1"] < 1e-3


def test_shadow_and_saturation_are_left_out(paint, tmp_path):
    content = photographed(tmp_path, paint)
    below = sphere_normals() @ np.array(LIGHTS[1]) < 0.01
    (frame,) = [f for f in PhotometricFile(tmp_path).read() if f.name == "1.exr"]
    assert not frame.counts[below.ravel()].any()
    (tmp_path / "photometric.json").write_text(json.dumps({**content, "ceiling": 0.3}))
    assert np.mean([f.counts.mean() for f in PhotometricFile(tmp_path).read()]) > 0.1
    for f in PhotometricFile(tmp_path).read():
        image = np.array(mi.Bitmap(str(tmp_path / f.name))).reshape(-1, 3)
        assert not f.counts[(image >= 0.3).any(1)].any()


@pytest.mark.parametrize("shape", ["sphere", "mesh"])
def test_a_perspective_camera_and_a_flash_see_the_right_points(paint, tmp_path, shape):
    """The truth is Mitsuba's render of a sphere of 0.5 under a point light at the camera, 3 in front of its middle."""
    sphere = {"type": "sphere", "center": [0.1, 0, 0], "radius": 0.5, "bsdf": paint.bsdf()}
    light = {"type": "point", "position": [0, 0, 3], "intensity": {"type": "rgb", "value": [5.0, 6.0, 7.0]}}
    camera = {
        "type": "perspective",
        "fov": 30,
        "to_world": mi.ScalarTransform4f().look_at([0, 0, 3], [0, 0, 0], [0, 1, 0]),
    }
    film = {"type": "hdrfilm", "width": 32, "height": 24, "pixel_format": "rgb", "rfilter": {"type": "box"}}
    scene = mi.load_dict({"type": "scene", "s": sphere, "l": light, "c": {**camera, "film": film}})
    write(tmp_path / "a.exr", np.array(mi.render(scene, integrator=mi.load_dict({"type": "direct"}), spp=256)))
    given: object = {"center": [0.1, 0, 0], "radius": 0.5}
    if shape == "mesh":
        given = "ball.ply"
        write_sphere(tmp_path / given, np.array([0.1, 0, 0]), 0.5)
    pose = np.eye(4)
    pose[2, 3] = 3
    content = {
        shape: given,
        "camera": {"type": "perspective", "camera_angle_x": np.radians(30), "transform_matrix": pose.tolist()},
        "frames": [{"file_path": "a.exr", "light": {"type": "flash", "intensity": [5, 6, 7]}}],
    }
    (tmp_path / "photometric.json").write_text(json.dumps(content))
    m = data.photometric(tmp_path)
    error = np.abs(np.log1p(paint.evaluate(m.wi, m.wo) * m.wo[:, 2:]) - np.log1p(m.f * m.wo[:, 2:]))
    # pixels are means over squares, and those of the silhouette of what is behind it, too
    assert np.median(error) < (1e-3 if shape == "sphere" else 3e-3)
    np.testing.assert_allclose(m.wi, m.wo, atol=1e-3)  # the flash is at the camera


def write_sphere(path, center, radius):
    n = 96
    theta, phi = np.meshgrid(np.linspace(0, np.pi, n), np.linspace(0, 2 * np.pi, 2 * n), indexing="ij")
    normals = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], -1).reshape(-1, 3)
    at = np.arange(n * 2 * n).reshape(n, 2 * n)
    a, b, c, d = at[:-1, :-1].ravel(), at[1:, :-1].ravel(), at[1:, 1:].ravel(), at[:-1, 1:].ravel()
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    mesh = mi.Mesh("ball", len(normals), len(faces), has_vertex_normals=True)
    params = mi.traverse(mesh)
    params["vertex_positions"], params["vertex_normals"] = (center + radius * normals).ravel(), normals.ravel()
    params["faces"] = faces.ravel()
    params.update()
    mesh.write_ply(str(path))


def test_texels_of_a_flat_sample(paint, tmp_path):
    """Flash photographs rectified to the plane: a pixel is a texel. What does not count is another of its samples."""
    frames, width = [], 2.0
    x = (np.arange(SIZE) + 0.5) / SIZE * width - 1
    points = np.stack([*np.meshgrid(x, -x), np.zeros((SIZE, SIZE))], -1).reshape(-1, 3)
    for k, place in enumerate([(0, 0, 4.0), (1, 0, 3.0), (0, -1, 5.0)]):
        to = np.array(place) - points
        r = np.linalg.norm(to, axis=1, keepdims=True)
        up = np.tile([0.0, 0, 1], (len(points), 1))
        image = shaded(paint, up, to / r, to / r, 12 / r**2).reshape(SIZE, SIZE, 3)
        image[3, 5] = image[3, 5] if k else 99.0
        write(tmp_path / f"{k}.exr", image)
        light = {"type": "flash", "intensity": 12}
        camera = {"type": "rectified", "position": place}
        frames.append({"file_path": f"{k}.exr", "light": light, "camera": camera, "ceiling": 50})
    content = {"plane": {"width": width}, "camera": frames[0]["camera"], "frames": frames}
    (tmp_path / "photometric.json").write_text(json.dumps(content))
    found = data.photometric_texels(tmp_path)
    assert found.f.shape == (SIZE, SIZE, 3, 3) and found.counts.sum() == 3 * SIZE**2 - 1
    np.testing.assert_allclose(
        paint.evaluate(found.wi.reshape(-1, 3), found.wo.reshape(-1, 3)), found.f.reshape(-1, 3), rtol=1e-3
    )
    assert not found.counts[3, 5, 0] and (found.f[3, 5, 0] == found.f[3, 5, 1]).all()
    window = data.photometric_texels(tmp_path, rows=(0, 12), columns=(4, 20), factor=2)
    assert window.f.shape == (6, 8, 3, 3)
    with pytest.raises(ValueError, match=f"factor is {2 * SIZE}, more than"):
        data.photometric_texels(tmp_path, factor=2 * SIZE)
    np.testing.assert_allclose(window.f[2, 1], found.f[4:6, 6:8].mean((0, 1)), rtol=2e-5)


def test_a_spot_falls_off_as_that_of_mitsuba(llvm):
    to_world = mi.ScalarTransform4f().look_at([0, 0, 2], [1, 0, 0], [0, 1, 0])
    angles = {"cutoff_angle": 30, "beam_width": 10, "to_world": to_world}
    spot = mi.load_dict({"type": "spot", "intensity": {"type": "rgb", "value": [2.0, 3.0, 4.0]}, **angles})
    entry = {"type": "spot", "position": [0, 0, 2], "direction": [1, 0, -2], "intensity": [2, 3, 4], "cutoff_angle": 30}
    light = read_light({**entry, "beam_width": 10}, "frame 0")
    points = np.random.default_rng(0).uniform(-2, 2, (200, 3)) * [1, 1, 0]
    si = mi.SurfaceInteraction3f()
    si.p = mi.Point3f(points.T)
    ds, value = spot.sample_direction(si, mi.Point2f(0.5))
    got = light.at(points)
    np.testing.assert_allclose(got.irradiance, np.array(value).T, rtol=1e-3, atol=1e-5)
    np.testing.assert_allclose(got.direction, np.array(ds.d).T, atol=1e-5)


def test_an_entry_of_a_light_is_read_as_it_was_written():
    for light in (
        Light("directional", (1.0, 2.0, 3.0), direction=(0.0, 0.6, 0.8)),
        Light("spot", (1.0, 1.0, 1.0), (1.0, 2.0, 3.0), (0.0, 0.0, -1.0), 30.0, 20.0),
        Light("flash", (5.0, 5.0, 5.0), (0.1, 0.0, 0.0)),
        Light("envmap", file_path="sky.exr"),
    ):
        assert read_light(json.loads(json.dumps(light.entry())), "frame 0") == light


def one(light=None, **entries):
    return {"frames": [{"file_path": "0.exr", **({"light": light} if light else {}), **entries}]}


MIRRORED = [[-1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
POINT = {"type": "point", "intensity": 1, "position": [0, 0, 1]}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"camera": {"type": "fisheye"}}, "camera is .* orthographic, perspective, rectified"),
        ({"camera": {"type": "orthographic", "widht": 1}}, 'no entry "widht".*Did you mean "width"'),
        ({"sphere": {"center": [0, 0, 0], "radius": 1}}, "normals and sphere is given"),
        ({"normals": None}, "no shape is given"),
        ({"plane": {"width": 1}, "normals": None}, "camera is orthographic, the shape plane"),
        ({"frames": []}, "list"),
        ({"encoding": "srgb"}, 'must be "file"'),
        ({"noramls": 1}, 'unknown entry "noramls".*Did you mean "normals"'),
        ({"tangent": "x"}, "tangent is 'x'; it must be three numbers"),
        ({"tangent": [0, 0, 0]}, "points nowhere"),
        (
            {"camera": {"type": "perspective", "camera_angle_x": 0.7, "transform_matrix": MIRRORED}},
            "Take scale and mirroring out",
        ),
        ({"ceiling": 1e-9}, "no pixel of 3 photographs counts"),
        (one(), "frame 0: light is missing"),
        (one({"type": "sun"}), "light has type 'sun'. Choose one of"),
        (one({"type": "flash", "intensity": 1}), "orthographic camera has no place"),
        (one({"type": "point", "intensity": 1}), "position is missing"),
        (one(POINT), "give positions"),
        (one({**POINT, "intensity": -1}), "not be negative"),
        (one({**POINT, "power": 1}), 'unknown entry "power"'),
        (one({"type": "envmap", "file_path": "x.exr"}), "Use fit-images"),
        (one({"type": "directional", "intensity": 1, "direction": [0, 0, 0]}), "points nowhere"),
        (one({"type": "directional", "intensity": 1, "direction": [0, 0, -1]}), "below the horizon of all"),
        (one(POINT, exposure_factor=0), "exposure_factor is 0; it must be a number above 0"),
    ],
)
def test_wrong_files_are_refused_in_a_sentence(paint, tmp_path, change, message):
    content = {**photographed(tmp_path, paint), **change}
    (tmp_path / "photometric.json").write_text(json.dumps(content))
    with pytest.raises(ValueError, match=message):
        data.photometric(tmp_path)
