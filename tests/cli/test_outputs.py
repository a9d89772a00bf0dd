"""Places where nothing can be written are refused before the work, and nothing of the user's is touched."""

from __future__ import annotations

import os
import stat

import pytest

from mi_enhance.cli import fit_images
from mi_enhance.cli.main import main, parser
from mi_enhance.cli.outputs import output_file, output_folder
from mi_enhance.system import bundled_files

DATA = str(bundled_files.demo_data("satin_rosaline_rgb.bsdf"))
# every command that writes a file, or into a folder; the files it reads come last, if it gets so far
FILES = {
    "fit": ["fit", "DATA", "-o", "OUT.bsdf"],
    "fit-images": ["fit-images", "SCENE", "PHOTOS", "-o", "OUT.bsdf"],
    "render": ["render", "SCENE", "-o", "OUT.exr"],
    "show": ["show", "DATA", "-o", "OUT.bsdf"],
    "specialize": ["specialize", "DATA", "-o", "OUT.bsdf"],
    "convert": ["convert", "DATA", "-o", "OUT.csv"],
    "search": ["search", "ggx", "--data", "DATA", "-o", "OUT.bsdf"],
}
FOLDERS = {
    "demo": ["demo", "-o", "OUT"],
    "check": ["check", "DATA", "-o", "OUT"],
    "compare": ["compare", "DATA", "-o", "OUT"],
    "bench": ["bench", "DATA", "-o", "OUT"],
    "figure": ["figure", "5", "DATA", "-o", "OUT"],
    "train": ["train", "CONFIG", "-o", "OUT"],
}


@pytest.fixture
def refused(tmp_path, capsys):
    """Run a command whose output cannot be written, and return the one line that says so."""

    def run(arguments: list[str], out: str) -> str:
        (tmp_path / "config.json").write_text("{}")
        names = {"DATA": DATA, "CONFIG": str(tmp_path / "config.json")}
        before = {p: p.stat().st_mtime_ns for p in tmp_path.rglob("*")}
        assert main([names.get(a, a).replace("OUT", out) for a in arguments]) == 2
        assert {p: p.stat().st_mtime_ns for p in tmp_path.rglob("*") if p.is_file()} == {
            p: t for p, t in before.items() if p.is_file()
        }
        assert set(before) == set(tmp_path.rglob("*"))
        error = capsys.readouterr().err
        assert error.startswith("mi-enhance: -o: ") and error.count("\n") == 1, error
        return error

    return run


@pytest.mark.parametrize("command", FILES)
def test_folder_in_the_place_of_a_file(refused, tmp_path, command):
    arguments = FILES[command]
    (tmp_path / f"result{arguments[-1].removeprefix('OUT')}").mkdir()
    assert "is a folder. Name a file" in refused(arguments, str(tmp_path / "result"))


@pytest.mark.parametrize("command", FOLDERS)
def test_file_in_the_place_of_a_folder(refused, tmp_path, command):
    (tmp_path / "result").write_text("mine")
    assert "is a file. Name a folder." in refused(FOLDERS[command], str(tmp_path / "result"))


@pytest.mark.parametrize("command", [*FILES, *FOLDERS])
@pytest.mark.parametrize("place", ["x/result", "x/new/result"], ids=["beside", "below"])
def test_file_in_the_place_of_the_folder_around(refused, tmp_path, command, place):
    (tmp_path / "x").write_text("mine")
    assert "nothing can be written to" in refused({**FILES, **FOLDERS}[command], str(tmp_path / place))


@pytest.mark.skipif(not os.path.isdir("/proc"), reason="needs a folder that not even root can write to")
@pytest.mark.parametrize("command", [*FILES, *FOLDERS])
def test_folder_that_cannot_be_written(refused, command):
    assert "nothing can be written to" in refused({**FILES, **FOLDERS}[command], "/proc/result")


def test_search_looks_at_its_run_folder(refused, tmp_path):
    (tmp_path / "result.search").write_text("mine")
    assert "is a file. Name a folder." in refused(FILES["search"], str(tmp_path / "result"))


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write anything")
def test_write_protected_file_stays(tmp_path):
    path = tmp_path / "m.bsdf"
    path.write_text("mine")
    path.chmod(stat.S_IRUSR)
    with pytest.raises(PermissionError, match="write-protected"):
        output_file(path, (".bsdf",))


@pytest.mark.parametrize(
    "arguments",
    [
        ["fit", "IN", "-o", "IN"],
        ["fit", DATA, "-m", "IN", "-o", "IN"],
        ["show", "IN", "--set", "rho_d=0.1", "-o", "IN"],
        ["specialize", "IN", "-o", "IN"],
        ["specialize", DATA, "IN", "-o", "IN"],
        ["search", "ggx", "--data", "IN", "-o", "IN"],
        ["search", "ggx", "--data", DATA, "--validation", "IN", "-o", "IN"],
        ["fit-images", "s.xml", "photos", "-m", "IN", "-o", "IN"],
    ],
    ids=["data", "model", "shown", "specialized", "followed", "training", "validation", "start"],
)
def test_no_command_writes_over_what_it_reads(tmp_path, capsys, arguments):
    path = tmp_path / "m.bsdf"
    path.write_bytes(b"mine")
    (tmp_path / "link.bsdf").symlink_to(path)
    assert main([str(path) if a == "IN" else a for a in arguments[:-1]] + [str(tmp_path / "link.bsdf")]) == 2
    assert "is what the command reads. Choose another name." in capsys.readouterr().err
    assert path.read_bytes() == b"mine"


@pytest.mark.parametrize("old", [None, b"the old one"], ids=["new", "old"])
def test_the_probe_leaves_nothing_and_changes_nothing(tmp_path, old):
    path = tmp_path / "m.bsdf"
    if old:
        path.write_bytes(old)
    assert output_file(path, (".bsdf",)) == path
    assert output_folder(tmp_path) == tmp_path
    output_file(tmp_path / "a/b/c.bsdf", (".bsdf",))
    output_folder(tmp_path / "a/b")
    assert list(tmp_path.iterdir()) == ([path] if old else [])
    assert old is None or path.read_bytes() == old


def test_name_that_is_too_long_is_found_early(tmp_path):
    with pytest.raises(OSError, match="nothing can be written to .*File name too long"):
        output_file(tmp_path / f"{'x' * 245}.bsdf", (".bsdf",))


def test_ids_of_materials_are_no_paths(tmp_path):
    names = ["a/../../b", "a_.._.._b", "left"]
    paths = fit_images._outputs(tmp_path / "m.bsdf", names)
    assert [path.name for path in paths.values()] == ["m_a_.._.._b.bsdf", "m_a_.._.._b_.bsdf", "m_left.bsdf"]
    assert all(path.parent == tmp_path for path in paths.values())
    assert fit_images._outputs(tmp_path / "m.bsdf", ["a/b"]) == {"a/b": tmp_path / "m.bsdf"}


@pytest.mark.parametrize(
    "old, new",
    [
        (["fit", "d", "-o", "x", "--network", "n"], ["fit", "d", "-o", "x", "--model", "n"]),
        (["fit", "d", "-o", "x", "--energy"], ["fit", "d", "-o", "x", "--bound-energy"]),
        (["fit-images", "s", "v", "-o", "x", "--network", "n"], ["fit-images", "s", "v", "-o", "x", "-m", "n"]),
        (["compare", "d", "--network", "n"], ["compare", "d", "-m", "n"]),
    ],
    ids=["network", "energy", "fit-images", "compare"],
)
def test_options_of_version_0_1_still_work(old, new, capsys):
    assert parser().parse_args(old) == parser().parse_args(new)
    with pytest.raises(SystemExit):
        main([old[0], "--help"])
    assert "--network" not in capsys.readouterr().out


@pytest.mark.parametrize("command", [["compare", "x.bsdf"], ["bench", "x.bsdf"]], ids=lambda c: c[0])
def test_pictures_too_small_to_be_compared_are_refused_before_the_work(command, capsys):
    with pytest.raises(SystemExit, match="2"):
        main([*command, "--resolution", "10"])
    assert "10 is too small: SSIM needs at least 11 pixels on a side" in capsys.readouterr().err
