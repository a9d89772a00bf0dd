"""Nothing is written outside of the folder asked for, and nobody's file is replaced."""

from __future__ import annotations

import dataclasses
import os
from pathlib import Path

import numpy as np
import pytest

import mi_enhance  # noqa: F401  (before mitsuba)
from mi_enhance.cli.main import main
from mi_enhance.images.cameras import around
from mi_enhance.images.own_files import OwnFiles, inner_name
from mi_enhance.images.view_files import FILE, read_views, write_views


def named(*names, mask=False):
    (view,) = around(1, target=(0, 0, 0), distance=5, resolution=4)
    counts = np.arange(16).reshape(4, 4) > 3 if mask else view.mask
    return [dataclasses.replace(view, name=n, image=view.image + k + 1, mask=counts) for k, n in enumerate(names)]


def tree(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


NAMES = [
    "../images/a",
    "/etc/../a",
    "../../a",
    r"..\images\a",
    r"C:\photos\a",
    "C:a",
    "//server/a",
    "a/../../../a",
    "..",
]


@pytest.mark.parametrize("suffix", [".exr", ".png"])
def test_everything_lies_inside_the_folder(llvm, tmp_path, suffix):
    (tmp_path / "images").mkdir()
    for name in ("a.exr", "a.png", "a_mask.png"):
        (tmp_path / "images" / name).write_bytes(b"mine")
    folder = tmp_path / "deep" / "out"
    write_views(named(*NAMES, str(tmp_path / "images" / "a"), mask=True), folder, suffix=suffix)
    outside = {k: v for k, v in tree(tmp_path).items() if not k.startswith("deep")}
    assert set(outside.values()) == {b"mine"} and len(outside) == 3
    views = read_views(folder)
    assert len(views) == len(NAMES) + 1 and len(tree(folder)) == 2 * len(views) + 2
    assert [v.mask.sum() for v in views] == [12] * len(views)


@pytest.mark.parametrize("names", [("a", "A"), ("../b/1", "b/1"), ("a", "a_mask"), ("a b", "a b"), ("é", "e\u0301")])
def test_names_that_would_be_one_file_are_two(llvm, tmp_path, names):
    write_views(named(*names, mask=True), tmp_path, suffix=".png")
    write_views(named(*names, mask=True), tmp_path / "exr")
    written = [n.casefold() for n in tree(tmp_path)]
    assert len(set(written)) == len(written)
    assert [float(v.image[3, 3, 0]) for v in read_views(tmp_path / "exr")] == [1, 2]


def test_names_that_no_system_forbids():
    assert inner_name("a?b:c*") == "a_b_c_" and inner_name("con/aux.x") == "_con/_aux.x" and inner_name("..") == "view"


@pytest.mark.parametrize("other", [FILE, "a.exr", "a_mask.png"])
def test_files_of_others_are_not_replaced(llvm, tmp_path, other):
    (tmp_path / other).write_bytes(b"mine")
    with pytest.raises(ValueError, match=f"{other} exists, and was not written by mi_enhance"):
        write_views(named("b", "a", mask=True), tmp_path)
    assert tree(tmp_path) == {other: b"mine"}  # and nothing else is written


def test_own_files_are_replaced_until_somebody_changes_them(llvm, tmp_path):
    write_views(named("a"), tmp_path)
    write_views(named("b", "a"), tmp_path)
    assert read_views(tmp_path)[1].image[0, 0, 0] == 2
    (tmp_path / "a.exr").write_bytes(b"a photograph that took the place of a render")
    with pytest.raises(ValueError, match="changed since"):
        write_views(named("a"), tmp_path)


@pytest.mark.skipif(os.name == "nt", reason="links need rights there")
def test_links_do_not_lead_out(llvm, tmp_path):
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos" / "a.exr").write_bytes(b"mine")
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "sub").symlink_to(tmp_path / "photos")
    with pytest.raises(ValueError, match="leads? out|outside"):
        write_views(named("sub/b"), tmp_path / "out")
    (tmp_path / "out" / "a.exr").symlink_to(tmp_path / "photos" / "a.exr")
    with pytest.raises(ValueError, match="exists"):
        write_views(named("a"), tmp_path / "out")
    assert tree(tmp_path / "photos") == {"a.exr": b"mine"}


@pytest.mark.skipif(os.name == "nt", reason="links need rights there")
@pytest.mark.parametrize("name", ["a.exr", "s", ".mi_enhance_files.jsonl"])
@pytest.mark.parametrize("target", ["../mine.txt", "nowhere", "itself"])
def test_links_are_neither_followed_nor_replaced(llvm, tmp_path, name, target):
    """To a file, to nothing, or in a circle; through the list of files, too, lines would end up in somebody's file."""
    (tmp_path / "mine.txt").write_text("mine")
    out = tmp_path / "out"
    out.mkdir()
    (out / name).symlink_to(name if target == "itself" else target)
    with pytest.raises(ValueError, match="Choose another folder"):
        write_views(named("a", "s/b"), out)
    assert (out / name).is_symlink() and os.listdir(out) == [name] and (tmp_path / "mine.txt").read_text() == "mine"


def test_what_is_in_the_way_is_told_before_anything_is_written(llvm, tmp_path):
    (tmp_path / "sub").write_bytes(b"mine")
    with pytest.raises(ValueError, match="sub exists"):
        write_views(named("a", "sub/b"), tmp_path)
    with pytest.raises(ValueError, match="sub is no folder"):
        write_views(named("a"), tmp_path / "sub")
    assert tree(tmp_path) == {"sub": b"mine"}


AWKWARD = [
    "x" * 300,
    "/".join(["y" * 200] * 30),
    "\ud800",
    "a",
    "a.exr/b",
    "transforms.json/c",
    ".mi_enhance_files.jsonl/d",
]


def test_awkward_names_are_written(llvm, tmp_path):
    """Too long, no text, or a folder where another view has its file."""
    write_views(named(*AWKWARD), tmp_path)
    assert [v.image[0, 0, 0] for v in read_views(tmp_path)] == [1, 2, 3, 4, 5, 6, 7]


def test_a_list_that_is_damaged_makes_no_file_ours(llvm, tmp_path):
    write_views(named("a"), tmp_path)
    (tmp_path / ".mi_enhance_files.jsonl").write_bytes(b'\xff[["a.exr"]]\n{}\n["a.exr", 3]\n[[[')
    with pytest.raises(ValueError, match="exists"):
        write_views(named("a"), tmp_path)


def test_previews_replace_no_photograph(llvm, tmp_path, capsys):
    (tmp_path / "views.png").write_bytes(b"mine")
    arguments = ["x.xml", str(tmp_path), "-o", str(tmp_path / "x.bsdf"), "--preview", str(tmp_path)]
    assert main(["fit-images", *arguments]) == 2
    assert "views.png exists" in capsys.readouterr().err and (tmp_path / "views.png").read_bytes() == b"mine"


def test_a_file_is_whole_or_not_there(tmp_path):
    own = OwnFiles(tmp_path, "test")
    with pytest.raises(RuntimeError), own.replacing("a.txt") as temporary:
        Path(temporary).write_text("half")
        raise RuntimeError
    assert tree(tmp_path) == {}
