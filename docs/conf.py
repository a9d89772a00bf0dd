"""The documentation site: `make docs` builds it, and takes a warning for an error.

Pages that repeat what stands in the code are made from it here: the reference of the Python names, of the command line
and of the plugin, and the notebooks as tutorials. They lie in ``docs/generated`` and are not kept.
"""

from __future__ import annotations

import argparse
import importlib
import os
import re
import shutil
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))
GENERATED = Path(__file__).parent / "generated"

import mi_enhance as me  # noqa: E402

import mitsuba as mi  # noqa: E402  isort: skip

mi.set_variant("llvm_ad_rgb")

project, author, release = "mi_enhance", "mi_enhance developers", me.__version__
extensions = ["sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.mathjax", "myst_nb"]
html_theme = "furo"
html_title = f"mi_enhance {release}"
templates_path: list[str] = []
exclude_patterns = ["images"]
source_suffix = {".md": "myst-nb", ".ipynb": "myst-nb", ".rst": "restructuredtext"}
myst_enable_extensions = ["dollarmath", "amsmath", "colon_fence"]
myst_heading_anchors = 4
nb_execution_mode = "cache" if os.environ.get("DOCS_EXECUTE") else "off"
nb_execution_timeout = 600
autodoc_typehints = "none"  # the docstrings say more: shapes, units, ranges
autodoc_member_order = "bysource"
napoleon_google_docstring = False
napoleon_use_rtype = False
# Links out of docs/ lead to files of the repository, which are no pages.
suppress_warnings = ["myst.header"]
linkcheck_ignore = [r"https://doi\.org/.*"]  # answers programs with 403

DEFAULT_ROLE = "code"
default_role = DEFAULT_ROLE


def write(name: str, text: str) -> None:
    """Write a generated page, unless it is there already: an unchanged page is not built again."""
    path = GENERATED / name
    path.parent.mkdir(parents=True, exist_ok=True)
    if not path.exists() or path.read_text() != text:
        path.write_text(text)


def python_names() -> str:
    """Return the page of the public names, in the order of `mi_enhance.__all__`."""
    lines = [
        "Python",
        "======",
        "",
        "All names work after ``import mi_enhance as me``: ``me.fit``, ``me.data.load``.",
        "",
    ]
    for name, module in me._PUBLIC.items():
        kind = "class" if isinstance(getattr(me, name), type) else "function"
        lines += [f"me.{name}", "-" * (len(name) + 3), "", f".. auto{kind}:: mi_enhance.{module}.{name}"]
        lines += ["   :members:" if kind == "class" else "", ""]
    for name, module in me._MODULES.items():
        found = importlib.import_module(f"mi_enhance.{module}")
        public = [n for n in getattr(found, "__all__", dir(found)) if callable(getattr(found, n)) and n[0] != "_"]
        public = [n for n in public if getattr(getattr(found, n), "__module__", "").startswith("mi_enhance")]
        lines += [f"me.{name}", "-" * (len(name) + 3), "", f".. automodule:: mi_enhance.{module}", "   :no-index:", ""]
        for n in sorted(public):
            value = getattr(found, n)
            kind = "class" if isinstance(value, type) else "function"
            lines += [f".. auto{kind}:: {value.__module__}.{value.__name__}", "   :no-index:", ""]
    return "\n".join(lines)


def command_line() -> str:
    """Return the page of the commands: what each says with ``--help``."""
    from mi_enhance.cli.main import parser

    os.environ["COLUMNS"] = "100"
    top = parser()
    lines = [
        "# Command line",
        "",
        "`mi-enhance COMMAND --help` prints these.",
        "",
        "```text",
        top.format_help().rstrip(),
        "```",
        "",
    ]
    choices = next(a for a in top._actions if isinstance(a, argparse._SubParsersAction)).choices
    for name, command in choices.items():
        lines += [f"## mi-enhance {name}", "", "```text", command.format_help().rstrip(), "```", ""]
    return "\n".join(lines)


def plugin() -> str:
    """Return the page of the plugin: its docstring, in whose form Mitsuba's own plugins are documented."""
    text = importlib.import_module(f"{me.bsdfs.__name__}.enhanced").__doc__ or ""
    head, table, rest = re.split(r"\.\. pluginparameters::\n|\n\n(?=An analytic)", text.lstrip(), maxsplit=2)
    rows = [" ".join(row.split()).split(" - ", 2) for row in re.split(r"(?m)^ \* - ", table)[1:]]
    lines = [".. list-table::", "   :header-rows: 1", ""]
    for name, kind, *about in [["parameter", "type", "what it is"], *rows]:
        if not about:  # a parameter that scenes see and no file sets
            kind, about = "", [kind]
        lines += [f"   * - {name}", f"     - {kind}", f"     - {about[0].replace(' - |exposed|', ' |exposed|')}"]
    text = head + "\n".join(lines) + "\n\n" + rest
    text = re.sub(r":monosp:`([^`]*)`", r"``\1``", text)
    text = re.sub(r"(?m)^\.\. tabs::\n", "", text)
    text = re.sub(r"(?m)^    \.\. code-tab:: (\w+)\n((?:\n|        .*\n)*)", _code, text)
    words = {"spectrum": "spectrum", "texture": "texture", "float": "float", "bool": "boolean", "string": "string"}
    words |= {"transform": "transform", "exposed": "(exposed", "differentiable": "differentiable)"}
    return text + "\n" + "\n".join(f".. |{k}| replace:: *{v}*" for k, v in words.items()) + "\n"


def _code(found: re.Match) -> str:
    body = "\n".join(line[4:] for line in found[2].splitlines())
    return f".. code-block:: {found[1]}\n\n{body}\n\n"


# Pages outside of docs/ that have a place in the site
MOVED = {"../notebooks/": "generated/tutorials/", "../CONTRIBUTING.md": "generated/contributing.md"}


def contributing() -> str:
    """Return CONTRIBUTING.md with the links that it has from here."""
    text = (ROOT / "CONTRIBUTING.md").read_text()
    text = re.sub(r"\]\(docs/", "](../", text)
    return re.sub(r"\[([^\]]*)\]\((?!\.\./|https?:)[^)]*\)", r"`\1`", text)


def read(app, name: str, source: list[str]) -> None:
    """Lead links out of docs/ to the place that a page has in the site."""
    for old, new in MOVED.items():
        source[0] = source[0].replace(f"]({old}", f"]({new}")
    if name.startswith("generated/tutorials/"):  # copies of the notebooks
        source[0] = source[0].replace("](../docs/", "](../../")


def setup(app) -> None:
    """Register what is done while Sphinx reads."""
    app.connect("source-read", read)


def notebooks() -> None:
    """Put the notebooks where Sphinx finds them."""
    (GENERATED / "tutorials").mkdir(parents=True, exist_ok=True)
    for path in sorted((ROOT / "notebooks").glob("*.ipynb")):
        shutil.copy(path, GENERATED / "tutorials" / path.name)


write("python.rst", python_names())
write("command_line.md", command_line())
write("plugin.rst", plugin())
write("contributing.md", contributing())
notebooks()
