"""Find the reader of a measured file."""

from __future__ import annotations

import difflib
import importlib
import zipfile

import numpy as np

from ..system import files, npz, tensor_file

# what `kind=` accepts; each is a module of this package with a function `read`
KINDS = ("rgl", "merl", "nbrdf", "nps", "table")


_COLLECTIONS = ("nbrdf", "nps")  # the kinds whose files hold many materials


def load(path, *, n_samples=100_000, seed=0, material=None, kind=None):
    """Read a measured material of any supported kind.

    Parameters
    ----------
    path : str or Path
        RGL ``.bsdf`` (RGB version), MERL ``.binary``, NBRDF or NPs ``.npz``, or a table ``.csv`` / ``.npz``.
    n_samples : int
        Pairs of directions to draw (paper: 1e5), uniform in the Rusinkiewicz angles. A table gives its own pairs:
        all of them, or `n_samples` rows drawn without replacement where it has more (`source` says so).
    seed : int
        The same seed gives the same samples.
    material : str, optional
        Which one, for a file with several (see `names`).
    kind : {"rgl", "merl", "nbrdf", "nps", "table"}, optional
        The reader, where content and suffix should not decide.

    Returns
    -------
    Measurements

    Raises
    ------
    FileNotFoundError
        If there is no such file, or a file that belongs beside it is missing.
    ValueError
        If the file is damaged, of another kind, or the material is not in it.
    RuntimeError
        For an RGL file, if no variant that can evaluate it is active.

    References
    ----------
    Section 6 of the paper for the sampling.

    Examples
    --------
    >>> m = load("mi_enhance/bundled/nbrdf/merl.npz", material="blue-acrylic", n_samples=1000)
    >>> m.name, len(m.f)
    ('blue-acrylic', 1000)
    """
    where = f'data.load("{path}")'
    path = files.require_file(path, where)
    if isinstance(n_samples, bool) or not isinstance(n_samples, (int, np.integer)) or n_samples < 1:
        raise ValueError(f"{where}: n_samples is {n_samples!r}; it must be a whole number >= 1.")
    kind = _kind(path, where) if kind is None else kind
    if kind not in KINDS:
        raise ValueError(f"{where}: kind is {kind!r}. Choose one of: {', '.join(KINDS)}.{_did_you_mean(kind, KINDS)}")
    reader = _reader(kind)
    if kind not in _COLLECTIONS:
        if material is not None:
            raise ValueError(
                f"{where}: this file holds one material, {material!r} was asked for. Leave out material= (--material)."
            )
        return reader.read(path, n_samples=n_samples, seed=seed)
    index = _choose(reader.names(path), material, where)
    return reader.read(path, index, n_samples=n_samples, seed=seed)


def names(path):
    """List the materials in a file: all of a collection (NBRDF, NPs), else the one name taken from the file name.

    Examples
    --------
    >>> names("mi_enhance/bundled/nbrdf/nielsen.npz")[:3]
    ['bindercover', 'bluebook', 'cardboard']
    """
    where = f'data.names("{path}")'
    path = files.require_file(path, where)
    kind = _kind(path, where)
    if kind in _COLLECTIONS:
        return _reader(kind).names(path)
    return [files.material_name(path)]


def save_table(measurements, path):
    """Write `measurements` as a table that `load` reads back exactly; the suffix, .csv or .npz, decides the form.

    Examples
    --------
    >>> save_table(m, "gold.csv")  # doctest: +SKIP
    """
    from . import table_file

    table_file.write(measurements, path)


def _reader(kind):
    """The module that reads a kind; only RGL needs Mitsuba, so nothing else imports it."""
    return importlib.import_module(f".{'table_file' if kind == 'table' else kind}", __package__)


def _kind(path, where):
    """Name the reader by content, which tells more than the suffix; the suffix helps where content says nothing."""
    with open(path, "rb") as file:
        head = file.read(12)
    suffix = path.suffix.lower()
    if head == tensor_file.MAGIC or suffix == ".bsdf":
        return "rgl"  # the reader tells a measured file from a material of ours, and says so
    if zipfile.is_zipfile(path) or suffix == ".npz":
        return _npz_kind(path, where)
    if suffix == ".binary" or head == np.array([90, 90, 180], "<i4").tobytes():
        return "merl"
    if suffix == ".csv":
        return "table"
    raise ValueError(
        f"{where}: neither content nor suffix {suffix!r} belongs to a known kind of measurement. Known: RGL "
        ".bsdf, MERL .binary, NBRDF and NPs .npz, tables .csv and .npz. If it is one of these, name it "
        f"with kind= ({', '.join(KINDS)})."
    )


def _npz_kind(path, where):
    """Tell the three kinds of .npz apart by the arrays they hold."""
    keys = npz.keys(path, where)
    if {"names", "W1", "W2", "W3"} <= keys:
        return "nbrdf"
    if {"names", "mean"} <= keys:
        return "nps"
    if {"wi", "wo", "f"} <= keys:
        return "table"
    if {"W1", "W7"} <= keys:
        raise ValueError(
            f"{where}: this is the NPs decoder, which belongs to all materials. Give the file of latents "
            "beside it, e.g. merl.npz."
        )
    raise ValueError(
        f"{where}: holds the arrays {sorted(keys)[:12]}. A table needs wi, wo, f; an NBRDF file names, W1, "
        "b1, ...; an NPs file names, mean."
    )


def _choose(available, material, where):
    """Index of `material`; with no name given, the only one."""
    if material is None and len(available) == 1:
        return 0
    some = ", ".join(available[:5]) + (", ..." if len(available) > 5 else "")
    if material is None:
        raise ValueError(
            f"{where}: holds {len(available)} materials ({some}). Say which with material= "
            "(--material); data.names() lists all."
        )
    if material not in available:
        raise ValueError(
            f"{where}: no material {material!r} among {len(available)} ({some})."
            f"{_did_you_mean(material, available)} data.names() lists all."
        )
    return available.index(material)


def _did_you_mean(word, choices):
    """A closing sentence if `word` looks like one of `choices`, else nothing."""
    close = difflib.get_close_matches(str(word), choices, n=3)
    return f" Did you mean {' or '.join(repr(c) for c in close)}?" if close else ""
