"""Fits to images: what is recovered, what is left out of the loss, and what is said when something is wrong."""

from __future__ import annotations

import dataclasses
import json

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from plugin_scenes import bitmap

from mi_enhance.analytic.parameters import ALPHA_X, F0, N_X
from mi_enhance.cli.main import main
from mi_enhance.evaluation import scenes
from mi_enhance.images import fit_images as module
from mi_enhance.images import image_loss, scene_materials, unknowns
from mi_enhance.images import targets as targets_module
from mi_enhance.images.cameras import around, render_views
from mi_enhance.images.descent import Descent
from mi_enhance.images.fit_images import fit_images
from mi_enhance.images.pictures import draw_convergence, draw_views
from mi_enhance.images.scene_materials import find
from mi_enhance.images.starts import with_best_colours
from mi_enhance.images.unknowns import Unknown, of_plugin
from mi_enhance.images.view_files import write_views
from mi_enhance.material.material import Material

PAINT = {"rho_d": (0.1, 0.2, 0.4), "rho_s": 1.0, "alpha_x": 0.25, "alpha_y": 0.25, "F0": 0.1}
SHORT = {"stages": [(1, 16, 30)], "max_depth": 2, "pixels": 1024}
# Log difference of a re-render: noise of photographs and re-renders, 256 and 128 paths a pixel under a sky with bright
# windows, is 0.01 to 0.02; the materials that the fits start from are off by 0.1 and more.
NOISE = 0.03


def ball(bsdf):
    return scenes.load("sphere_envmap", bsdf, resolution=16, spp=1)


def photographed(scene, *, n=3, resolution=24, depth=2, spp=256):
    """Views around a ball, the last one held out."""
    cameras = around(n, target=(0, 1, 0), distance=4.5, resolution=resolution)
    cameras[-1] = dataclasses.replace(cameras[-1], split="test")
    return render_views(scene, cameras, spp=spp, max_depth=depth)


@pytest.fixture(scope="module")
def paint():
    """Photographs of a painted ball."""
    mi.set_variant("llvm_ad_rgb")
    return photographed(ball(Material.analytic("ggx").edit(**PAINT).bsdf()))


# ---------------------------------------------------------------------- unknowns


@pytest.mark.parametrize("parameter", [ALPHA_X, F0, N_X], ids=lambda p: p.name)
def test_space_of_an_unknown_is_one_to_one_and_its_slope_the_derivative(parameter):
    u = Unknown("x", parameter).space
    values = np.linspace(parameter.low, parameter.high, 7)
    np.testing.assert_allclose(u.to_physical(u.to_free(values)), values, atol=1e-12)
    inside = u.to_free(values[1:-1])
    differences = (u.to_physical(inside + 1e-5) - u.to_physical(inside - 1e-5)) / 2e-5
    np.testing.assert_allclose(u.slope(inside), differences, rtol=1e-6)
    assert (u.to_physical(np.array([-1e3, 1e3])) >= parameter.low).all()


def test_wrong_calls_are_refused_before_anything_is_rendered(paint):
    scene = ball(Material.analytic("ggx").bsdf())
    plain = ball({"type": "diffuse"})
    gloss, ward = of_plugin("ball.bsdf", {"gloss": (0, 1)}), Material.analytic("ward")
    calls = {
        'no BSDF of type "enhanced"': lambda: fit_images(plain, paint),
        'no material has a parameter "colour"': lambda: fit_images(scene, paint, unknowns=["colour"]),
        'no parameter "ball.bsdf.gloss"': lambda: fit_images(scene, paint, unknowns=gloss),
        "unknowns is empty": lambda: fit_images(scene, paint, unknowns=[]),
        'has split "train"': lambda: fit_images(scene, paint[-1:]),
        "two views have the same name": lambda: fit_images(scene, paint + paint),
        "must be a positive integer": lambda: fit_images(scene, paint, stages=[(1, 0, 5)]),
        "stages is empty": lambda: fit_images(scene, paint, stages=[]),
        "lr = -1": lambda: fit_images(scene, paint, lr=-1),
        "max_depth is 1": lambda: fit_images(scene, paint, max_depth=1),
        'loss "l2" is unknown': lambda: fit_images(scene, paint, loss="l2"),
        'materials names "cup"': lambda: fit_images(scene, paint, materials={"cup": Material.analytic("ggx")}),
        "Load the scene with the same": lambda: fit_images(scene, paint, materials={"ball.bsdf": ward}),
        "no pixel of the 1 views": lambda: fit_images(
            scene, [dataclasses.replace(paint[0], mask=np.zeros((24, 24), bool))], **SHORT
        ),
        "too few": lambda: fit_images(scene, paint, stages=[(64, 1, 1)]),
    }  # fmt: skip
    for message, call in calls.items():
        with pytest.raises(ValueError, match=message):
            call()


# ---------------------------------------------------------------------- loss


def test_stages_follow_what_is_sought_and_the_pixels_that_count(paint):
    """One material: pictures of about 64 x 64 pixels that count; maps: up to the full size."""
    scene, views = ball(Material.analytic("ggx").bsdf()), paint
    large = dataclasses.replace(views[0], image=np.zeros((300, 400, 3)), mask=np.ones((300, 400), bool))
    few = dataclasses.replace(large, mask=np.arange(400) < np.full((300, 1), 14))
    one = [Unknown("ball.bsdf.F0", F0)]
    found = [module._stages(scene, one, [view]) for view in (views[0], large, few)]
    assert found == [((1, 8, 400),), ((5, 8, 400),), ((1, 8, 400),)]


def test_masked_and_saturated_pixels(llvm):
    """What is under the mask changes nothing; where the photograph is saturated, brighter is as good, darker is not."""
    (view,) = around(1, target=(0, 1, 0), distance=5, resolution=4)
    image = np.full((4, 4, 3), 0.5, np.float32)
    image[0] = 1.0
    mask = np.ones((4, 4), bool)
    mask[3] = False
    (target,) = targets_module.targets([dataclasses.replace(view, image=image, mask=mask, ceiling=1.0)])
    measure, relative = image_loss.Measure("log", 0.5), image_loss.Measure("relative", 0.5)
    changed = image.copy()
    changed[0], changed[3] = 7.0, 100.0
    assert measure.loss(image, target) == measure.loss(changed, target) == relative.loss(changed, target) == 0
    assert not measure.pull(changed, changed, target).any() and not relative.pull(changed, changed, target).any()
    changed[0] = 0.5
    # one of three rows that count: log(1 + 1 / 0.5) - log(1 + 0.5 / 0.5)
    assert measure.loss(changed, target) == pytest.approx(np.log(1.5) / 3, rel=1e-5)
    assert relative.loss(changed, target) == pytest.approx(0.5 / 1.5 / 3, rel=1e-5)
    pull = measure.pull(changed, changed, target)
    assert (pull[0] < 0).all() and not pull[1:].any()


@pytest.mark.parametrize("kind", image_loss.LOSSES)
def test_pull_is_the_gradient_of_the_loss(llvm, kind):
    """To 5 %: that is how far the pull gives way where a pixel is explained to 40 % of its brightness and more."""
    rng = np.random.default_rng(0)
    (view,) = around(1, target=(0, 1, 0), distance=5, resolution=4)
    image = 0.5 + rng.random((4, 4, 3), np.float32)
    (target,) = targets_module.targets([dataclasses.replace(view, image=image)])
    measure = image_loss.Measure(kind, 0.1)
    x = image * np.where(rng.random(image.shape) > 0.5, 2, 0.5)
    differences = np.zeros_like(image)
    for k in np.ndindex(image.shape):
        step = np.zeros_like(image)
        step[k] = 1e-4
        differences[k] = (measure.loss(x + step, target) - measure.loss(x - step, target)) / 2e-4
    np.testing.assert_allclose(measure.pull(x, x, target), differences, rtol=0.05)


def test_views_of_several_sizes_are_rendered_in_groups(paint):
    small = [dataclasses.replace(v.smaller(2), name=f"small {v.name}") for v in paint]
    groups = targets_module.targets([*paint, *small])
    assert [len(g.views) for g in groups] == [3, 3]
    for g in groups:
        for view, part in zip(g.views, targets_module.split(g.image, g), strict=True):
            np.testing.assert_array_equal(view.image, part)
        assert g.weight.sum() == pytest.approx(1, rel=1e-5)


# ---------------------------------------------------------------------- fits


def test_fit_explains_views_it_has_not_seen(paint, tmp_path):
    scene = ball(Material.analytic("ggx").bsdf())
    told = []
    found = fit_images(scene, paint, progress=lambda p: told.append(p.values), preview=tmp_path, **SHORT)
    losses = [values["loss"] for values in told if "loss" in values]
    before = [values for values in told[: told.index(next(v for v in told if "loss" in v))] if "left" in values]
    assert before  # how long it will take is known before the first iteration
    report = found.report
    assert report["mean_abs_log"]["test"] < NOISE and report["mean_abs_log"]["train"] < NOISE
    assert report["nonfinite_gradients"] == report["nonfinite_pixels"] == 0 and report["n_unknowns"] == 10
    assert [row["loss"] for row in found.curve] == losses and len(losses) == report["iterations"]
    material = found.materials["ball.bsdf"]
    # rho_s and F0 make one brightness where the light is far from grazing: only the diffuse colour is certain
    np.testing.assert_allclose(material.params["rho_d"], PAINT["rho_d"], atol=0.05)
    json.dumps(report)
    # the scene keeps what was found, and the file says it
    np.testing.assert_allclose(
        np.ravel(mi.traverse(scene)["ball.bsdf.rho_d"]), found.values["ball.bsdf.rho_d"], rtol=1e-5
    )
    again = render_views(ball(material.bsdf()), paint, spp=256, max_depth=2)
    for view, render in zip(again, found.renders, strict=True):
        assert np.abs(np.log1p(view.image) - np.log1p(render)).mean() < NOISE
    draw_views(paint, found.renders, tmp_path / "views.png")
    draw_convergence({"enhanced": found.curve}, tmp_path / "convergence.png")
    assert {"views.png", "convergence.png", "step_0001.png"} <= {p.name for p in tmp_path.iterdir()}


def test_plugins_of_mitsuba_are_fitted_by_the_same_loop(paint):
    scene = ball({"type": "principled", "base_color": {"type": "rgb", "value": 0.5}, "roughness": 0.5})
    sought = of_plugin("ball.bsdf", {"base_color.value": (0, 1), "roughness.value": (0.05, 1)}, log=["roughness.value"])
    starts = [{"ball.bsdf.roughness.value": np.array([r])} for r in (0.3, 0.8)]
    found = fit_images(scene, paint, unknowns=sought, starts=starts, **SHORT)
    assert found.materials == {}
    np.testing.assert_allclose(found.values["ball.bsdf.base_color.value"], PAINT["rho_d"], atol=0.1)
    assert found.report["mean_abs_log"]["test"] < 2 * NOISE  # another model: it need not come closer


def test_brightness_of_the_light_is_found(paint):
    """The grey floor is known, so the light is."""
    brighter = [dataclasses.replace(v, image=3 * v.image) for v in paint]
    scene = ball(Material.analytic("ggx").edit(**PAINT).bsdf())
    found = fit_images(scene, brighter, unknowns=["rho_d"], light_scale=True, stages=[(1, 16, 60)], max_depth=2, lr=0.1)
    assert found.report["light_scale"] == pytest.approx(3, rel=0.05)
    np.testing.assert_allclose(found.values["ball.bsdf.rho_d"], PAINT["rho_d"], atol=0.05)


@pytest.mark.slow
def test_texels_are_unknowns(llvm):
    texels = np.array([[[0.7, 0.2, 0.1], [0.1, 0.6, 0.2]], [[0.2, 0.2, 0.8], [0.6, 0.6, 0.1]]])
    matte = Material.analytic("ggx").edit(rho_s=0.0)
    views = photographed(ball({**matte.to_dict(), "rho_d": bitmap(texels)}))
    scene = ball({**matte.to_dict(), "rho_d": bitmap(np.full((2, 2, 3), 0.5))})
    found = fit_images(scene, views, unknowns=["rho_d"], stages=[(1, 16, 60)], max_depth=2, lr=0.1)
    assert found.materials == {}  # its colour is not one
    error = np.abs(found.values["ball.bsdf.rho_d.data"] - texels.ravel())
    # two views see two of the four in full
    assert np.sort(error)[:6].max() < 0.06


@pytest.mark.slow
def test_two_materials_at_once(llvm):
    reds = [Material.analytic("ggx").edit(rho_d=c, rho_s=0.0) for c in ((0.7, 0.1, 0.1), (0.1, 0.3, 0.6))]
    cameras = around(2, target=(0, 1, 0), distance=9, resolution=24)
    views = render_views(scenes.spheres([m.bsdf() for m in reds]), cameras, spp=256, max_depth=2)
    scene = scenes.spheres([{**Material.analytic("ggx").to_dict(), "id": name} for name in ("left", "right")])
    found = fit_images(scene, views, unknowns=["rho_d", "rho_s"], stages=[(1, 16, 60)], max_depth=2, lr=0.1)
    for name, red in zip(("left", "right"), reds, strict=True):
        np.testing.assert_allclose(found.materials[name].params["rho_d"], red.params["rho_d"], atol=0.05)


@pytest.mark.slow
def test_same_seed_same_fit(paint):
    def run(seed):
        scene = ball(Material.analytic("ggx").bsdf())
        return fit_images(scene, paint, unknowns=["rho_d"], stages=[(1, 4, 4)], max_depth=2, seed=seed).curve

    first, again, other = ([row["loss"] for row in run(seed)] for seed in (1, 1, 2))
    np.testing.assert_allclose(first, again, rtol=1e-4)  # threads add samples in any order
    assert not np.allclose(first, other, rtol=1e-4)


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e25])  # the square of the last is none in float32
def test_gradients_that_are_not_finite_move_nothing_and_are_counted(paint, value):
    scene = ball(Material.analytic("ggx").bsdf())
    sought = unknowns.enhanced(scene, ["rho_d", "F0"])
    descent = Descent(scene, sought, None, image_loss.Measure("log", 0.3), 2, 0)
    target, backward, render = targets_module.targets(paint)[0], descent._backward, descent.render

    def broken_backward(values, *arguments):
        backward(values, *arguments)
        dr.set_grad(values["ball.bsdf.F0"], value)

    def broken_render(*arguments):
        image = render(*arguments)
        image[3, 4, :2] = np.nan
        return image

    descent._backward, descent.render = broken_backward, broken_render
    before = descent.values()
    descent.step(target, 4, 0.1)
    assert descent.nonfinite == 1 and descent.nonfinite_pixels == 4 and np.isfinite(descent.curve[-1]["loss"])
    np.testing.assert_allclose(descent.values()["ball.bsdf.F0"], before["ball.bsdf.F0"], rtol=1e-6)
    assert (descent.values()["ball.bsdf.rho_d"] != before["ball.bsdf.rho_d"]).all()


def test_colours_of_a_start_are_those_that_explain_the_photographs(paint):
    """With the right roughness and F0 the colours are the right ones, to the noise of 16 paths a pixel."""
    scene = ball(Material.analytic("ggx").bsdf())
    descent = Descent(scene, unknowns.enhanced(scene), None, image_loss.Measure("log", 0.3), 2, 0)
    (one,) = scene_materials.find(descent.params).values()
    targets = targets_module.targets(paint)
    errors, free = {}, {u.key for u in descent.unknowns}
    for alpha in (0.05, 0.25, 0.8):
        start = one.material.edit(**{**PAINT, "alpha_x": alpha, "alpha_y": alpha, "rho_d": 0.5, "rho_s": 0.5})
        render = lambda t: descent.render(t, 64, 0)  # noqa: E731
        found, errors[alpha] = with_best_colours(one, start, free, descent.params, targets, render, 0.3)
        if alpha == 0.25:
            np.testing.assert_allclose(found.params["rho_d"], PAINT["rho_d"], atol=0.03)
            np.testing.assert_allclose(found.params["rho_s"], PAINT["rho_s"], atol=0.3)
    assert min(errors, key=errors.get) == 0.25


# ---------------------------------------------------------------------- command line

XML = """<scene version="3.0.0">
    <integrator type="path"/>
    <emitter type="constant"/>
    <shape type="sphere"><point name="center" x="0" y="1" z="0"/>
        <bsdf type="enhanced" id="paint"><string name="filename" value="$material"/></bsdf>
    </shape>
</scene>"""


@pytest.mark.slow
def test_command_line(llvm, tmp_path, capsys):
    network = Material.analytic("ggx").edit(rho_s=0.0)
    network.save(tmp_path / "start.bsdf")
    (tmp_path / "scene.xml").write_text(XML)
    truth = network.edit(rho_d=(0.6, 0.3, 0.1))
    truth.save(tmp_path / "truth.bsdf")
    scene = mi.load_file(str(tmp_path / "scene.xml"), material=str(tmp_path / "truth.bsdf"))
    cameras = around(2, target=(0, 1, 0), distance=5, resolution=16)
    write_views(render_views(scene, cameras, spp=64), tmp_path / "views")
    out, pictures = tmp_path / "out" / "paint.bsdf", tmp_path / "pictures"
    command = ["fit-images", str(tmp_path / "scene.xml"), str(tmp_path / "views"), "-o", str(out), "--json"]
    options = [
        "-m",
        str(tmp_path / "start.bsdf"),
        "--unknown",
        "rho_d",
        "--stage",
        "1,8,60",
        "--preview",
        str(pictures),
    ]
    assert main([*command, *options, "--variant", "llvm_ad_rgb"]) == 0
    result = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert result["outputs"] == [str(out)] and result["iterations"] == 60
    # under even light a matte ball shows its colour in every pixel
    np.testing.assert_allclose(Material.load(out).params["rho_d"], truth.params["rho_d"], atol=0.03)
    assert (pictures / "convergence.png").exists() and (pictures / "views.png").exists()


def test_command_line_says_what_is_missing(llvm, tmp_path, capsys):
    (tmp_path / "scene.xml").write_text('<scene version="3.0.0"><shape type="sphere"/></scene>')
    arguments = ["-o", str(tmp_path / "x.bsdf"), "--variant", "llvm_ad_rgb"]
    assert main(["fit-images", str(tmp_path / "scene.xml"), str(tmp_path), *arguments]) == 2
    assert "transforms.json" in capsys.readouterr().err
    (view,) = around(1, target=(0, 0, 0), distance=5, resolution=4)
    write_views([dataclasses.replace(view, image=view.image + 1)], tmp_path)
    assert main(["fit-images", str(tmp_path / "scene.xml"), str(tmp_path), *arguments]) == 2
    assert 'no BSDF of type "enhanced"' in capsys.readouterr().err
    assert not (tmp_path / "x.bsdf").exists()


# ---------------------------------------------------------------------- what photographs do not see


def test_photographs_that_see_nothing_are_refused_before_the_fit(paint):
    scene = ball(Material.analytic("ggx").bsdf())
    turn = np.diag([1.0, -1.0, -1.0, 1.0])  # OpenCV's camera
    away = [dataclasses.replace(v, to_world=v.to_world @ turn) for v in paint]
    with pytest.raises(ValueError, match="do not see ball.bsdf. Likely causes.*OpenCV"):
        fit_images(scene, away, **SHORT)
    inside = mi.load_dict(
        {
            "type": "scene",
            "light": {"type": "constant"},
            "ball": {
                "type": "sphere",
                "center": [0, 1, 0],
                "flip_normals": True,
                "bsdf": Material.analytic("ggx").bsdf(),
            },
        }
    )
    with pytest.raises(ValueError, match="normals that point inwards"):
        fit_images(inside, paint, **SHORT)


def test_single_views_that_see_nothing_are_told(paint):
    away = dataclasses.replace(paint[0], name="away", to_world=paint[0].to_world @ np.diag([1.0, -1.0, -1.0, 1.0]))
    short = {"stages": [(1, 4, 2)], "max_depth": 2}
    scene = ball(Material.analytic("ggx").edit(rho_s=0.0).bsdf())
    with pytest.warns(UserWarning, match="1 of 3 views see nothing of what is sought: away"):
        found = fit_images(scene, [*paint[:2], away], unknowns=["rho_d", "alpha_x"], **short)
    # without a specular part its roughness shows nowhere
    assert found.report["undetermined"] == ["ball.bsdf.alpha_x"]
    assert found.materials["ball.bsdf"].report["undetermined"] == ["alpha_x"]


@pytest.mark.slow
def test_materials_that_nothing_sees_are_told(paint):
    short = {"stages": [(1, 4, 2)], "max_depth": 2}
    material, other = Material.analytic("ggx").to_dict(), Material.analytic("ggx").edit(F0=0.05).to_dict()
    far = {"type": "sphere", "center": [0, 500, 0], "bsdf": {**other, "id": "far"}}
    near = {"type": "sphere", "center": [0, 1, 0], "bsdf": {**material, "id": "near"}}
    scene = mi.load_dict({"type": "scene", "light": {"type": "constant"}, "a": far, "b": near})
    names = ["rho_d.R", "rho_d.G", "rho_d.B"]
    with pytest.warns(UserWarning, match='no view sees "far"'):
        found = fit_images(scene, paint, unknowns=["rho_d"], **short)
    assert len(found.report["undetermined"]) == 1 and found.materials["far"].report["undetermined"] == names


@pytest.mark.slow
def test_textures_that_cannot_be_moved_stay(paint, tmp_path):
    """One roughness map for both directions is one unknown; what has no numbers of its own stays, or is told."""
    mi.Bitmap(np.full((4, 4, 1), 0.3, np.float32)).write(str(tmp_path / "rough.exr"))
    rough = {"type": "bitmap", "filename": str(tmp_path / "rough.exr"), "raw": True}
    short = {"stages": [(1, 2, 1)], "max_depth": 2}
    grey = {"type": "spectrum", "value": 0.3}
    for textures in ({"alpha_x": rough, "alpha_y": dict(rough)}, {"rho_d": {"type": "checkerboard"}}, {"rho_d": grey}):
        scene = ball({**Material.analytic("ggx").to_dict(), **textures})
        found = fit_images(scene, paint, **short)
        assert sum(key.endswith(".data") for key in found.values) == ("alpha_x" in textures)
        assert {"ball.bsdf.F0", "ball.bsdf.t_theta"} <= set(found.values)


def test_a_texture_that_cannot_be_moved_is_told(paint):
    scene = ball({**Material.analytic("ggx").to_dict(), "rho_d": {"type": "checkerboard"}})
    assert "ball.bsdf.F0" in [u.key for u in unknowns.enhanced(scene)]
    with pytest.raises(ValueError, match="rho_d: none can be moved"):
        fit_images(scene, paint, unknowns=["rho_d"], **SHORT)


@pytest.mark.parametrize("wrap", [lambda b: b, lambda b: {"type": "twosided", "m": b}], ids=["plain", "twosided"])
def test_materials_of_one_id_are_two(llvm, wrap):
    """In a dictionary the id is the name of the entry: "bsdf" for every object."""
    material = Material.analytic("ggx")
    balls = {name: {"type": "sphere", "bsdf": wrap(material.to_dict())} for name in ("left", "right")}
    scene = mi.load_dict({"type": "scene", **balls}, optimize=False)
    keys = {u.key for u in unknowns.enhanced(scene, ["rho_d"])}
    assert len(keys) == 2 and {key.partition(".")[0] for key in keys} == {"left", "right"}
    found = find(mi.traverse(scene))
    assert {one.keys["rho_d"] for one in found.values()} == keys and len(found) == 2


def test_materials_are_read_from_textures_of_other_channels(llvm):
    """A grey for a colour, a colour for a number, one for both: the mean."""
    grey, colour = bitmap(np.full((2, 2, 1), 0.25)), bitmap(np.full((2, 2, 3), 0.5))
    one = mi.load_dict(grey)
    for textures in (
        {"rho_d": grey},
        {"alpha_x": colour},
        {"rho_d": colour, "alpha_x": grey},
        dict(rho_d=one, alpha_x=one),
    ):
        params = mi.traverse(ball({**Material.analytic("ggx").to_dict(), **textures}))
        (material,) = (placed.read(params) for placed in find(params).values())
        for name, texture in textures.items():
            np.testing.assert_allclose(material.params[name], 0.5 if texture is colour else 0.25)
    scene = ball({**Material.analytic("ggx").to_dict(), "alpha_x": one, "rho_d": one})
    assert len({u.key for name in ("alpha_x", "rho_d") for u in unknowns.enhanced(scene, [name])}) == 1


@pytest.mark.slow
def test_bitmaps_of_8_bits_stay_unless_they_are_loaded_as_numbers(paint):
    """Mitsuba keeps their integers, which have no gradients."""
    file = {"type": "bitmap", "bitmap": mi.Bitmap(np.full((1, 1, 3), 188, np.uint8))}
    painted = Material.analytic("ggx").edit(**PAINT).to_dict()
    with pytest.raises(ValueError, match="bitmap of 8 bits"):
        fit_images(ball({**painted, "rho_d": file}), paint, unknowns=["rho_d"], **SHORT)
    assert "ball.bsdf.F0" in [u.key for u in unknowns.enhanced(ball({**painted, "rho_d": file}))]
    for kind in ("variant", "fp16"):
        scene = ball({**painted, "rho_d": {**file, "format": kind}})
        found = fit_images(scene, paint, unknowns=["rho_d"], stages=[(1, 16, 40)], max_depth=2, lr=0.1)
        texels = found.values["ball.bsdf.rho_d.data"].reshape(-1, 3)
        np.testing.assert_allclose(texels.mean(0), PAINT["rho_d"], atol=0.05)


@pytest.mark.slow
def test_integers_of_numpy_are_integers(paint):
    stages = [tuple(np.array([2, 2, 1]))]
    scene = ball(Material.analytic("ggx").bsdf())
    found = fit_images(scene, paint, unknowns=["rho_d"], stages=stages, max_depth=np.int64(2))
    json.dumps(found.report)
