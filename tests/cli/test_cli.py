"""The command line: stable names, JSON last on stdout, one line for every error."""

from __future__ import annotations

import json
import re

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from mi_enhance.cli import arguments, demo, doctor
from mi_enhance.cli.main import main
from mi_enhance.data.directions import sample_pairs
from mi_enhance.material.material import Material
from mi_enhance.system import bundled_files, llvm

SCENE = """<scene version="3.0.0">
    <default name="width" value="12"/>
    <integrator type="direct"/>
    <sensor type="perspective"><film type="hdrfilm">
        <integer name="width" value="$width"/> <integer name="height" value="8"/>
    </film></sensor>
    <emitter type="constant"/>
    <shape type="sphere"><transform name="to_world"><translate z="4"/></transform></shape>
</scene>"""


@pytest.fixture
def scene(tmp_path):
    path = tmp_path / "scene.xml"
    path.write_text(SCENE)
    return str(path)


def last_json(capsys):
    return json.loads(capsys.readouterr().out.splitlines()[-1])


@pytest.mark.parametrize("command", ["doctor", "demo", "fit", "render", "show", "convert", "train", "compare"])
def test_every_subcommand_explains_itself_and_takes_json(command, capsys):
    with pytest.raises(SystemExit) as stop:
        main([command, "--help"])
    assert stop.value.code == 0
    assert "--json" in capsys.readouterr().out


def test_model_is_a_network_or_an_analytic_model_that_has_none(llvm):
    assert arguments.model("ggx").brdf.modules  # the name of both
    assert str(arguments.model("ggx_retro").brdf).endswith("S2 * D_retro_ggx * F_retro_schlick * G2 * 1/E2")
    with pytest.raises(FileNotFoundError, match='"ggx_rtro.bsdf" does not come with mi_enhance'):
        arguments.model("ggx_rtro")


@pytest.mark.parametrize("suffix", [".exr", ".png"])
def test_render_writes_the_image_it_reports(scene, tmp_path, capsys, suffix):
    output = tmp_path / "new folder" / f"image{suffix}"
    arguments = ["render", scene, "-o", str(output), "--spp", "2", "-D", "width=20", "--variant", "llvm_ad_rgb"]
    assert main([*arguments, "--json"]) == 0
    report = last_json(capsys)
    assert (report["width"], report["height"], report["spp"]) == (20, 8, 2)
    assert report["mpaths_per_s"] == pytest.approx(20 * 8 * 2 / report["seconds"] / 1e6)
    image = np.array(mi.Bitmap(str(output)))
    assert image.shape[:2] == (8, 20)
    assert image.max() > 0
    assert list(output.parent.iterdir()) == [output]  # no temporary file stays


def test_render_that_fails_keeps_the_old_image(scene, tmp_path, monkeypatch, capsys):
    output = tmp_path / "image.exr"
    output.write_bytes(b"the old one")

    def full(*args, **kwargs):
        raise OSError("no space left on device")

    monkeypatch.setattr(mi.util, "write_bitmap", full)
    assert main(["render", scene, "-o", str(output), "--spp", "1", "--variant", "scalar_rgb"]) == 2
    assert output.read_bytes() == b"the old one"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["image.exr", "scene.xml"]
    assert "no space left" in capsys.readouterr().err


@pytest.mark.parametrize(
    "arguments, message",
    [
        (["render", "SCENE", "-o", "x.txt"], r'-o: "x\.txt" must end in \.exr or \.png'),
        (
            ["render", "SCENE", "-o", "x.exr", "--variant", "gpu"],
            r'--variant: "gpu" is not .* Choose one of: scalar_rgb',
        ),
        (["render", "nope.xml", "-o", "x.exr"], r'render "nope\.xml": no such file\. Check the name'),
        (
            ["render", "SCENE", "-o", "x.exr", "-D", "wide=3", "--variant", "scalar_rgb"],
            r"-D: neither the scene nor what it includes has \$wide\.",
        ),
        (["convert", "nope.binary", "-o", "x.csv"], r'data\.load\("nope\.binary"\): no such file'),
        (
            ["train", "SCENE", "-o", "run"],
            r'train ".*scene\.xml": no JSON settings \(.*\)\. Write it like the config\.json',
        ),
        (["convert", "SCENE", "-o", "x.exr"], r'-o: "x\.exr" must end in \.csv or \.npz'),
    ],
    ids=["suffix", "variant", "no scene", "unknown -D", "no data", "no JSON", "table suffix"],
)
def test_error_is_one_line_and_status_2(scene, tmp_path, monkeypatch, capsys, arguments, message):
    monkeypatch.chdir(tmp_path)
    assert main([scene if a == "SCENE" else a for a in arguments]) == 2
    captured = capsys.readouterr()
    assert captured.err.startswith("mi-enhance: ") and captured.err.count("\n") == 1
    assert captured.out == ""
    assert re.search(message, captured.err)


@pytest.mark.skipif(dr.has_backend(dr.JitBackend.CUDA), reason="the GPU of this machine works")
def test_variant_without_its_device_points_to_doctor(scene, tmp_path, capsys):
    assert main(["render", scene, "-o", str(tmp_path / "x.exr"), "--variant", "cuda_ad_rgb"]) == 2
    assert re.match(
        r'mi-enhance: --variant: "cuda_ad_rgb" does not work here \(.+\)\. Run: mi-enhance doctor\n',
        capsys.readouterr().err,
    )


def test_error_of_the_plugin_comes_without_mitsubas_traceback(tmp_path, capsys):
    path = tmp_path / "scene.xml"
    path.write_text(SCENE.replace("</transform></shape>", '</transform><bsdf type="enhanced"/></shape>'))
    assert main(["render", str(path), "-o", str(tmp_path / "x.exr"), "--variant", "scalar_rgb"]) == 2
    assert capsys.readouterr().err == (
        'mi-enhance: variant "scalar_rgb" cannot run the networks of "enhanced". '
        'Call mi.set_variant("llvm_ad_rgb") first.\n'
    )


def test_traceback_is_shown_on_request(tmp_path):
    with pytest.raises(FileNotFoundError, match="no such file"):
        main(["convert", "nope.csv", "-o", str(tmp_path / "x.csv"), "--traceback"])


def test_interruption_is_polite(monkeypatch, capsys):
    def interrupt(args):
        raise KeyboardInterrupt

    monkeypatch.setattr(demo, "run", interrupt)
    assert main(["demo"]) == 130
    assert capsys.readouterr().err == "mi-enhance: interrupted\n"


@pytest.mark.parametrize(
    "arguments, message",
    [
        (["render", "s.xml", "-o", "x.exr", "-D", "width"], '"width" is not KEY=VALUE'),
        (["show", "m.bsdf", "--set", "rho_d=red"], "the values must be numbers, as in rho_d=0.2,0.1,0.0"),
        *[
            (["convert", "d.csv", "-o", "x.npz", "--samples", n], f"{n} is not a positive whole number")
            for n in ("0", "1.5", "inf", "many")
        ],
    ],
    ids=["-D", "--set", "zero", "fraction", "infinite", "word"],
)
def test_malformed_option_is_explained(capsys, arguments, message):
    with pytest.raises(SystemExit) as stop:
        main(arguments)
    assert stop.value.code == 2
    assert message in capsys.readouterr().err


def test_convert_writes_a_table_that_can_be_read_again(tmp_path, capsys):
    output = tmp_path / "orange.npz"
    source = str(bundled_files.demo_data("chm_orange_rgb.bsdf"))
    assert main(["convert", source, "-o", str(output), "--samples", "2e2", "--json"]) == 0
    assert last_json(capsys)["n_samples"] == 200
    assert main(["convert", str(output), "-o", str(tmp_path / "again.csv"), "--json"]) == 0
    report = last_json(capsys)
    assert (report["n_samples"], report["name"]) == (200, "orange")


def test_convert_keeps_all_rows_of_a_table(tmp_path, capsys):
    n = 100_001  # more than are drawn from what is no table
    wi, wo = sample_pairs(n)
    np.savez(tmp_path / "t.npz", wi=wi, wo=wo, f=np.arange(n) / n)
    convert = ["convert", str(tmp_path / "t.npz"), "-o", str(tmp_path / "all.npz"), "--json"]
    assert main(convert) == 0 and last_json(capsys)["n_samples"] == n
    assert main([*convert, "--samples", "50"]) == 0 and last_json(capsys)["n_samples"] == 50


def test_doctor_finds_that_rendering_works(capsys):
    assert main(["doctor", "--json"]) == 0
    report = last_json(capsys)
    assert report["rendering_works"] and report["enhanced"]["result"] == "works"
    assert set(report["variants"]) == set(doctor.VARIANTS)
    assert report["variants"]["scalar_rgb"] == report["variants"]["llvm_ad_rgb"] == "works"
    assert report["versions"]["mitsuba"].startswith("3.9.")


@pytest.mark.parametrize(
    "code, result",
    [
        (
            "import os, sys; print('LLVM ERROR: no', file=sys.stderr); os.abort()",
            "the process died (SIGABRT): LLVM ERROR: no",
        ),
        ("raise RuntimeError('no GPU')", "no GPU"),
        ("pass", "works"),
    ],
    ids=["abort", "exception", "works"],
)
def test_doctor_survives_what_it_tries(code, result):
    assert doctor._in_child(code) == result


def test_missing_llvm_stops_every_command_but_doctor(monkeypatch, capsys):
    monkeypatch.setattr(llvm, "problem", "mi_enhance: Dr.Jit needs LLVM 17 or newer and found none. Run: it.")
    assert main(["show", "gold.bsdf"]) == 2
    assert capsys.readouterr().err == "mi-enhance: Dr.Jit needs LLVM 17 or newer and found none. Run: it.\n"
    assert main(["doctor"]) == 1
    assert "Rendering does not work." in capsys.readouterr().out


def test_model_is_a_file_a_shipped_network_or_a_text(llvm, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.toml").write_text("""
name = "mine"
formula = "M"
terms = { M = "rho_d / pi" }
parameters = { rho_d = true }
lobes = [{ rho_s = "0 * rho_d", alpha_x = "1", alpha_y = "1" }]
""")
    Material.analytic("ward").edit(rho_d=0.25).save("m.bsdf")
    assert str(arguments.model("mine.toml").brdf) == "M"
    assert arguments.model("m.bsdf").params["rho_d"].tolist() == [0.25] * 3
    assert str(arguments.model("paper").brdf) == str(Material.pretrained("paper").brdf)
    assert arguments.model_path("m.bsdf") == tmp_path / "m.bsdf"
