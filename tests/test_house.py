"""Rules of the house that `make lint` does not see: who may know what, and that everything is installed."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
FILES = sorted([*ROOT.glob("mi_enhance/**/*.py"), *ROOT.glob("bsdfs/*.py")])
# whose layer is below or beside that of bsdfs/, see the contract in pyproject.toml
BELOW = ("system", "numerics", "output", "analytic", "data", "neural", "sampling", "material", "fitting")


def room(path: Path) -> str:
    parts = path.relative_to(ROOT).parts
    return parts[1] if parts[0] == "mi_enhance" else parts[0]


def imports(path: Path) -> Iterator[str]:
    """Full names of all that a file imports, wherever in it."""
    package = list(path.relative_to(ROOT).parts[:-1])
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = package[: len(package) - node.level + 1] if node.level else []
            start = ".".join([*above, *([node.module] if node.module else [])])
            yield from (f"{start}.{alias.name}" for alias in node.names)


def test_only_bsdfs_subclasses_mitsuba():
    """Such a class holds for the variant that was active when it was made; `bsdfs/` is loaded anew for each."""
    found = [
        f"{path.relative_to(ROOT)}: {node.name}"
        for path in FILES
        if room(path) != "bsdfs"
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.ClassDef)
        if any(re.match(r"(mi|_mi|mitsuba)\.", ast.unparse(base)) for base in node.bases)
    ]
    assert not found


def test_only_neural_knows_the_networks_of_drjit():
    assert not [
        path for path in FILES if room(path) != "neural" if any(n.startswith("drjit.nn") for n in imports(path))
    ]


def test_rooms_below_the_plugin_do_not_import_it():
    """The import contract cannot see this: in a checkout ``mi_enhance.bsdfs`` is no folder of the package."""
    plugin = "mi_enhance.bsdfs"
    assert not [path for path in FILES if room(path) in BELOW if any(n.startswith(plugin) for n in imports(path))]


def test_every_package_is_installed():
    """`pyproject.toml` has to list them: `bsdfs/` and `scenes/` lie beside the package, where no search finds them."""
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8").partition("packages = [")[2].partition("]")[0]
    listed = re.findall(r'"(mi_enhance[\w.]*)"', text)
    found = {".".join(path.parent.relative_to(ROOT).parts) for path in ROOT.glob("mi_enhance/**/__init__.py")}
    assert set(listed) == found | {"mi_enhance.bsdfs", "mi_enhance.scenes"}
    assert listed == sorted(listed)


def test_every_room_is_in_the_import_contract():
    rooms = {path.parent.name for path in ROOT.glob("mi_enhance/*/__init__.py")}
    contract = (ROOT / "pyproject.toml").read_text(encoding="utf-8").partition("[[tool.importlinter.contracts]]")[2]
    assert rooms <= set(re.findall(r"\bmi_enhance\.(\w+)", contract))
