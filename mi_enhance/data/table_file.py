"""Tables of one's own measurements: `.csv` and `.npz`.

CSV: one header line, one row per sample, columns in any order:

* directions: ``wi_x, wi_y, wi_z, wo_x, wo_y, wo_z`` (unit vectors) or ``theta_i, phi_i, theta_o, phi_o`` (radians). The
  index i is the viewer, o the light, as everywhere in this package;
* reflectance: ``f_r, f_g, f_b`` or, for grey, a single ``f``: f_r in 1/sr without the cosine, linear RGB.

NPZ: the arrays ``wi`` (N, 3), ``wo`` (N, 3), ``f`` (N, 3).

Directions within 1e-3 of unit length are normalized, others are an error. Rows with a direction at or below the
horizon (z <= 0), where f is 0 by definition and teaches nothing, are dropped, and `source` says how many.
"""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np

from ..system import npz
from ..system.files import material_name, replacing, require_file
from .measurements import Measurements, clamp_negative

_VECTORS = ("wi_x", "wi_y", "wi_z", "wo_x", "wo_y", "wo_z")
_ANGLES = ("theta_i", "phi_i", "theta_o", "phi_o")
_RGB, _GREY = ("f_r", "f_g", "f_b"), ("f",)
_UNIT_TOLERANCE = 1e-3  # three decimals; more is a mistake of the file
_EXACT = 1e-6  # float32 rounding: such vectors are kept bit by bit


def read(path, *, n_samples=100_000, seed=0):
    """Read a table; columns and rules are in the head of this module.

    Parameters
    ----------
    path : str or Path
    n_samples : int
        At most this many rows, drawn without replacement if the table has more.
    seed : int

    Returns
    -------
    Measurements

    Raises
    ------
    ValueError
        If a column is missing or unknown, a value is not finite, or a direction not of unit length.
    """
    where = f'data.load("{path}")'
    path = require_file(path, where)
    wi, wo, f = _read_npz(path, where) if path.suffix.lower() == ".npz" else _read_csv(path, where)
    wi, wo = _unit(wi, "wi", where), _unit(wo, "wo", where)
    above = (wi[:, 2] > 0) & (wo[:, 2] > 0)
    if not above.any():
        raise ValueError(
            f"{where}: no row has both directions above the horizon (z > 0). Is the normal +z in this table?"
        )
    notes = [f"{np.sum(~above)} rows below the horizon dropped"] if not above.all() else []
    rows = np.flatnonzero(above)
    if len(rows) > n_samples:
        notes.append(f"{n_samples} of {len(rows)} rows drawn")
        rows = np.sort(np.random.default_rng(seed).choice(rows, n_samples, replace=False))
    f, clamped_fraction = clamp_negative(f[rows])
    source = "; ".join([f"table {path}", *notes])
    return Measurements(wi[rows], wo[rows], f, material_name(path), source, clamped_fraction)


def write(measurements, path):
    """Write a table that `read` gives back exactly; see `mi_enhance.data.loading.save_table`."""
    suffix = Path(path).suffix.lower()
    if suffix not in (".csv", ".npz"):
        raise ValueError(f'data.save_table("{path}"): the suffix is {suffix!r}; write .csv or .npz.')
    m = measurements
    with replacing(path) as temporary:
        if suffix == ".npz":
            np.savez_compressed(temporary, wi=m.wi, wo=m.wo, f=m.f)
        else:  # nine digits bring every float32 back
            np.savetxt(
                temporary,
                np.hstack((m.wi, m.wo, m.f)),
                fmt="%.9g",
                delimiter=",",
                header=",".join(_VECTORS + _RGB),
                comments="",
            )


def _read_csv(path, where):
    """wi, wo, f in float64 out of a CSV."""
    try:
        with open(path, encoding="utf-8-sig") as file:  # spreadsheets put a byte-order mark in front
            header = [c.strip().strip('"') for c in file.readline().split(",")]
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # "no data" is an error of ours below
                rows = np.loadtxt(file, delimiter=",", ndmin=2, dtype=np.float64)
    except ValueError as error:  # a word or an empty cell, rows of unequal length, bytes that are no text
        raise ValueError(
            f"{where}: not a table of numbers below one header line: {error} (rows are counted without the header)."
        ) from error
    directions = _VECTORS if set(_VECTORS) <= set(header) else _ANGLES
    colours = _RGB if set(_RGB) <= set(header) else _GREY
    if sorted(header) != sorted(directions + colours):
        raise ValueError(
            f"{where}: the columns are {', '.join(header)[:200]}. Needed: {', '.join(_VECTORS)} or "
            f"{', '.join(_ANGLES)} (radians); and f_r, f_g, f_b or f. Nothing else."
        )
    if rows.shape[0] == 0 or rows.shape[1] != len(header):
        raise ValueError(f"{where}: {rows.shape[0]} rows of {rows.shape[1]} numbers under {len(header)} column names.")
    column = dict(zip(header, rows.T, strict=True))
    _finite(rows, header, where)
    f = np.stack([column[c] for c in colours], 1)
    if directions is _VECTORS:
        v = np.stack([column[c] for c in _VECTORS], 1)
        return v[:, :3], v[:, 3:], np.broadcast_to(f, (len(f), 3))
    wi, wo = (_from_angles(column[f"theta_{k}"], column[f"phi_{k}"]) for k in "io")
    return wi, wo, np.broadcast_to(f, (len(f), 3))


def _read_npz(path, where):
    """wi, wo, f in float64 out of an NPZ."""
    arrays = npz.read(path, ["wi", "wo", "f"], where)
    for k, a in arrays.items():
        if a.dtype.kind not in "fiu" or a.ndim != 2 or a.shape[1] != 3 or a.shape != arrays["f"].shape or len(a) == 0:
            raise ValueError(
                f"{where}: {k} is {a.dtype} with shape {a.shape}; wi, wo and f must be numbers, all (N, 3)."
            )
        with np.errstate(over="ignore"):
            arrays[k] = a.astype(np.float64)
        _finite(arrays[k], [f"{k}[0]", f"{k}[1]", f"{k}[2]"], where)
    return arrays["wi"], arrays["wo"], arrays["f"]


def _finite(rows, columns, where):
    """Raise for the first NaN or infinity, in the words of the file."""
    bad = np.argwhere(~np.isfinite(rows))
    if len(bad):
        i, j = bad[0]
        raise ValueError(
            f"{where}: row {i + 1} (counted without the header) has {rows[i, j]} in column {columns[j]}, and "
            f"{len(bad) - 1} more values are not finite. Remove these rows."
        )


def _from_angles(theta, phi):
    return np.stack((np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)), 1)


def _unit(v, key, where):
    """Normalize what is nearly normal; keep what already is."""
    with np.errstate(over="ignore"):
        length = np.linalg.norm(v, axis=1)
    bad = ~(np.abs(length - 1) <= _UNIT_TOLERANCE)
    if bad.any():
        i = int(np.argmax(bad))
        raise ValueError(
            f"{where}: {key} in row {i + 1} has length {length[i]:.6g}, not 1 (within {_UNIT_TOLERANCE}); "
            f"{int(bad.sum())} rows are like this. Normalize the directions first."
        )
    return np.where((np.abs(length - 1) > _EXACT)[:, None], v / length[:, None], v)
