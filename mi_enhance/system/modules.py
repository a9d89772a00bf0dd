"""Folders whose files are imported for them: those that register themselves, and those that a name asks for."""

from __future__ import annotations

import importlib
import importlib.util
import pkgutil
from collections.abc import Callable, Iterable
from types import ModuleType


def import_all(package: str, path: Iterable[str]) -> None:
    """Import every module of a package, in alphabetical order; those already imported stay as they are.

    Parameters
    ----------
    package : str
        Its full name, ``__name__`` in its ``__init__.py``.
    path : iterable of str
        Its folders, ``__path__`` there.

    Examples
    --------
    >>> from mi_enhance import models
    >>> import_all(models.__name__, models.__path__)
    """
    for module in pkgutil.iter_modules(path, f"{package}."):
        importlib.import_module(module.name)


def submodules(package: str) -> Callable[[str], ModuleType]:
    """Return the ``__getattr__`` of a package that imports each of its modules when it is first asked for.

    So a name with dots works after ``import mi_enhance`` alone, and nothing is imported that is not asked for.

    Examples
    --------
    >>> submodules("mi_enhance.system")("messages").__name__
    'mi_enhance.system.messages'
    """

    def lookup(name: str) -> ModuleType:
        full = f"{package}.{name}"
        if name.startswith("_") or importlib.util.find_spec(full) is None:
            raise AttributeError(f'{package} has no "{name}".')
        return importlib.import_module(full)

    return lookup
