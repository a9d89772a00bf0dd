"""ALTA's text files: a header of ``#`` lines, then angles and values.

``#DIM nx ny``: columns of the angles and of the values; further columns (confidence, ``#VS``) are ignored.
``#PARAM_IN``: which angles; those below are known, in radians. ``#PARAM_OUT``: INV_STERADIAN (1/sr),
INV_STERADIAN_COSINE_FACTOR (1/sr times the cosine of the viewer, which is divided out), RGB_COLOR, XYZ_COLOR. Without
PARAM_OUT the values count as 1/sr; of the two retro-reflective tapes that the package is tested with one lacks it and
falls with the cosine all the same: add the line.

A parameterization that says nothing about the azimuth of the pair as a whole is isotropic.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from ..system.files import require_file
from ..system.messages import did_you_mean, shortened
from .directions import direction, rusinkiewicz_to_directions
from .measurements import Measurements
from .registry import reader
from .rows import finite, from_rows
from .spectra import to_rgb
from .words import read_lines

_Pair = tuple[np.ndarray, np.ndarray]
_MIN_COS = 1e-3  # beyond 89.94 degrees the cosine is not divided out: 0 / 0 at the horizon
_OUT = ("INV_STERADIAN", "INV_STERADIAN_COSINE_FACTOR", "RGB_COLOR", "XYZ_COLOR")


def _projected(theta_l: np.ndarray, x: np.ndarray, y: np.ndarray) -> _Pair:
    return direction(np.hypot(x, y), np.arctan2(y, x)), direction(theta_l, 0 * theta_l)


def _around_retro(theta_l: np.ndarray, x: np.ndarray, y: np.ndarray) -> _Pair:
    w, light = direction(np.hypot(x, y), np.arctan2(y, x)), direction(theta_l, 0 * theta_l)
    c, s = np.cos(theta_l), np.sin(theta_l)
    return np.stack((c * w[:, 0] + s * w[:, 2], w[:, 1], -s * w[:, 0] + c * w[:, 2]), 1), light


def _cartesian(*v: np.ndarray) -> _Pair:
    pair = np.stack(v[:3], 1), np.stack(v[3:], 1)
    with np.errstate(invalid="ignore", divide="ignore"):  # a vector of length 0 is refused with what is not finite
        return pair[0] / np.linalg.norm(pair[0], axis=1)[:, None], pair[1] / np.linalg.norm(pair[1], axis=1)[:, None]


# parameterization: columns, viewer and light of them, whether it is isotropic
_IN: dict[str, tuple[int, Callable[..., _Pair], bool]] = {
    "ISOTROPIC_TL_TV_PROJ_DPHI": (3, _projected, True),
    "RETRO_TL_TVL_PROJ_DPHI": (3, _around_retro, True),
    "ISOTROPIC_TV_TL_DPHI": (3, lambda tv, tl, dphi: (direction(tv, 0 * tv), direction(tl, dphi)), True),
    "SPHERICAL_TL_PL_TV_PV": (4, lambda tl, pl, tv, pv: (direction(tv, pv), direction(tl, pl)), False),
    "RUSIN_TH_PH_TD_PD": (4, rusinkiewicz_to_directions, False),
    "RUSIN_TH_TD_PD": (3, lambda th, td, pd: rusinkiewicz_to_directions(th, 0.0, td, pd), True),
    "CARTESIAN": (6, _cartesian, False),
}


@reader(
    "alta", about="ALTA .dat and .alta", suffixes=(".alta",), scattered=True, knows=lambda head: b"#PARAM_IN" in head
)
def read(path: str | Path, *, n_samples: int = 100_000, seed: int = 0) -> Measurements:
    """Return the measured pairs of directions.

    Parameters
    ----------
    path : str or Path
    n_samples, seed : int
        As for `mi_enhance.data.loading.load`.

    Raises
    ------
    ValueError
        If the header lacks an entry, names a parameterization that is not known, or a line is no row of numbers.

    References
    ----------
    Belcour, Barla, Pacanowski, "ALTA: A BRDF Analysis Library", 2014.

    Examples
    --------
    >>> read("retro-3M-jaune.dat").name  # doctest: +SKIP
    'retro-3M-jaune'
    """
    where = f'data.load("{path}")'
    file = require_file(path, where)
    header, rows, at = _read(file, where)
    name = header.get("PARAM_IN", "")
    if name not in _IN:
        raise ValueError(
            f"{where}: #PARAM_IN is {shortened(name)}; known are {', '.join(_IN)}.{did_you_mean(name, _IN)}"
        )
    n_in, to_directions, isotropic = _IN[name]
    n_out = _dimensions(header, n_in, where)
    if rows.shape[1] < n_in + n_out:
        raise ValueError(f"{where}: rows have {rows.shape[1]} columns, #DIM asks for {n_in} + {n_out}.")
    finite(rows[:, : n_in + n_out], where, at)
    largest = np.abs(rows[:, :n_in]).max()
    if name != "CARTESIAN" and largest > 4 * np.pi:
        raise ValueError(f"{where}: the largest angle is {largest:g}; ALTA's are in radians. Convert degrees first.")
    wi, wo = to_directions(*rows[:, :n_in].T)
    finite(np.hstack((wi, wo)), where, at)
    out = header.get("PARAM_OUT", "")
    if out and out not in _OUT:
        raise ValueError(f"{where}: #PARAM_OUT is {shortened(out)}; known are {', '.join(_OUT)}.")
    f, notes = rows[:, n_in : n_in + n_out], []
    if out == "INV_STERADIAN_COSINE_FACTOR":
        keep = wi[:, 2] > _MIN_COS
        wi, wo, f = wi[keep], wo[keep], f[keep]
        if not keep.any():
            raise ValueError(f"{where}: every viewer is at the horizon, where nothing is left of value times cosine.")
        f = f / wi[:, 2:]
        notes.append(f"cosine of the viewer divided out; {np.sum(~keep)} rows at the horizon dropped")
    elif not out:
        notes.append("no PARAM_OUT: values taken as 1/sr")
    channels = {1: ["f"], 3: list("XYZ" if out == "XYZ_COLOR" else "RGB")}[n_out]
    f, more = to_rgb(f, channels, where)
    return from_rows(
        path, wi, wo, f, where=where, about="ALTA file", notes=notes + more, n_samples=n_samples, seed=seed,
        isotropic=isotropic,
    )  # fmt: skip


def _read(path: Path, where: str) -> tuple[dict[str, str], np.ndarray, np.ndarray]:
    """Return the header, the numbers, and the line of each row."""
    header: dict[str, str] = {}
    rows, at = [], []
    for k, line in enumerate(read_lines(path, where), 1):
        words = line.split()
        if not words:
            continue
        if line.startswith("#"):
            header[words[0].lstrip("#")] = " ".join(words[1:])
            continue
        try:
            rows.append([float(w) for w in words])
        except ValueError:
            rows.append([])
        if not rows[-1] or len(rows[-1]) != len(rows[0]):
            raise ValueError(
                f"{where}: line {k} is {shortened(line.strip())}; expected are {len(rows[0]) or 'some'} numbers."
            )
        at.append(k)
    if not rows:
        raise ValueError(f"{where}: no numbers below the header.")
    return header, np.array(rows), np.array(at)


def _dimensions(header: dict[str, str], n_in: int, where: str) -> int:
    """Return how many values a row has; 1 and 3 can be read."""
    words = header.get("DIM", "").split()
    if len(words) != 2 or words[0] != str(n_in) or words[1] not in ("1", "3"):
        raise ValueError(
            f'{where}: #DIM is "{header.get("DIM", "")[:40]}"; {header["PARAM_IN"]} has {n_in} angles, and values of 1 '
            f'or 3 channels can be read: "{n_in} 1" or "{n_in} 3".'
        )
    return int(words[1])
