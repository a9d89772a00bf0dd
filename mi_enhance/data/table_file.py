"""Tables of one's own measurements: text (``.csv``, ``.tsv``, ``.txt``, ``.dat``) and ``.npz``.

Text: one line of column names, one row per sample, columns in any order:

* directions: ``wi_x, wi_y, wi_z, wo_x, wo_y, wo_z`` (unit vectors) or ``theta_i, phi_i, theta_o, phi_o`` (polar angle
  to the normal, azimuth from +x; radians). The index i is the viewer, o the light, as everywhere in this package;
* reflectance in 1/sr without the cosine: ``f_r, f_g, f_b`` (linear RGB), a single ``f`` (grey), or any number of
  wavelengths in nm, ``f_450nm, f_550nm, ...``, which become linear RGB (``spectra.py``).

Other columns are ignored, and `source` names them. Units may stand behind the names or in a line below:
``theta_i_deg``, ``phi_o [rad]``, ``f (1/sr)``; of all angles or of none. Angles are in degrees if their names say so,
or a comment ("angles in degrees"). Columns are separated by commas, semicolons, tabs or spaces; numbers may have
decimal commas where no comma separates them. Lines that are empty or begin with ``#``, ``%`` or ``//`` are comments; a
header may be one. UTF-8 or UTF-16.

NPZ: the arrays ``wi`` (N, 3), ``wo`` (N, 3), ``f`` (N, 3), or (N,) for grey, or (N, W) beside ``wavelengths`` (W,).

Directions within 1e-3 of unit length are normalized, others are an error. Rows with a direction at or below the
horizon (z <= 0), where f is 0 by definition and teaches nothing, are dropped, and `source` says how many.
"""

from __future__ import annotations

import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from ..system import npz
from ..system.checks import UNIT_TOLERANCE
from ..system.files import replacing, require_file
from .measurements import Measurements
from .registry import reader
from .rows import from_rows
from .spectra import to_rgb
from .table_header import ANGLES, GREY, RGB, VECTORS, wavelength
from .text_table import TextTable, read_text

_EXACT = 1e-6  # float32 rounding: such vectors are kept bit by bit
_Place = Callable[[int], str]


@reader(
    "table",
    about="tables .csv, .tsv, .txt, .dat and .npz",
    suffixes=(".csv", ".tsv", ".txt", ".dat"),
    arrays=("wi", "wo", "f"),
    scattered=True,
)
def read(path: str | Path, *, n_samples: int = 100_000, seed: int = 0) -> Measurements:
    r"""Read a table; columns and rules are in the head of this module.

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
        If a column is missing or in an unknown unit, a line is no row of numbers, a value is not finite, an angle
        beyond what its unit allows, or a direction not of unit length.

    Warns
    -----
    UserWarning
        If more than half of the rows lie below the horizon.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "grey.csv"
    >>> _ = path.write_text("# a goniometer's\ntheta_i_deg;phi_i_deg;theta_o_deg;phi_o_deg;f\n0;0;60;90;0,25\n")
    >>> m = read(path)
    >>> m.wo.round(3).tolist(), m.f.tolist()
    ([[0.0, 0.8659999966621399, 0.5]], [[0.25, 0.25, 0.25]])
    """
    where = f'data.load("{path}")'
    file = require_file(path, where)
    is_npz = file.suffix.lower() == ".npz" or zipfile.is_zipfile(file)
    wi, wo, f, notes, place = (_read_npz if is_npz else _read_text)(file, where)
    wi, wo = _unit(wi, "wi", place, where), _unit(wo, "wo", place, where)
    return from_rows(path, wi, wo, f, where=where, about="table", notes=notes, n_samples=n_samples, seed=seed)


def write(measurements: Measurements, path: str | Path) -> None:
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
                header=",".join(VECTORS + RGB),
                comments="",
            )


def _read_text(path: Path, where: str) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[str], _Place]:
    """Return wi, wo, f in float64, what was ignored, and what names the place of a row."""
    table = read_text(path, where)
    column, place = table.columns, lambda i: f"line {table.lines[i]}"
    for name, values in column.items():
        _finite(values[:, None], [name], place, where)
    ignored = [n for n in table.header.names if n and n not in column]
    notes = [f"columns ignored: {', '.join(ignored)[:200]}"] if ignored else []
    if RGB[0] in column or GREY[0] in column:
        f = np.stack([column[c] for c in (RGB if RGB[0] in column else GREY * 3)], 1)
    else:
        bands = [n for n in column if wavelength(n) is not None]
        f, more = to_rgb(np.stack([column[n] for n in bands], 1), [f"{wavelength(n):g}nm" for n in bands], where)
        notes += more
    if VECTORS[0] in column:
        v = np.stack([column[c] for c in VECTORS], 1)
        return v[:, :3], v[:, 3:], f, notes, place
    angles = _radians(table, where)
    wi, wo = (_from_angles(angles[f"theta_{k}"], angles[f"phi_{k}"]) for k in "io")
    return wi, wo, f, notes, place


def _radians(table: TextTable, where: str) -> dict[str, np.ndarray]:
    """Return the angles of a table in radians, or say which cannot be in the unit the file has."""
    result = {}
    for name in ANGLES:
        values, header = table.columns[name], table.header
        said = header.units.get(name, "deg" if header.comments_say_degrees else "")
        if not said and any(n in header.units for n in ANGLES):
            raise ValueError(
                f"{where}: column {name} names no unit, and other angles do. Name the unit of each: theta_i_deg or "
                "theta_i_rad, and so on."
            )
        # A polar angle ends at pi. Azimuths may be written on beyond a turn, but not far.
        turn = 360 if said == "deg" else 2 * np.pi
        most = turn / 2 if name.startswith("theta") else 2 * turn
        beyond = np.abs(values) > most * (1 + 1e-6)  # 1e-6: digits that the file rounded
        if beyond.any():
            i = int(np.argmax(beyond))
            unit = "degrees, as the file says" if said == "deg" else "radians"
            advice = (
                "Correct the unit."
                if said == "deg"
                else "If the table is in degrees, name the columns theta_i_deg, phi_i_deg, theta_o_deg, phi_o_deg."
            )
            raise ValueError(
                f"{where}: {name} in line {table.lines[i]} is {values[i]:.6g}, and {int(beyond.sum()) - 1} more are "
                f"beyond {most:.4g}: that is no angle in {unit}. {advice}"
            )
        result[name] = np.deg2rad(values) if said == "deg" else values
    if table.header.comments_say_degrees and not table.header.units:
        polar = max(np.abs(table.columns[n]).max() for n in ("theta_i", "theta_o"))
        if polar <= np.pi / 2:
            raise ValueError(
                f"{where}: a comment speaks of degrees, but all polar angles are at most {polar:.4g}, as radians are. "
                "Name the unit in the columns: theta_i_deg or theta_i_rad, and so on."
            )
    return result


def _read_npz(path: Path, where: str) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[str], _Place]:
    """Return what `_read_text` does."""
    spectral = "wavelengths" in npz.keys(path, where)
    arrays = npz.read(path, ["wi", "wo", "f", *(["wavelengths"] if spectral else [])], where)
    n = len(arrays["wi"]) if arrays["wi"].ndim else 0
    place = lambda i: f"row {i + 1}"  # noqa: E731
    bands = arrays["wavelengths"] if spectral else None
    of_f = [(n, 3), (n,), (n, 1)] if bands is None else [(n, bands.size)]
    for key, shapes in (("wi", [(n, 3)]), ("wo", [(n, 3)]), ("f", of_f)):
        a = arrays[key]
        if a.dtype.kind not in "fiu" or a.shape not in shapes or n == 0:
            spectrum = "" if bands is None else f"; beside {bands.size} wavelengths (N, {bands.size})"
            raise ValueError(
                f"{where}: {key} is {a.dtype} with shape {a.shape}; wi and wo must be numbers (N, 3), f (N, 3) or, for "
                f"grey, (N,){spectrum}, with the same N of at least 1. wi has N = {n}."
            )
        with np.errstate(over="ignore"):
            arrays[key] = a.astype(np.float64).reshape(n, -1)
        _finite(arrays[key], [f"{key}[{k}]" for k in range(arrays[key].shape[1])], place, where)
    if bands is None:
        return arrays["wi"], arrays["wo"], np.broadcast_to(arrays["f"], (n, 3)), [], place
    if bands.dtype.kind not in "fiu" or bands.ndim != 1:
        raise ValueError(f"{where}: wavelengths is {bands.dtype} with shape {bands.shape}; it must be numbers (W,).")
    f, notes = to_rgb(arrays["f"], [f"{nm}nm" for nm in bands.tolist()], where)
    return arrays["wi"], arrays["wo"], f, notes, place


def _finite(rows: np.ndarray, columns: list[str], place: _Place, where: str) -> None:
    """Raise for the first NaN, infinity, or number that float32 cannot hold, in the words of the file."""
    bad = np.argwhere(~(np.abs(rows) <= np.finfo(np.float32).max))
    if len(bad):
        i, j = bad[0]
        raise ValueError(
            f"{where}: {place(i)} has {rows[i, j]} in column {columns[j]}, and {len(bad) - 1} more values are not "
            "finite. Remove these rows."
        )


def _from_angles(theta: np.ndarray, phi: np.ndarray) -> np.ndarray:
    return np.stack((np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)), 1)


def _unit(v: np.ndarray, key: str, place: _Place, where: str) -> np.ndarray:
    """Normalize what is nearly normal; keep what already is."""
    with np.errstate(over="ignore"):
        length = np.linalg.norm(v, axis=1)
    bad = ~(np.abs(length - 1) <= UNIT_TOLERANCE)
    if bad.any():
        i = int(np.argmax(bad))
        raise ValueError(
            f"{where}: {key} in {place(i)} has length {length[i]:.6g}, not 1 (within {UNIT_TOLERANCE}); "
            f"{int(bad.sum())} rows are like this. Normalize the directions first."
        )
    return np.where((np.abs(length - 1) > _EXACT)[:, None], v / length[:, None], v)
