"""Bundled scenes: one XML for every material, exposed for the screen; and the comparison made in them."""

from __future__ import annotations

import json
import shutil
import sys
from pathlib import Path

import matplotlib
import mitsuba as mi
import numpy as np
import pytest

from mi_enhance import Material
from mi_enhance.evaluation import scenes
from mi_enhance.evaluation.compare import compare, compare_file, compare_files
from mi_enhance.output import table
from mi_enhance.system.bundled_files import scene_file

SCENES = ("shader_ball", "sphere_envmap")
GREY = {"type": "diffuse", "reflectance": 0.5}
SUMMATION = 1e-5  # threads add the samples of a pixel in any order; another noise differs by 1e-2
BLACK = {"type": "diffuse", "reflectance": 0.0}


@pytest.mark.parametrize("name", SCENES)
def test_scene_is_exposed_for_the_screen(llvm, name):
    image = np.array(mi.render(scenes.load(name, GREY, resolution=48, spp=16)))
    assert image.shape == (48, 48, 3)
    assert np.isfinite(image).all()
    assert 0.1 < np.median(image) < 0.7  # neither dark nor washed out at display white 1
    assert np.mean(image > 1) < 0.02


@pytest.mark.parametrize("name", SCENES)
def test_material_covers_the_ball_and_nothing_else(llvm, name):
    grey, black = (np.array(mi.render(scenes.load(name, b, resolution=48, spp=16, max_depth=2))) for b in (GREY, BLACK))
    covered = (np.abs(grey - black) > 0.02).any(2).mean()
    assert 0.1 < covered < 0.7


def test_bsdf_instance_and_dictionary_render_the_same(llvm):
    images = [
        np.array(mi.render(scenes.load("sphere_envmap", b, resolution=24, spp=4))) for b in (GREY, mi.load_dict(GREY))
    ]
    assert np.allclose(*images, atol=SUMMATION)


@pytest.mark.parametrize("name", SCENES)
def test_replacing_equals_the_material_named_in_the_xml(llvm, name, tmp_path):
    """A copy of the XML with a built-in plugin written into it renders what the loader makes of the unchanged one."""
    path = shutil.copytree(scene_file(f"{name}.xml").parent, tmp_path / "scenes") / f"{name}.xml"
    node = '<bsdf type="enhanced" id="material"> <string name="filename" value="$material"/> </bsdf>'
    text = path.read_text()
    assert node in text
    path.write_text(text.replace(node, '<bsdf type="diffuse"> <rgb name="reflectance" value="0.5"/> </bsdf>'))
    expected = mi.render(mi.load_file(str(path), optimize=False, resolution=24, spp=4))
    rgb = {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.5}}
    result = mi.render(scenes.load(name, rgb, resolution=24, spp=4))
    assert np.allclose(np.array(result), np.array(expected), atol=SUMMATION)


def test_equal_seeds_give_equal_noise(llvm):
    """Across loads: a comparison rests on it."""
    first, second = (np.array(mi.render(scenes.shader_ball(GREY, resolution=24, spp=4), seed=3)) for _ in range(2))
    assert np.allclose(first, second, atol=SUMMATION)


def test_loading_leaves_the_search_path_as_it_was(llvm):
    before = str(mi.file_resolver())
    scenes.load("sphere_envmap", GREY, resolution=16, spp=1)
    assert str(mi.file_resolver()) == before


@pytest.mark.parametrize("name", ("resolution", "spp", "max_depth"))
@pytest.mark.parametrize("value", (0, 2.5))
def test_bad_number_is_refused(llvm, name, value):
    with pytest.raises(ValueError, match=rf"{name} is {value}; it must be a positive integer"):
        scenes.load("shader_ball", GREY, **{name: value})


def test_unknown_scene_is_refused(llvm):
    with pytest.raises(FileNotFoundError, match="Choose one of: shader_ball.xml, sphere_envmap.xml"):
        scenes.load("teapot", GREY)
    with pytest.raises(FileNotFoundError, match=r'scenes.load\("teapot.xml"\): no such file'):
        scenes.load("teapot.xml", GREY)


def test_scene_without_the_id_is_refused(llvm, tmp_path):
    path = tmp_path / "bare.xml"
    path.write_text('<scene version="3.0.0"><shape type="sphere"/></scene>')
    with pytest.raises(ValueError, match='no object has id="material"'):
        scenes.load(path, GREY)


def test_missing_variant_is_said(run_child):
    result = run_child("import mi_enhance.evaluation.scenes as s; s.load('shader_ball', {'type': 'diffuse'})")
    assert 'no Mitsuba variant is active. Call mi.set_variant("llvm_ad_rgb")' in result.stderr


# --- comparison -------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def comparison(tmp_path_factory):
    """Grey against itself and against a darker grey."""
    mi.set_variant("llvm_ad_rgb")
    folder = tmp_path_factory.mktemp("compare")
    backend = matplotlib.rcParams._get("backend")  # asking for ["backend"] would choose one
    darker = {"type": "diffuse", "reflectance": 0.3}
    lines = []
    rows = compare(
        GREY, {"same": GREY, "darker one": darker}, folder, scene="sphere_envmap", resolution=32, spp=16,
        truth_label="grey", progress=lambda progress: lines.append(progress.stage),
    )  # fmt: skip
    assert matplotlib.rcParams._get("backend") == backend
    return folder, rows, lines


def test_compare_ranks_what_it_renders(comparison):
    _, rows, lines = comparison
    assert [row["label"] for row in rows] == ["grey", "same", "darker one"]
    assert lines[2] == "render darker one: 32 x 32, 16 spp"
    for row in rows[:2]:  # the same seed: equal materials give equal images
        assert (row["ssim"], row["delta_E_ITP_1000"]) == (pytest.approx(1), pytest.approx(0, abs=SUMMATION))
    assert rows[0]["psnr"] is None  # the truth against itself: infinite, which JSON does not know
    assert rows[2]["ssim"] < 0.99 and rows[2]["delta_E_ITP_1000"] > 5
    assert all(row["render_seconds"] * row["mpaths_per_s"] == pytest.approx(32 * 32 * 16 / 1e6) for row in rows)


def test_compare_writes_whole_files_only(comparison):
    folder, rows, _ = comparison
    assert sorted(p.name for p in folder.iterdir()) == ["comparison.png", "darker_one.exr", "grey.exr", "same.exr"]
    grey, darker = (np.array(mi.Bitmap(row["image"])) for row in (rows[0], rows[2]))
    assert grey.dtype == np.float32 and grey.shape == (32, 32, 3)
    assert grey.mean() > darker.mean() > 0


def test_picture_shows_the_renders_and_the_error(comparison):
    folder, _, _ = comparison
    picture = np.array(mi.Bitmap(str(folder / "comparison.png")))[..., :3]
    height, width = picture.shape[:2]
    assert width == pytest.approx(3 * 352 + 12, abs=4)
    error_same, error_darker = (
        picture[int(0.6 * height) :, int(a * width) : int(b * width)] for a, b in ((0.36, 0.64), (0.7, 0.98))
    )
    assert error_same.max() < 10  # black: no error
    assert error_darker.max() > 200


def test_compare_refuses_labels_that_name_one_file(llvm, tmp_path):
    with pytest.raises(ValueError, match="differ in letters or digits"):
        compare(GREY, {"a b": GREY, "a-b": GREY}, tmp_path)
    with pytest.raises(ValueError, match="at least two"):
        compare(GREY, {}, tmp_path)
    assert not list(tmp_path.iterdir())


def test_compare_files_averages_each_model(tmp_path, monkeypatch):
    """Means by hand; the rate is all paths over all seconds, so its mean is harmonic."""
    figures = {"a": (0.9, 2.0, 100), "b": (0.7, 4.0, 201)}  # SSIM, Mpaths/s, bytes of the two materials

    def one_file(path, folder, *, spp):
        assert (folder, spp) == (tmp_path / path.name[0], 4)
        folder.mkdir()
        ssim, rate, size = figures[path.name[0]]
        row = {"material": path.name[0], "label": "GGX", "ssim": ssim, "psnr": None}
        return [{**row, "mpaths_per_s": rate, "bytes": size}]

    monkeypatch.setattr(sys.modules["mi_enhance.evaluation.compare"], "compare_file", one_file)
    result = compare_files([Path("x/a_rgb.bsdf"), Path("x/b_rgb.bsdf")], tmp_path, spp=4)
    (mean,) = result.mean
    expected = {"ssim": 0.8, "mpaths_per_s": 2 / (1 / 2 + 1 / 4), "bytes": 150}
    assert mean == pytest.approx({"material": "mean of 2", "label": "GGX", **expected})
    assert json.loads(Path(result.tables["json"]).read_text()) == result.rows + result.mean


@pytest.mark.parametrize("paths", ([], ["x/a.bsdf", "y/a_rgb.bsdf"]), ids=["none", "one name twice"])
def test_compare_files_refuses(paths, tmp_path):
    with pytest.raises(ValueError, match="must be at least one and all different"):
        compare_files(paths, tmp_path)


def test_a_damaged_truth_is_refused_before_anything_is_written(tmp_path):
    (tmp_path / "paint.binary").write_bytes(b"")
    with pytest.raises(ValueError, match="too few for a MERL file"):
        compare_files([tmp_path / "paint.binary"], tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_truth_that_cannot_be_rendered_is_one_of_samples(llvm, tmp_path):
    """Of one kind and of several: errors of samples, renders of the models, no error of a picture."""
    models = {"GGX": Material.analytic("ggx"), "ward": Material.analytic("ward")}
    settings = {"models": models, "n_samples": 300, "scene": "sphere_envmap", "resolution": 16, "spp": 4}
    file = "mi_enhance/bundled/nbrdf/merl.npz"
    rows = compare_file(file, tmp_path, material="blue-acrylic", **settings)
    assert [(row["material"], row["label"]) for row in rows] == [("blue-acrylic", "GGX"), ("blue-acrylic", "ward")]
    assert all(row["log_l1"] > 0 and row["mpaths_per_s"] > 0 and "ssim" not in row for row in rows)
    assert {"comparison.png", "ggx.exr", "ward.bsdf"} <= {p.name for p in tmp_path.iterdir()}


def test_a_mean_over_files_leaves_out_what_some_have_not(tmp_path, monkeypatch):
    def one_file(path, folder):
        folder.mkdir()
        row = {"material": path.stem, "label": "GGX", "log_l1": 0.1}
        return [row | ({"ssim": 0.5} if path.stem == "a" else {})]

    monkeypatch.setattr(sys.modules["mi_enhance.evaluation.compare"], "compare_file", one_file)
    (mean,) = compare_files([Path("a.bsdf"), Path("b.binary")], tmp_path).mean
    assert mean == {"material": "mean of 2", "label": "GGX", "log_l1": pytest.approx(0.1)}


# --- tables -----------------------------------------------------------------------------------------------------------

ROWS = [{"label": "GGX", "ssim": 0.98126, "bytes": 1234}, {"label": "measured", "ssim": 1.0, "bytes": None}]


def test_table_is_the_same_in_every_form(tmp_path, capsys):
    paths = table.write_table(ROWS, tmp_path / "t")
    assert json.loads(paths["json"].read_text()) == ROWS
    assert paths["csv"].read_text().splitlines() == ["label,ssim,bytes", "GGX,0.98126,1234", "measured,1.0,"]
    assert paths["md"].read_text().splitlines()[2:] == [
        "| GGX      | 0.9813 |   1,234 |",
        "| measured | 1.0000 |       – |",
    ]
    table.print_table(ROWS, title="a title")
    printed = capsys.readouterr().out
    assert "a title" in printed and "0.9813" in printed and "1,234" in printed


def test_printed_table_cuts_no_number_off(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "40")
    table.print_table([{"material": "a_long_name_of_a_material", **ROWS[0], "delta_E_ITP_1000": 12.3456}])
    printed = capsys.readouterr().out
    assert all(text in printed for text in ("a_long_name_of_a_material", "0.9813", "12.35", "1,234"))


def test_table_shows_the_columns_asked_for():
    assert table.markdown(ROWS, {"ssim": ("S", ".1f")}).splitlines()[-1].split() == ["|", "1.0", "|"]
