"""A light for each photograph, exposures, random pixels, and runs that go on: promises of the loop over photographs."""

from __future__ import annotations

import dataclasses
import json

import mitsuba as mi
import numpy as np
import pytest

from mi_enhance.data.lights import Light
from mi_enhance.images import image_loss, targets
from mi_enhance.images.cameras import around, render_views
from mi_enhance.images.descent import Descent
from mi_enhance.images.fit_images import fit_images
from mi_enhance.images.lit_scene import with_lights
from mi_enhance.images.targets import RandomPixels
from mi_enhance.images.unknowns import enhanced
from mi_enhance.images.view_files import ViewFiles, read_views, write_views
from mi_enhance.images.views import View
from mi_enhance.material.material import Material

LIGHTS = [
    Light("point", (8.0, 9.0, 10.0), position=(2.0, 4.0, 1.0)),
    Light("directional", (1.0, 2.0, 3.0), direction=(0.0, 0.8, 0.6)),
    Light("spot", (30.0, 20.0, 10.0), (0.0, 5.0, 0.0), (0.0, -1.0, 0.0), 20.0, 10.0),
    Light("flash", (20.0, 20.0, 20.0), position=(0.2, 0.0, 0.0)),
]
MATTE = Material.analytic("ggx").edit(rho_d=(0.6, 0.3, 0.1), rho_s=0.0)
SHORT = {"stages": [(1, 4, 40)], "max_depth": 2, "pixels": 512, "lr": 0.1, "unknowns": ["rho_d"]}


def ball(material, **more):
    floor = {"type": "rectangle", "to_world": mi.ScalarTransform4f().scale(4).rotate([1, 0, 0], -90)}
    sphere = {"type": "sphere", "center": [0, 1, 0], "bsdf": material.bsdf()}
    return mi.load_dict({"type": "scene", "ball": sphere, "floor": floor, **more}, optimize=False)


def cameras(n=4, resolution=16):
    views = around(n, target=(0, 1, 0), distance=5, resolution=resolution)
    return [dataclasses.replace(v, light=light) for v, light in zip(views, LIGHTS, strict=False)]


@pytest.fixture(scope="module")
def photographs():
    mi.set_variant("llvm_ad_rgb")
    views = render_views(ball(MATTE), cameras(), spp=64, max_depth=2)
    assert all(v.image.mean() > 0.01 for v in views)
    return views


def of_mitsuba(view):
    """The same light as a plugin of Mitsuba."""
    light = view.light.in_world(view.to_world)
    value = {"type": "rgb", "value": list(light.intensity)}
    if light.kind == "point":
        return {"type": "point", "position": light.position, "intensity": value}
    if light.kind == "directional":
        return {"type": "directional", "direction": [-v for v in light.direction], "irradiance": value}
    place, axis = np.array(light.position), np.array(light.direction)
    angles = {"cutoff_angle": light.cutoff_angle, "beam_width": light.beam_width}
    to_world = mi.ScalarTransform4f().look_at(place.tolist(), (place + axis).tolist(), [1, 0, 0])
    return {"type": "spot", "to_world": to_world, "intensity": value, **angles}


@pytest.mark.parametrize("kind", ["path", "prb"])
def test_each_photograph_has_its_own_light_and_all_have_one_trace(llvm, kind):
    """Against Mitsuba's own lights, one scene each; both have the noise of 64 paths a pixel through several bounces."""
    views = cameras()
    numbers = {v.name: k for k, v in enumerate(views)}
    lit = with_lights(ball(MATTE), [v.light.in_world(v.to_world) for v in views])
    (target,) = targets.targets(views, 1, numbers)
    integrator = mi.load_dict({"type": kind, "max_depth": 3})
    images = targets.split(np.array(mi.render(lit, sensor=target.sensor, integrator=integrator, spp=64)), target)
    for view, image in zip(views, images, strict=True):
        scene, sensor = ball(MATTE, light=of_mitsuba(view)), mi.load_dict(view.sensor())
        truth = np.array(mi.render(scene, sensor=sensor, integrator=integrator, spp=64, seed=7))
        assert truth.mean() > 0.01
        assert image.mean() == pytest.approx(truth.mean(), rel=0.02), view.light.kind
        assert np.abs(image - truth).mean() < 0.05 * truth.mean(), view.light.kind


def test_the_scene_keeps_its_keys(llvm):
    scene = ball(MATTE)
    before = list(mi.traverse(scene).keys())
    lit = with_lights(scene, [LIGHTS[0]])
    assert list(mi.traverse(scene).keys()) == before
    assert {k for k in mi.traverse(lit).keys() if "rho" in k} == {k for k in before if "rho" in k}
    assert with_lights(scene, [None, None]) is scene


def test_rays_are_those_of_mitsubas_camera(llvm):
    """With and without the optical axis in the middle; to a thousandth of a pixel."""
    for middle in ((0.5, 0.5), (0.3, 0.6)):
        (view,) = around(1, target=(0, 1, 0), distance=5, resolution=8)
        view = dataclasses.replace(view, principal_point=middle, image=np.zeros((6, 8, 3)), mask=None)
        (target,) = targets.targets([view])
        place = mi.Point2f(*np.random.default_rng(0).random((2, 50)).astype(np.float32))
        ours, _ = target.sensor.sample_ray(0, 0, place, 0)
        theirs, _ = mi.load_dict(view.sensor()).sample_ray(0, 0, place, 0)
        np.testing.assert_allclose(np.array(ours.d), np.array(theirs.d), atol=1e-4)


def test_random_pixels_are_those_of_the_photographs_and_equally_many_of_each():
    mi.set_variant("llvm_ad_rgb")
    rng, pixels = np.random.default_rng(0), RandomPixels(100, 6, 3, np.random.default_rng(1))
    assert pixels.n == 128  # a multiple of 64
    images = [rng.random((4 + k, 5, 3)).astype(np.float32) for k in range(3)]
    for k, image in enumerate(images):
        mask = np.ones(image.shape[:2], bool)
        mask[0] = False
        pixels.add(View(f"{k}", image, np.eye(4), 40.0, mask, ceiling=0.9), 10 * k)
    for target in pixels.batches(0, 6):
        number, colours = target.numbers.ravel(), target.image.reshape(-1, 3)
        assert sorted(np.bincount(number)[::10].tolist()) == [42, 43, 43]
        assert target.weight.sum() == pytest.approx(1, rel=1e-5)
        saturated = target.saturated.reshape(-1, 3)
        for k, image in enumerate(images):
            own = {tuple(c) for c in image[1:].reshape(-1, 3)}
            assert {tuple(c) for c in colours[number == 10 * k]} <= own
            assert (saturated == (colours >= np.float32(0.9) * (1 - 1e-6))).all()


def test_gradients_of_random_pixels_are_those_of_whole_photographs(photographs):
    """In the mean: of exposures, light and colours alike; the spread of a mean of 30 batches is several percent."""
    from mi_enhance.images.fit_images import EXPOSURE, LIGHT
    from mi_enhance.images.unknowns import Unknown

    numbers = {v.name: k for k, v in enumerate(photographs)}
    lit = with_lights(ball(MATTE.edit(rho_d=0.2)), [v.light.in_world(v.to_world) for v in photographs])
    special = Unknown("light_scale", LIGHT), Unknown("exposure_factors", EXPOSURE)
    descent = Descent(
        lit, enhanced(lit, ["rho_d"]), special[0], image_loss.Measure("log", 0.1), 2, 0, special[1], np.ones(4, bool)
    )
    pixels = RandomPixels(256, 30, 4, np.random.default_rng(0))
    for k, view in enumerate(photographs):
        pixels.add(view, k)
    whole = targets.targets(photographs, 1, numbers)

    def mean_gradient(batches):
        found = []
        for target in batches:
            found.append({})
            descent._move = lambda u, g, *rest: found[-1].update({u.key: g})
            descent.step(target, 16, 0.0)
        return {key: np.mean([g[key] for g in found], axis=0) for key in found[0]}

    some, all_of_them = mean_gradient(pixels.batches(0, 30)), mean_gradient(whole * 8)
    for key, expected in all_of_them.items():
        np.testing.assert_allclose(some[key], expected, atol=0.15 * np.abs(expected).max(), err_msg=key)


def test_lights_are_written_and_read(photographs, tmp_path):
    file = write_views(photographs, tmp_path)
    assert [v.light for v in read_views(tmp_path)] == [v.light for v in photographs]
    content = json.loads(file.read_text())
    content["frames"][0]["exposure_factor"] = 2
    file.write_text(json.dumps(content))
    files = ViewFiles(tmp_path)
    np.testing.assert_allclose(files[0].image, photographs[0].image / 2, rtol=1e-6)
    assert files.names == [v.name for v in photographs] and files.splits == ["train"] * 4 and len(files[1:3]) == 2


@pytest.mark.parametrize(
    ("entry", "value", "message"),
    [
        ("light", {"type": "flash"}, "frame 1: light of type flash: intensity is missing"),
        ("light", {"type": "sun", "intensity": 1}, "light has type 'sun'. Choose one of: directional"),
        ("light", {"type": "envmap", "file_path": "sky.exr"}, 'no image "sky.exr"'),
        ("exposure_factor", -1, "exposure_factor = -1; needed: positive"),
        ("exposure_factor", "long", "exposure_factor must be a number"),
    ],
)
def test_wrong_entries_are_refused(photographs, tmp_path, entry, value, message):
    file = write_views(photographs, tmp_path)
    content = json.loads(file.read_text())
    content["frames"][1][entry] = value
    file.write_text(json.dumps(content))
    with pytest.raises((ValueError, FileNotFoundError), match=message):
        read_views(tmp_path)


def test_photographs_without_light_are_told(photographs):
    without = [dataclasses.replace(v, light=None) for v in photographs]
    with pytest.raises(ValueError, match='1 of 4 views have no light entry ."view_01"'):
        fit_images(ball(MATTE), [photographs[0], without[1], *photographs[2:]], **SHORT)
    with pytest.raises(ValueError, match="nothing lights the scene"):
        fit_images(ball(MATTE), without, **SHORT)


def test_exposures_that_contradict_each_other_are_told(photographs):
    wrong = [dataclasses.replace(photographs[0], image=2.5 * photographs[0].image), *photographs[1:]]
    with pytest.warns(UserWarning, match='exposures contradict each other.*"view_00"|1 of 4 photographs'):
        fit_images(ball(MATTE), wrong, **{**SHORT, "stages": [(1, 4, 3)]})


@pytest.mark.slow
def test_exposures_are_found(photographs):
    """Wrong by up to 2 at random: to 2 %, up to the one factor that no photograph tells from the albedo."""
    wrong = np.array([2.0, 0.6, 0.5, 1.5])
    views = [dataclasses.replace(v, image=v.image * np.float32(w)) for v, w in zip(photographs, wrong, strict=True)]
    found = fit_images(ball(MATTE.edit(rho_d=0.3)), views, exposures=True, **{**SHORT, "stages": [(1, 16, 120)]})
    factors = np.array(list(found.report["exposure_factors"].values()))
    expected = wrong / np.exp(np.log(wrong).mean())
    np.testing.assert_allclose(factors, expected, rtol=0.02)
    assert found.report["mean_abs_log"]["train"] < 0.01


@pytest.mark.slow
def test_a_run_that_was_killed_goes_on_where_it_was(photographs, tmp_path):
    """The same steps as one that was not; the state of another run is left alone."""

    def kill(progress):
        if progress.stage.startswith("stage") and progress.step == 25:
            raise InterruptedError

    scene, state = ball(MATTE.edit(rho_d=0.3)), tmp_path / "state.npz"
    kept = []
    settings = {**SHORT, "checkpoint": state, "keep": kept.append}
    whole = fit_images(ball(MATTE.edit(rho_d=0.3)), photographs, **SHORT)
    import mi_enhance.images.schedule as schedule

    every, schedule._KEEP_EVERY = schedule._KEEP_EVERY, 0.0
    try:
        with pytest.raises(InterruptedError):
            fit_images(scene, photographs, progress=kill, **settings)
    finally:
        schedule._KEEP_EVERY = every
    assert state.exists() and kept and set(kept[-1]) == set(whole.materials)
    told = []
    again = fit_images(ball(MATTE.edit(rho_d=0.3)), photographs, progress=lambda p: told.append(p.step), **settings)
    assert len(again.curve) == len(whole.curve) and len([k for k in told if k]) < 40  # not from the beginning
    for key, value in whole.values.items():
        np.testing.assert_allclose(again.values[key], value, rtol=0.02)  # threads add samples in any order
    retaken = [dataclasses.replace(photographs[0], image=0.97 * photographs[0].image), *photographs[1:]]
    moved = {"type": "sphere", "center": [0, 3, 0], "radius": 0.2}
    for rho_d, seen, more in ((0.4, photographs, {}), (0.3, retaken, {}), (0.3, photographs, {"more": moved})):
        with pytest.warns(UserWarning, match="other settings, photographs or another scene"):
            other = fit_images(ball(MATTE.edit(rho_d=rho_d), **more), seen, **settings)
        assert len(other.curve) == len(whole.curve)


def test_an_environment_map_is_the_light_of_all_photographs_or_of_none(llvm, tmp_path):
    sky = np.linspace(0.1, 1, 8 * 16 * 3, dtype=np.float32).reshape(8, 16, 3)
    mi.Bitmap(sky).write(str(tmp_path / "sky.exr"))
    light = Light("envmap", (1.0, 2.0, 3.0), file_path=str(tmp_path / "sky.exr"))
    (view,) = around(1, target=(0, 1, 0), distance=5, resolution=16)
    (seen,) = render_views(ball(MATTE), [dataclasses.replace(view, light=light)], spp=64, max_depth=2)
    given = ball(MATTE, sky={"type": "envmap", "bitmap": mi.Bitmap(sky * np.float32([1, 2, 3]))})
    (truth,) = render_views(given, [view], spp=64, max_depth=2)
    assert truth.image.mean() > 0.1 and np.abs(seen.image - truth.image).mean() < 0.03 * truth.image.mean()
    with pytest.raises(ValueError, match="all must have the same"):
        with_lights(ball(MATTE), [light, LIGHTS[0]])
