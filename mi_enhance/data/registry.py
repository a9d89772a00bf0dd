"""The readers of measured files: each registers itself in the file it stands in.

A new reader is one new file in this folder::

    @reader("mine", about="Mine .mine", suffixes=(".mine",), magic=b"MINE")
    def read(path, *, n_samples, seed) -> Measurements: ...

All modules of the folder are imported when a reader is first looked for, not when the package is. So a reader imports
what is heavy or optional inside of its functions, as RGL's does with Mitsuba.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..system.modules import import_all
from .measurements import Measurements


@dataclass(frozen=True)
class Reader:
    """The function that reads one kind of file, and how such files are known.

    Parameters
    ----------
    kind : str
        What `kind=` names it.
    about : str
        Name of the kind and its files, for messages.
    read : callable
        ``read(path, *, n_samples, seed) -> Measurements``; of a collection ``read(path, index, *, n_samples, seed)``.
    suffixes : tuple of str
        In lower case. They decide where the content says nothing.
    magic : bytes
        How its files begin; nothing if they have no such mark.
    knows : callable, optional
        ``knows(head) -> bool``, asked with the first 4 kB of a file where its beginning is not always the same.
    arrays : tuple of str
        What a ``.npz`` of this kind holds, at least.
    names : callable, optional
        ``names(path) -> list of str``, the materials in a collection; None if a file holds one material.
    function : callable, optional
        ``function(path) -> f``, of a collection ``function(path, index) -> f``: the reflectance ``f(wi, wo)`` between
        the values of the file, (N, 3), >= 0. None if it has none.
    scattered : bool
        The file holds pairs of directions of its own, which `read` returns, and nothing between them.
    """

    kind: str
    about: str
    read: Callable[..., Measurements]
    suffixes: tuple[str, ...] = ()
    magic: bytes = b""
    knows: Callable[[bytes], bool] | None = None
    arrays: tuple[str, ...] = ()
    names: Callable[[str | Path], list[str]] | None = None
    function: Callable[..., Callable[[np.ndarray, np.ndarray], np.ndarray]] | None = None
    scattered: bool = False


_readers: dict[str, Reader] = {}


def reader(kind: str, *, about: str, **how) -> Callable:
    """Register the decorated function as the reader of a kind of file; the arguments are those of :class:`Reader`.

    Examples
    --------
    >>> readers()["merl"].suffixes
    ('.binary',)
    """

    def register(read: Callable[..., Measurements]) -> Callable[..., Measurements]:
        _readers[kind] = Reader(kind, about, read, **how)
        return read

    return register


def readers() -> Mapping[str, Reader]:
    """Return all readers by their kind, in alphabetical order."""
    _import_all()
    return dict(sorted(_readers.items()))


@functools.cache
def _import_all() -> None:
    import_all(__package__, [str(Path(__file__).parent)])
