"""What ``import mi_enhance`` gives: names, the plugin in every variant, and nothing that is not needed."""

from __future__ import annotations

from pathlib import Path

import mitsuba as mi
import pytest

import mi_enhance
from mi_enhance.system import bundled_files

try:
    import tomllib
except ModuleNotFoundError:  # Python 3.10
    import tomli as tomllib


def test_unknown_name_lists_the_public_ones():
    with pytest.raises(AttributeError, match='mi_enhance has no "fitt". Public names: .*Material.*fit'):
        mi_enhance.fitt  # noqa: B018


@pytest.mark.parametrize("name", mi_enhance.__all__)
def test_public_name_can_be_had(name):
    assert name in dir(mi_enhance)
    assert getattr(mi_enhance, name) is not None


@pytest.mark.parametrize("order", ["mi_enhance first", "mitsuba first"])
def test_plugin_follows_the_variant_whatever_the_order_of_import(run_child, order):
    first = {
        "mi_enhance first": "import mi_enhance; import mitsuba as mi",
        "mitsuba first": "import mitsuba as mi; mi.set_variant('llvm_ad_mono'); import mi_enhance",
    }[order]
    code = f"""{first}
material = {{"type": "enhanced", "filename": {str(bundled_files.network_file("ggx"))!r}}}
if mi.variant(): mi.load_dict(material)
for variant in ("llvm_ad_rgb", "scalar_rgb", "llvm_ad_spectral", "llvm_ad_rgb"):
    mi.set_variant(variant)
    try:
        print(variant, type(mi.load_dict(material)).__name__)
    except RuntimeError as error:
        print(variant, str(error).splitlines()[-1])
"""
    child = run_child(code, DRJIT_LIBLLVM_PATH=mi_enhance.system.llvm.found.path)
    assert child.returncode == 0, child.stderr
    lines = child.stdout.splitlines()
    assert [line.split()[0] for line in lines] == ["llvm_ad_rgb", "scalar_rgb", "llvm_ad_spectral", "llvm_ad_rgb"]
    assert [line.split()[1] for line in lines if line.startswith("llvm")] == ["Enhanced"] * 3
    assert 'variant "scalar_rgb" cannot run the networks of "enhanced". Call mi.set_variant("llvm_ad_rgb")' in lines[1]


def test_many_materials_load_in_parallel(llvm):
    name = bundled_files.network_file("ggx")
    shapes = "".join(
        f'<shape type="sphere"><bsdf type="enhanced"><string name="filename" value="{name}"/></bsdf></shape>'
        for _ in range(20)
    )
    scene = mi.load_string(f'<scene version="3.0.0">{shapes}</scene>', parallel=True, optimize=False)
    assert len({shape.bsdf() for shape in scene.shapes()}) == 20


@pytest.mark.parametrize("find", [bundled_files.scene_file, bundled_files.demo_data, bundled_files.network_file])
def test_missing_bundled_file_lists_those_there_are(find):
    with pytest.raises(
        FileNotFoundError, match=r'"gold\S*" does not come with mi_enhance. Choose one of: .+\.(xml|bsdf)'
    ):
        find("gold")


def test_rendering_imports_nothing_but_what_it_needs(run_child):
    """Neither fits, training and judging, nor plots, metrics and progress."""
    code = """
import sys
from mi_enhance.cli.doctor import try_variant
assert try_variant("llvm_ad_rgb", "enhanced") is None
rooms = ("fitting", "training", "hypercube", "images", "specialization", "evaluation", "benchmark")
print([name for name in sys.modules if name.startswith(tuple(f"mi_enhance.{room}." for room in rooms))])
print({"matplotlib", "skimage", "colour", "rich", "tqdm", "scipy", "OpenEXR"} & set(sys.modules) or "none")
"""
    child = run_child(code, DRJIT_LIBLLVM_PATH=mi_enhance.system.llvm.found.path)
    assert child.stdout.split() == ["[]", "none"], child.stderr + child.stdout


def test_version_stands_in_one_place():
    """The package's own; the citation file, which cannot ask, says the same."""
    root = Path(__file__).parents[1]
    project = tomllib.loads((root / "pyproject.toml").read_text())
    assert project["project"]["dynamic"] == ["version"]
    assert f"version: {mi_enhance.__version__}\n" in (root / "CITATION.cff").read_text()


def test_every_folder_of_the_package_is_shipped():
    root = Path(__file__).parents[1]
    listed = tomllib.loads((root / "pyproject.toml").read_text())["tool"]["setuptools"]["packages"]
    folders = {p.parent.relative_to(root) for p in (root / "mi_enhance").rglob("*.py")}
    assert {".".join(f.parts) for f in folders} <= set(listed)
