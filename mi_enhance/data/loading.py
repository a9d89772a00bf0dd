"""Find the reader of a measured file."""

from __future__ import annotations

import zipfile
from pathlib import Path

from ..system import files, npz
from ..system.checks import positive_int
from ..system.messages import did_you_mean
from .measurements import Measurements
from .registry import Reader, readers

_HEAD = 1 << 16  # bytes by which a reader may know its files


def load(
    path: str | Path,
    *,
    n_samples: int = 100_000,
    seed: int = 0,
    material: str | None = None,
    kind: str | None = None,
) -> Measurements:
    """Read a measured material of any supported kind.

    Parameters
    ----------
    path : str or Path
        A file of any kind that :func:`mi_enhance.data.registry.readers` lists; docs/files.md says what each holds.
    n_samples : int
        Pairs of directions to draw (paper: 1e5), uniform in the Rusinkiewicz angles. A table gives its own pairs:
        all of them, or `n_samples` rows drawn without replacement where it has more (`source` says so).
    seed : int
        The same seed gives the same samples.
    material : str, optional
        Name of the material, for a file with several (see `names`).
    kind : str, optional
        The reader, such as ``"merl"`` or ``"utia"``, where content and suffix should not decide.

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
    file = files.require_file(path, where)
    n_samples = positive_int(n_samples, "n_samples", where)
    if kind is not None and kind not in readers():
        raise ValueError(
            f"{where}: kind is {kind!r}. Choose one of: {', '.join(readers())}.{did_you_mean(kind, readers())}"
        )
    found = recognized(file, where) if kind is None else readers()[kind]
    if found.names is not None:
        index = choose(found.names(path), material, where)
        return found.read(path, index, n_samples=n_samples, seed=seed)
    if material is not None:
        raise ValueError(
            f"{where}: this file holds one material, {material!r} was asked for. Leave out material= (--material)."
        )
    return found.read(path, n_samples=n_samples, seed=seed)


def kind_of(path: str | Path) -> str:
    """Return the kind of a measured file, the name of its reader.

    Examples
    --------
    >>> kind_of("mi_enhance/bundled/nbrdf/merl.npz")
    'nbrdf'
    """
    where = f'data.kind_of("{path}")'
    return recognized(files.require_file(path, where), where).kind


def is_scattered(path: str | Path) -> bool:
    """Tell whether a file holds pairs of directions of its own, as tables do, and no rule for what lies between them.

    Examples
    --------
    >>> is_scattered("mi_enhance/bundled/nbrdf/merl.npz")
    False
    """
    where = f'data.load("{path}")'  # who asks this loads it next
    return recognized(files.require_file(path, where), where).scattered


def names(path: str | Path) -> list[str]:
    """List the materials in a file: all of a collection (NBRDF, NPs), else the one name taken from the file name.

    Examples
    --------
    >>> names("mi_enhance/bundled/nbrdf/nielsen.npz")[:3]
    ['bindercover', 'bluebook', 'cardboard']
    """
    where = f'data.names("{path}")'
    found = recognized(files.require_file(path, where), where)
    return [files.material_name(path)] if found.names is None else found.names(path)


def save_table(measurements: Measurements, path: str | Path) -> None:
    """Write `measurements` as a table that `load` reads back exactly; the suffix, .csv or .npz, decides the form.

    Examples
    --------
    >>> save_table(m, "gold.csv")  # doctest: +SKIP
    """
    from . import table_file

    table_file.write(measurements, path)


def recognized(path: Path, where: str) -> Reader:
    """Return the reader of a file by its content, which tells more than the suffix; then by its suffix.

    Errors begin with `where`.
    """
    with open(path, "rb") as file:
        head = file.read(_HEAD)
    suffix = path.suffix.lower()
    for one in readers().values():
        if (one.magic and head.startswith(one.magic)) or (one.knows is not None and one.knows(head)):
            return one
    if suffix == ".npz" or zipfile.is_zipfile(path):
        return _with_arrays(npz.keys(path, where), where)
    for one in readers().values():
        if suffix in one.suffixes:
            return one
    raise ValueError(
        f"{where}: neither content nor suffix {suffix!r} belongs to a known kind of measurement. Known are: "
        f"{'; '.join(r.about for r in readers().values())}. If it is one of these, name it in Python, with kind= "
        f"({', '.join(readers())})."
    )


def _with_arrays(held: set[str], where: str) -> Reader:
    """Return the reader of a .npz by the arrays it holds."""
    kinds = [r for r in readers().values() if r.arrays]
    for one in kinds:
        if set(one.arrays) <= held:
            return one
    needed = "; ".join(f"{r.about}: {', '.join(r.arrays)}" for r in kinds)
    raise ValueError(f"{where}: holds the arrays {', '.join(sorted(held)[:12])[:200]}. Needed are, at least, {needed}.")


def choose(available: list[str], material: str | None, where: str) -> int:
    """Return the index of `material`; with no name given, that of the only one."""
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
            f"{did_you_mean(material, available)} data.names() lists all."
        )
    return available.index(material)
