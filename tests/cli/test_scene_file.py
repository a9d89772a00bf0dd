"""Scenes as Mitsuba loads them, with equal materials apart and files meant from where the user stands."""

from __future__ import annotations

import mitsuba as mi
import numpy as np
import OpenEXR
import pytest

from mi_enhance.cli import arguments
from mi_enhance.cli.main import main
from mi_enhance.cli.scene_file import load_scene
from mi_enhance.material.material import Material

HEAD = '<?xml version="1.0" encoding="{}"?><!-- Größe -->'
BALL = '<shape type="sphere"><bsdf type="enhanced" id="{}"><string name="filename" value="{}"/></bsdf></shape>'
LIGHT = '<emitter type="constant"/>'


def scene(*parts: str) -> str:
    return f'<scene version="3.0.0">{"".join(parts)}</scene>'


def colours(found: mi.Scene) -> list[float]:
    params = mi.traverse(found)
    return [float(params[key].x[0]) for key in params.keys() if key.endswith("rho_d")]


@pytest.fixture
def folder(llvm, tmp_path, monkeypatch):
    """The user stands in ``here``, the scene is in ``scene``; each has an ``m.bsdf`` of its own."""
    for name, value in (("here", 0.75), ("scene", 0.25)):
        (tmp_path / name).mkdir()
        Material.analytic("ggx").edit(rho_d=value).save(tmp_path / name / "m.bsdf")
    monkeypatch.chdir(tmp_path / "here")
    return tmp_path


def load(folder, text: str, *define, material=None, encoding="utf-8"):
    file = folder / "scene/s.xml"
    file.write_bytes(text.encode(encoding))
    return load_scene(mi, str(file), "test", define, material and folder / "here" / material)


def test_equal_materials_stay_two(folder):
    found = load(folder, scene(LIGHT, BALL.format("a", "$material"), BALL.format("b", "$material")), material="m.bsdf")
    assert len({id(shape.bsdf()) for shape in found.shapes()}) == 2
    assert {shape.bsdf().id() for shape in found.shapes()} == {"a", "b"}


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "ISO-8859-1", "windows-1252"])
def test_every_encoding_that_mitsuba_reads(folder, encoding):
    text = HEAD.format(encoding.removesuffix("-sig")) + scene(LIGHT, BALL.format("a", "$material"))
    assert colours(load(folder, text, material="m.bsdf", encoding=encoding)) == [0.75]


@pytest.mark.parametrize(
    "text",
    [
        scene('<include filename="ball.xml"/>'),
        scene('<default name="material" value="none.bsdf"/>', BALL.format("a", "$material")),
        scene('<default name="file" value="$material"/>', BALL.format("a", "$file")),
    ],
    ids=["include", "default", "through another"],
)
def test_material_is_found_wherever_it_is_asked_for(folder, text):
    (folder / "scene/ball.xml").write_text(scene(BALL.format("a", "$material")))
    assert colours(load(folder, text, material="m.bsdf")) == [0.75]


def test_scene_that_names_its_own_material_keeps_it(folder):
    text = scene("<!-- $material -->", BALL.format("a", "m.bsdf"))
    assert colours(load(folder, text, material="m.bsdf")) == [0.25]


def test_unknown_parameter_is_still_refused(folder):
    with pytest.raises(ValueError, match=r"test: -D: neither the scene nor what it includes has \$wide\.$"):
        load(folder, scene(LIGHT), ("wide", "3"), material="m.bsdf")
    with pytest.raises(ValueError, match=r"has \$material, \$wide\."):
        load(folder, scene(LIGHT), ("wide", "3"), ("material", "m.bsdf"))


def test_what_is_no_scene_is_refused(folder):
    with pytest.raises(ValueError, match="this is no scene. Its outermost element must be <scene>"):
        load(folder, '<bsdf version="3.0.0" type="diffuse"/>')


@pytest.mark.parametrize(
    "value, expected", [("m.bsdf", 0.75), ("../scene/m.bsdf", 0.25), ("other.bsdf", 0.5)], ids=["here", "path", "there"]
)
def test_defined_file_is_meant_from_where_the_user_stands(folder, value, expected):
    Material.analytic("ggx").edit(rho_d=0.5).save(folder / "scene/other.bsdf")  # only beside the scene
    assert colours(load(folder, scene(BALL.format("a", "$material")), ("material", value))) == [expected]


def test_defined_words_and_numbers_are_no_files(folder):
    for name in ("diffuse", "0.5"):
        (folder / "here" / name).write_text("")
    text = scene('<shape type="sphere"><bsdf type="$t"><rgb name="reflectance" value="$r"/></bsdf></shape>')
    params = mi.traverse(load(folder, text, ("t", "diffuse"), ("r", "0.5")))
    assert [float(params[key].x[0]) for key in params.keys() if key.endswith("reflectance.value")] == [0.5]


def test_model_that_is_not_there_is_named(folder, capsys):
    (folder / "scene/other.bsdf").write_bytes((folder / "scene/m.bsdf").read_bytes())
    arguments = ["fit-images", str(folder / "scene/s.xml"), "photos", "-m", "other.bsdf", "-o", "o.bsdf"]
    assert main(arguments) == 2
    assert '-m "other.bsdf": no such file' in capsys.readouterr().err


@pytest.mark.parametrize("name, value", [("./ggx", 0.75), ("OWN.BSDF", 0.75), ("sub/ggx", 0.75), ("ggx", None)])
def test_model_by_path_is_the_file_of_the_user(folder, name, value):
    (folder / "here/sub").mkdir()
    if value:
        (folder / "here" / name).write_bytes((folder / "here/m.bsdf").read_bytes())
    expected = Material.analytic("ggx").edit(rho_d=value) if value else Material.pretrained("ggx")
    np.testing.assert_array_equal(arguments.model(name).params["rho_d"], expected.params["rho_d"])


# ---------------------------------------------------------------------- render

AOVS = (
    '<integrator type="aov"><string name="aovs" value="dd:depth,nn:sh_normal"/>'
    '<integrator type="path" name="img"/></integrator>'
)
PATH = '<integrator type="path"/>'


def camera(film: str = "hdrfilm", more: str = "") -> str:
    size = "".join(f'<integer name="{name}" value="8"/>' for name in ("width", "height"))
    return f'<sensor type="perspective"><film type="{film}">{size}{more}</film></sensor>'


def pixel_format(name: str) -> str:
    return f'<string name="pixel_format" value="{name}"/>'


BANDS = "".join(
    f'<spectrum name="{name}" value="{low}:0, {low + 50}:1, {low + 100}:0"/>'
    for name, low in (("blue", 400), ("green", 500), ("red", 600))
)


def rendered(folder, parts, output, variant="llvm_ad_rgb") -> int:
    ball = '<shape type="sphere"><point name="center" x="0" y="0" z="4"/></shape>'
    (folder / "s.xml").write_text(scene(*parts, LIGHT, ball))
    return main(["render", str(folder / "s.xml"), "-o", str(folder / output), "--spp", "1", "--variant", variant])


@pytest.mark.parametrize(
    "parts, variant, names",
    [
        ([PATH, camera()], "llvm_ad_rgb", "RGB"),
        ([PATH, camera(more=pixel_format("rgba"))], "llvm_ad_rgb", "RGBA"),
        ([PATH, camera(more=pixel_format("luminance"))], "llvm_ad_rgb", "Y"),
        ([PATH, camera(more=pixel_format("xyz"))], "llvm_ad_rgb", "XYZ"),
        ([PATH, camera()], "llvm_ad_spectral", "RGB"),
        ([PATH, camera(more=pixel_format("luminance"))], "llvm_ad_mono", "Y"),
        ([AOVS, camera()], "llvm_ad_rgb", ["R", "G", "B", "dd.T", "nn.X", "nn.Y", "nn.Z"]),
        ([AOVS, camera(more=pixel_format("rgba"))], "scalar_rgb", ["R", "G", "B", "A", "dd.T"]),
        ([PATH, camera("specfilm", BANDS)], "llvm_ad_spectral", ["blue", "green", "red"]),
    ],
    ids=["rgb", "rgba", "luminance", "xyz", "spectral", "mono", "aov", "aov and alpha", "bands"],
)
def test_exr_has_the_channels_of_the_film(llvm, tmp_path, parts, variant, names):
    assert rendered(tmp_path, parts, "o.exr", variant) == 0
    with OpenEXR.File(str(tmp_path / "o.exr"), separate_channels=True) as file:
        channels = {name: channel.pixels for name, channel in file.channels().items()}
    assert set(names) == {n for n in channels if not n.startswith("img.")} & set(names)
    if "dd.T" in names:
        assert channels["dd.T"][4, 4] == pytest.approx(3, abs=0.1)  # a ball of radius 1 at 4
        assert channels["R"].max() < 2  # no depth
    else:
        assert len(channels) == len(names)


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".jpeg", ".PNG", ".hdr", ".pfm"])
@pytest.mark.parametrize("parts", [[AOVS, camera()], [AOVS, camera(more=pixel_format("rgba"))], [PATH, camera()]])
def test_other_images_take_the_colour_alone(llvm, tmp_path, parts, suffix):
    assert rendered(tmp_path, parts, f"o{suffix}") == 0
    image = np.array(mi.Bitmap(str(tmp_path / f"o{suffix}")))
    assert image.shape == (8, 8, 3)
    assert image.max() <= (255 if image.dtype == np.uint8 else 1.01)


def test_channels_that_are_no_colour_are_refused_before_the_work(llvm, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(mi, "render", None)
    assert rendered(tmp_path, [PATH, camera("specfilm", BANDS)], "o.png", "llvm_ad_spectral") == 2
    assert "the film records blue, green, red, which are no colour that a .png can hold" in capsys.readouterr().err


@pytest.mark.parametrize(
    "parts, message", [([camera()], "has no integrator. Add one"), ([PATH], "has no sensor. Add one")]
)
def test_scene_that_cannot_be_rendered_is_one_line(llvm, tmp_path, capsys, parts, message):
    assert rendered(tmp_path, parts, "o.exr") == 2
    error = capsys.readouterr().err
    assert message in error and error.count("\n") == 1


@pytest.mark.parametrize("output", ["light.exr", "included.exr", "link.exr", "given.exr"])
def test_what_a_scene_reads_is_never_written_over(llvm, tmp_path, capsys, monkeypatch, output):
    monkeypatch.chdir(tmp_path)
    mi.Bitmap(np.ones((4, 8, 3), np.float32)).write("light.exr")
    (tmp_path / "given.exr").write_bytes((tmp_path / "light.exr").read_bytes())
    (tmp_path / "link.exr").symlink_to("light.exr")
    light = '<emitter type="envmap"><string name="filename" value="{}"/></emitter>'
    (tmp_path / "included.exr").write_text(scene(light.format("light.exr")))  # Mitsuba does not mind the suffix
    first = '<include filename="included.exr"/>' if output != "given.exr" else light.format("$light")
    (tmp_path / "s.xml").write_text(scene(PATH, camera(), first))
    before = (tmp_path / output).read_bytes()
    define = ["-D", "light=given.exr"] if output == "given.exr" else []
    assert main(["render", "s.xml", "-o", output, *define]) == 2
    assert "what the " in capsys.readouterr().err
    assert (tmp_path / output).read_bytes() == before


def test_film_that_cannot_record_more_is_refused(llvm, tmp_path, capsys):
    assert rendered(tmp_path, [AOVS, camera("specfilm", BANDS)], "o.exr", "llvm_ad_spectral") == 2
    assert "a specfilm cannot record what integrator aov adds" in capsys.readouterr().err
