"""Folders whose files register themselves: a model, a term or a reader is added by one new file."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Iterable


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
