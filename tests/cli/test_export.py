"""``mi-enhance export``: the file that its suffix names, of a material or an edited one."""

from __future__ import annotations

import json

import numpy as np
import pytest

from mi_enhance import Material
from mi_enhance.cli.main import main
from mi_enhance.export.registry import export_material, exporters

GREY = [[0.0, 0.0, 1.0]]


@pytest.fixture
def material(llvm, tmp_path):
    path = tmp_path / "grey.bsdf"
    Material.analytic("ggx").edit(rho_s=0).save(path)
    return str(path)


@pytest.mark.parametrize("suffix", [".glsl", ".hlsl", ".slang", ".py", ".brdf"])
def test_writes_what_the_suffix_names_and_says_its_size(material, tmp_path, capsys, suffix):
    output = tmp_path / "new folder" / f"my-grey{suffix}"
    assert main(["export", material, "-o", str(output), "--json"]) == 0
    report = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert report["output"] == str(output)
    assert report["bytes"] == output.stat().st_size > 1000
    assert report["multiply_adds"] == 0
    assert ("my_grey_eval" in output.read_text()) == (suffix != ".py")
    assert list(output.parent.iterdir()) == [output]  # no temporary file stays


def test_edits_are_in_the_file(material, tmp_path):
    output = tmp_path / "it.py"
    assert main(["export", material, "--set", "rho_d=0.2,0.1,0", "-D", "editable=false", "-o", str(output)]) == 0
    names: dict = {}
    exec(output.read_text(), names)
    assert names["evaluate"](GREY, GREY)[0] == pytest.approx(np.array([0.2, 0.1, 0]) / np.pi, rel=1e-5)
    assert names["PARAMETERS"] == {}


def test_help_lists_the_kinds_and_their_options(capsys):
    with pytest.raises(SystemExit):
        main(["export", "--help"])
    text = capsys.readouterr().out
    for suffix, kind in exporters().items():
        assert f"{suffix} " in text
        assert kind.about in text
    assert "-D editable=True" in text


@pytest.mark.parametrize(
    "arguments, message",
    [
        (["-o", "x.glsll"], r'-o: "x.glsll" must end in .*\.glsl'),
        (["-o", "OUT/x.glsl", "-D", "size=3"], r'\.glsl has no option "size". Choose from: editable.'),
        (["-o", "OUT/x.brdf", "-D", "size=3"], r'\.brdf has no option "size". It has none.'),
        (["-o", "OUT/x.glsl", "-D", "editable=3"], r"option editable of \.glsl is 3; it must be true or false"),
        (["-o", "OUT/x.glsl", "--set", "alpha=3"], r'unknown parameter "alpha". Choose from: n_x'),
        (["-o", "OUT/x.csv", "-D", "samples=0"], r"samples is 0; it must be a positive integer"),
    ],
)
def test_errors_say_what_is_allowed(material, tmp_path, capsys, arguments, message):
    import re

    arguments = [a.replace("OUT", str(tmp_path)) for a in arguments]
    assert main(["export", material, *arguments]) == 2
    error = capsys.readouterr().err
    assert re.search(message, error), error


@pytest.mark.parametrize("command, file", [("view", "x.html"), ("plot", "x.png")])
def test_a_material_of_a_measured_file_needs_the_file(material, tmp_path, capsys, command, file):
    assert main([command, material, "--material", "gold-paint", "-o", str(tmp_path / file)]) == 2
    assert '--material: "gold-paint" is one of a measured file, and no DATA is given.' in capsys.readouterr().err


def test_one_of_several_measurements_is_named_as_in_other_commands(llvm, tmp_path, capsys):
    data, output = "mi_enhance/bundled/nbrdf/merl.npz", tmp_path / "bronze.csv"
    arguments = ["export", data, "-D", "samples=100", "-o", str(output)]
    assert main(arguments) == 2
    assert "Say which with material= (--material)" in capsys.readouterr().err
    assert main([*arguments, "--material", "alum-bronze"]) == 0
    assert output.is_file()


def test_a_measured_file_is_no_source_of_a_shader(llvm, tmp_path, capsys):
    data = "mi_enhance/bundled/rgl/chm_mint_rgb.bsdf"
    assert main(["export", data, "-o", str(tmp_path / "x.glsl")]) == 2
    assert "is a measured file" in capsys.readouterr().err
    assert main(["export", data, "-o", str(tmp_path / "x.glsl"), "--set", "F0=1"]) == 2
    assert "no parameters to edit" in capsys.readouterr().err


def test_a_file_that_cannot_be_written_keeps_the_old_one(llvm, tmp_path, monkeypatch):
    from mi_enhance.export import program

    path = tmp_path / "it.glsl"
    path.write_text("the old one")
    monkeypatch.setattr(program.Program, "values", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        export_material(Material.analytic("ggx"), path)
    assert path.read_text() == "the old one"
    assert list(tmp_path.iterdir()) == [path]
