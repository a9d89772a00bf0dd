"""Measured reflectance in, one record out: `load` finds the reader, `Measurements` is what every fit takes.

One reader per file beside this one; each turns "light" and "view" of its source into `wo` and `wi` (DESIGN.md,
section 3) and draws its pairs of directions as section 6 of the paper does (`sampling.py`).
"""

from __future__ import annotations

import difflib
import importlib
import zipfile
from dataclasses import dataclass, field

import numpy as np

from ..system import files
from ..system import npz
from ..system import tensor_file

__all__ = ["KINDS", "Measurements", "clamp_negative", "load", "names", "save_table"]

# what `kind=` accepts; each is a module of this package with a function `read`
KINDS = ("rgl", "merl", "nbrdf", "nps", "table")

_COLLECTIONS = ("nbrdf", "nps")  # the kinds whose files hold many materials
_UNIT_TOLERANCE = 1e-3  # directions may be off unit length by this much: float32 and short decimals, not mistakes


@dataclass(frozen=True, eq=False)
class Measurements:
    """N samples of one BRDF: pairs of directions and the reflectance measured there.

    Parameters
    ----------
    wi, wo : array (N, 3)
        Unit vectors towards the viewer and towards the light, above the horizon (z > 0). Kept as float32.
    f : array (N, 3)
        Reflectance f_r in 1/sr without the cosine, linear RGB, >= 0. Kept as float32.
    name : str
        The material.
    source : str
        One line: which reader, which file, what was left out.
    clamped_fraction : float
        Share of the 3 N values that were negative in the source and are 0 here.

    Raises
    ------
    ValueError
        If a shape, a value or a direction is not as above; the message names the first bad sample.

    Examples
    --------
    >>> m = Measurements([[0, 0, 1]], [[0, 0.6, 0.8]], [[0.1, 0.2, 0.3]], "paper", "by hand")
    >>> m
    Measurements(name='paper', source='by hand', clamped_fraction=0.0)
    >>> m.f.shape
    (1, 3)
    """

    wi: np.ndarray = field(repr=False)
    wo: np.ndarray = field(repr=False)
    f: np.ndarray = field(repr=False)
    name: str = "unnamed"
    source: str = ""
    clamped_fraction: float = 0.0

    def __post_init__(self):
        with np.errstate(over="ignore"):  # a float64 beyond the float32 range becomes inf, which is refused below
            for key in ("wi", "wo", "f"):
                object.__setattr__(self, key, np.ascontiguousarray(getattr(self, key), dtype=np.float32))
        where = f'Measurements("{self.name}")'
        shapes = self.wi.shape, self.wo.shape, self.f.shape
        if len(set(shapes)) > 1 or self.f.ndim != 2 or self.f.shape[1] != 3:
            raise ValueError(f"{where}: wi, wo and f have shapes {shapes}; all three must be (N, 3).")
        if len(self.f) == 0:
            raise ValueError(f"{where}: no sample at all; at least one is needed.")
        for key in ("wi", "wo", "f"):
            _refuse(where, key, getattr(self, key), ~np.isfinite(getattr(self, key)).all(1), "must be finite")
        for key in ("wi", "wo"):
            a = getattr(self, key)
            length_error = np.abs(np.linalg.norm(a.astype(np.float64), axis=1) - 1)
            _refuse(where, key, a, length_error > _UNIT_TOLERANCE, "must have length 1")
            _refuse(where, key, a, a[:, 2] <= 0, "must be above the horizon (z > 0); leave this sample out")
        _refuse(where, "f", self.f, (self.f < 0).any(1), "must be >= 0; clamp it and say so in clamped_fraction")
        if not 0 <= self.clamped_fraction <= 1:
            raise ValueError(f"{where}: clamped_fraction is {self.clamped_fraction}; it is a share, in [0, 1].")


def _refuse(where, key, a, bad, rule):
    """Raise for the first sample marked in `bad`."""
    if bad.any():
        k = int(np.argmax(bad))
        raise ValueError(f"{where}: {key}[{k}] is {a[k].tolist()}; it {rule}. {int(bad.sum())} samples are like this.")


def clamp_negative(f):
    """Set negative values to 0 and return (f, share of the values that were negative); NaN and inf stay."""
    negative = (f < 0) & np.isfinite(f)
    return np.where(negative, 0, f), float(negative.mean()) if f.size else 0.0


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
    >>> m = load("data/nbrdf/merl.npz", material="blue-acrylic", n_samples=1000)
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
    reader = importlib.import_module(f".{kind}", __name__)  # only RGL needs Mitsuba: nothing else imports it
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
    >>> names("data/nbrdf/nielsen.npz")[:3]
    ['bindercover', 'bluebook', 'cardboard']
    """
    where = f'data.names("{path}")'
    path = files.require_file(path, where)
    kind = _kind(path, where)
    if kind in _COLLECTIONS:
        return importlib.import_module(f".{kind}", __name__).names(path)
    return [files.material_name(path)]


def save_table(measurements, path):
    """Write `measurements` as a table that `load` reads back exactly; the suffix, .csv or .npz, decides the form.

    Examples
    --------
    >>> save_table(m, "gold.csv")  # doctest: +SKIP
    """
    from . import table

    table.write(measurements, path)


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
