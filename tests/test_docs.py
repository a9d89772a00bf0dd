"""What README and notebooks show runs, and what they link exists."""

from __future__ import annotations

import re
import runpy
import shutil
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
# The notebook at a size that shows the code runs, not what a material looks like.
# What the cell tagged `parameters` of each notebook says here.
SMALL = {
    "01_quickstart": "resolution, spp, n_samples = 32, 4, 2000",
    "02_search": """names, n_samples, epochs = ["alum-bronze", "blue-acrylic"], 1280, 1
resolution, spp, n_fit = 32, 4, 2000""",
    "03_error_against_time": "n_samples, sizes, resolution, spp, rounds = 2000, (6,), 32, 4, 1",
    "04_fit_from_images": """resolution, n_views, spp = 16, 2, 16
stages, networks = [(1, 4, 4)], ("ggx",)""",
    "05_spatially_varying": 'size, n_samples, network, resolution, spp = 4, 32, "ggx", 32, 4',
    "06_take_it_elsewhere": "n_samples, n_pairs, resolution, spp = 2000, 100, 32, 4",
}


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)


def test_every_dotted_name_works_after_import_mi_enhance(run_child):
    """Those that pages, README and notebooks print, in a process that has imported nothing else."""
    pages = [*PAGES, ROOT / "scenes/README.md", *sorted((ROOT / "notebooks").glob("*.ipynb"))]
    text = "\n".join(page.read_text() for page in pages)
    names = sorted({m[0] for m in re.finditer(r"\b(?<![/\w.])(?:me|mi_enhance)(?:\.[A-Za-z_]\w*)+", text)})
    assert len(names) > 20
    code = f"""import functools, mi_enhance
for name in {names}:
    try:
        functools.reduce(getattr, name.split(".")[1:], mi_enhance)
    except AttributeError as error:
        print(name, error)
"""
    child = run_child(code)
    assert child.returncode == 0, child.stderr
    assert not child.stdout.strip(), child.stdout


@pytest.mark.slow
def test_site_builds_without_a_warning(run_child, tmp_path):
    pytest.importorskip("sphinx")
    child = run_child(
        "import sys; from sphinx.cmd.build import main; "
        f"sys.exit(main(['-W', '--keep-going', '-q', {str(ROOT / 'docs')!r}, {str(tmp_path / 'site')!r}]))"
    )
    assert child.returncode == 0, child.stdout + child.stderr
    assert {"index.html", "own_scene.html", "paper.html"} <= {p.name for p in (tmp_path / "site").iterdir()}


@pytest.mark.slow
def test_readme_python_runs(llvm, tmp_path, monkeypatch):
    """All Python of the README, in order, where its data file lies under the name it uses."""
    code = blocks("python")
    assert code, "README.md holds no Python block"
    monkeypatch.chdir(tmp_path)
    shutil.copy(ROOT / "mi_enhance/bundled/rgl/ilm_solo_m_68_rgb.bsdf", tmp_path)
    names: dict = {}
    for block in code:
        exec(compile(block, "README.md", "exec"), names)
    assert (tmp_path / "solo.bsdf").exists() and (tmp_path / "solo.png").exists()


def test_readme_xml_loads(llvm, tmp_path, monkeypatch):
    import mitsuba as mi

    import mi_enhance as me

    (xml,) = blocks("xml")
    monkeypatch.chdir(tmp_path)
    me.Material.pretrained("ggx").save("gold.bsdf")
    bsdf = mi.load_string(xml.replace("<bsdf", '<bsdf version="3.0.0"', 1))
    assert "Enhanced" in str(bsdf)


def test_readme_commands_are_those_of_the_program(llvm):
    from mi_enhance.cli.main import parser

    commands = re.findall(r"^mi-enhance (.*)$", "\n".join(blocks("sh")), re.MULTILINE)
    assert len(commands) >= 5
    for line in commands:
        parser().parse_args(line.split("#")[0].split())  # exits with an error for what it does not know


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_links_and_pictures_exist(page):
    text = re.sub(r"(?ms)^```.*?^```", "", page.read_text())  # code may look like a link: networks["sky"](x)
    targets = re.findall(r"\]\(([^)#:]+)\)|src=\"([^\":]+)\"", text)
    missing = [t for pair in targets for t in pair if t and not (page.parent / t).exists()]
    assert not missing, f"{page.name} names files that do not exist: {missing}"


def anchors(page: Path) -> set[str]:
    """What `page.md#...` may name: headings, as the site and code hosts spell them."""
    heads = re.findall(r"^#+ (.*)$", re.sub(r"```.*?```", "", page.read_text(), flags=re.DOTALL), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", head.lower()).strip().replace(" ", "-") for head in heads}


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_anchors_exist(page):
    for target, anchor in re.findall(r"\]\(([^)#:]*)#([^)]+)\)", page.read_text()):
        other = page.parent / target if target else page
        assert anchor in anchors(other), f"{page.name}: {other.name} has no heading #{anchor}"


def test_links_that_nobody_answers_are_listed_and_others_fail():
    check_links = runpy.run_path(str(ROOT / "docs/check_links.py"))
    entry = {"filename": "a.md", "lineno": 1, "uri": "https://x.org", "status": "broken", "code": 0, "info": "no name"}
    entries = [entry, {**entry, "code": 404}, {**entry, "uri": "b.md"}, {**entry, "status": "working"}]
    found = check_links["verdicts"](entries)
    assert {kind: len(lines) for kind, lines in found.items()} == {"ok": 1, "unreachable": 1, "wrong": 2}


def test_every_page_has_a_place_in_the_site():
    index = (ROOT / "docs/index.md").read_text()
    for page in [*(ROOT / "docs").glob("*.md"), *(ROOT / "notebooks").glob("*.ipynb")]:
        has_place = re.search(rf"^(generated/tutorials/)?{page.stem}$", index, re.MULTILINE)
        assert page.stem == "index" or has_place, page.name


@pytest.mark.slow
@pytest.mark.parametrize("path", sorted((ROOT / "notebooks").glob("*.ipynb")), ids=lambda p: p.stem)
def test_notebook_runs_anywhere_and_is_tidy(path, llvm, tmp_path):
    import nbformat
    from nbclient import NotebookClient

    notebook = nbformat.read(path, as_version=4)
    assert "You will learn" in notebook.cells[0].source
    small = [cell for cell in notebook.cells if "parameters" in cell.metadata.get("tags", ())]
    assert len(small) == 1, "one cell is tagged parameters, so that it can run small here"
    for cell in notebook.cells:
        if cell.cell_type == "code":
            assert not cell.outputs, f"{path.name}: clear the outputs before committing"
    small[0].source = SMALL[path.stem]
    NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(tmp_path)}}).execute()
