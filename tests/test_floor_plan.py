"""Imports go downwards only (the design's floor plan), and only the plugin folder subclasses Mitsuba."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]

# A file may import only files of lower floors. `data` and `bsdfs` are one entry each; what they do inside is their own.
FLOORS = [
    ["_files", "_llvm", "geometry", "graph", "nn", "losses", "parameters", "expression", "timing"],
    ["terms", "model_file", "metrics", "data", "scene"],
    ["models", "picture", "table", "views"],
    ["features", "alternatives", "photographs", "view_files"],
    ["compact"],
    ["enhance", "sampling"],
    ["energy", "mixture"],
    ["material", "state", "lean", "objective", "levenberg"],
    ["maps"],
    ["surface", "distil", "prune", "prior", "imitate", "normalise", "determined", "bsdfs"],
    ["placed", "inverse_picture", "density", "check_picture"],
    ["fit", "inverse_starts", "unknowns"],
    ["image_descent"],
    ["image_fit"],
    ["specialize", "texels"],
    ["train", "inverse", "compare", "doctor", "rivals", "check"],
    ["contenders", "report_page", "workers"],
    ["report"],
    ["candidate"],
    ["search_view", "search_picture"],
    ["search"],
    ["demo"],
    ["commands"],
    ["cli"],
    ["__main__", "__init__"],
]
FLOOR = {name: i for i, names in enumerate(FLOORS) for name in names}

SOURCES = {path: path.stem for path in (ROOT / "mi_enhance").glob("*.py")}
SOURCES |= {path: "data" for path in (ROOT / "mi_enhance/data").glob("*.py")}
SOURCES |= {path: "bsdfs" for path in (ROOT / "bsdfs").glob("*.py")}


def imported(path: Path, entry: str) -> set[str]:
    """Entries of the table that a file imports, wherever in the file it does so."""
    inside = entry if entry in ("data", "bsdfs") else None  # a package: one dot is the package itself, two are ours
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {a.name.split(".")[1] for a in node.names if a.name.startswith("mi_enhance.")}
        elif isinstance(node, ast.ImportFrom):
            ours = node.module and node.level == 0 and node.module.split(".")[0] == "mi_enhance"
            if ours:
                below = node.module.split(".")[1:]
            elif node.level == (2 if inside else 1):
                below = node.module.split(".") if node.module else []
            else:
                continue
            found |= {below[0]} if below else {a.name for a in node.names if a.name in FLOOR}
    return found - {inside}


@pytest.mark.parametrize("path", SOURCES, ids=lambda p: p.relative_to(ROOT).as_posix())
def test_imports_go_downwards(path):
    entry = SOURCES[path]
    assert entry in FLOOR, f"{path.name} is not on the floor plan: give it a floor in {Path(__file__).name}."
    wrong = {name for name in imported(path, entry) if FLOOR.get(name, len(FLOORS)) >= FLOOR[entry]}
    assert not wrong, f"{entry} must not import {sorted(wrong)}; the floors, lowest first: {FLOORS}"


@pytest.mark.parametrize("path", [p for p in SOURCES if SOURCES[p] != "bsdfs"], ids=lambda p: p.name)
def test_only_the_plugin_folder_subclasses_mitsuba(path):
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ClassDef):
            assert not [b for b in node.bases if ast.unparse(b).startswith(("mi.", "mitsuba."))], node.name


def test_the_check_sees_every_form_of_import(tmp_path):
    path = tmp_path / "x.py"
    path.write_text(
        "def f():\n from .fit import a\n from . import nn, b\n"
        "import mi_enhance.data.merl\nfrom mi_enhance.analytic.terms.distribution import c\nfrom mi_enhance import models\n"
    )
    assert imported(path, "graph") == {"fit", "nn", "data", "terms", "models"}
    path.write_text("from . import sampling\nfrom ..fit import a\nfrom .. import terms\n")
    assert imported(path, "data") == {"fit", "terms"}
