"""Names of version 0.1 still work, and say where they are now."""

from __future__ import annotations

import importlib
import warnings

import mitsuba as mi
import numpy as np
import pytest

import mi_enhance
from mi_enhance import _moved
from mi_enhance.material.material import Material


def public_names(module):
    return [n for n, v in vars(module).items() if n[0] != "_" and callable(v) and v.__module__ == module.__name__]


@pytest.mark.parametrize("old", _moved.MODULES)
def test_old_module_has_the_names_of_the_new_ones(llvm, old):
    module = importlib.import_module(f"mi_enhance.{old}")
    for new in (importlib.import_module(f"mi_enhance.{m}") for m in reversed(_moved.MODULES[old].split())):
        for name in public_names(new):
            with warnings.catch_warnings(record=True) as caught:
                warnings.simplefilter("always")
                value = getattr(module, name)
            assert value.__name__ == name
            places = [str(w.message) for w in caught if w.category is DeprecationWarning]
            assert not places if old in _moved.PUBLIC else f" is now {value.__module__}.{name};" in places[-1]
            assert all(w.filename == __file__ for w in caught)  # it points to the script


@pytest.mark.parametrize("path", _moved.NAMES)
def test_renamed(llvm, path):
    old, _, name = path.rpartition(".")
    module = importlib.import_module(f"mi_enhance.{old}" if old else "mi_enhance")
    with pytest.warns(DeprecationWarning, match=f"{name} is now mi_enhance.{_moved.NAMES[path]}"):
        assert getattr(module, name).__name__ == _moved.NAMES[path].rpartition(".")[2]


@pytest.mark.parametrize("module, name", [("fit", "fits"), ("sampling", "sampel"), ("material", "Materiel")])
def test_name_that_never_was_is_refused(module, name):
    with pytest.raises(AttributeError, match=f'"mi_enhance.{module}" has no attribute "{name}"'):
        getattr(importlib.import_module(f"mi_enhance.{module}"), name)


def test_module_that_never_was_is_not_found():
    with pytest.raises(ModuleNotFoundError):
        importlib.import_module("mi_enhance.gold")


@pytest.mark.parametrize("name", ["check", "compare", "enhance", "fit", "search", "specialize", "train"])
def test_function_works_after_the_old_module_of_its_name_was_imported(run_child, name):
    """Python puts the module in the place of the function; so the module can be called."""
    child = run_child(
        f"import mi_enhance as me, mi_enhance.{name}\ntry: me.{name}()\nexcept TypeError as error: print(error)",
        DRJIT_LIBLLVM_PATH=mi_enhance.system.llvm.found.path,
    )
    assert child.stdout.startswith(f"{name}() missing"), child.stderr


def test_old_names_of_a_material(llvm):
    with pytest.warns(DeprecationWarning, match=r"network\(\) is now Material.pretrained\(\)"):
        material = Material.network("ggx")
    with pytest.warns(DeprecationWarning, match="exact is now Material.unspecialized"):
        assert material.exact.params.keys() == material.params.keys()
    with pytest.warns(DeprecationWarning, match="as_vector"):
        np.testing.assert_array_equal(material.vector(), material.as_vector())
    with pytest.warns(DeprecationWarning, match="as_drjit"):
        assert isinstance(material.lanes()["alpha_x"], mi.Float)
