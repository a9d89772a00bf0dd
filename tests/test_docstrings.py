"""The examples in the docstrings run and say the truth."""

from __future__ import annotations

import doctest
import importlib
import pkgutil
import re

import mi_enhance  # (before mitsuba)

import drjit as dr  # isort: skip
import mitsuba as mi
import numpy as np
import pytest

MODULES = sorted(
    m.name for m in pkgutil.walk_packages(mi_enhance.__path__, "mi_enhance.") if not m.name.endswith("__main__")
)
OPTIONS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE


@pytest.mark.parametrize("name", MODULES)
def test_examples_of(llvm, name):
    module = importlib.import_module(name)
    tests = doctest.DocTestFinder(exclude_empty=True).find(module, extraglobs={"mi": mi, "dr": dr, "np": np})
    tests = [t for t in tests if t.examples]
    runner = doctest.DocTestRunner(optionflags=OPTIONS)
    with np.printoptions(legacy=False):  # colour-science sets NumPy 1.13's for the whole process once it is imported
        for test in tests:
            runner.run(test)
    assert runner.failures == 0


def test_every_module_is_looked_at():
    assert {
        "mi_enhance.analytic.geometry",
        "mi_enhance.analytic.terms",
        "mi_enhance.fitting.fit",
        "mi_enhance.data.merl",
    } <= set(MODULES)


def test_plugin_names_every_parameter():
    """All that any model or network has, in the text from which the reference of the plugin is made."""
    from mi_enhance import bsdfs, models
    from mi_enhance.analytic import parameters

    text = importlib.import_module(f"{bsdfs.__name__}.enhanced").__doc__
    names = {p.name for model in models.MODELS.values() for p in model().parameters}
    for name in names | {parameters.ASYMMETRY.name, "latent"}:
        assert re.search(rf"^ \* - .*\b{name}\b", text, re.MULTILINE), name


def test_examples_exist():
    """Terms and the names that the package exports are shown in use."""
    from mi_enhance import enhance, fit, terms
    from mi_enhance.material import material

    found = [getattr(terms, name) for name in terms.__all__]
    assert len(found) >= 20
    for item in [*found, enhance, fit, material.Material]:
        assert ">>>" in (item.__doc__ or ""), item
