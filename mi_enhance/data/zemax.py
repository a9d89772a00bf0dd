"""Zemax (OpticStudio, Radiant) BSDF data interchange: text, `.bsdf`, directions relative to the specular one.

Keywords with a value or a counted list: Source, Symmetry (PlaneSymmetrical, Asymmetrical, Asymmetrical4D),
SpectralContent (Monochrome, XYZ), ScatterType (BRDF, BTDF), SampleRotation, AngleOfIncidence, ScatterAzimuth,
ScatterRadial (degrees). Then Monochrome, or TristimulusX, TristimulusY, TristimulusZ; DataBegin; for each rotation and
incidence a word TIS with a number and a row of values (1/sr) for each azimuth; DataEnd.

ScatterRadial is the angle to the specular direction; azimuth 0 points from there to the normal and grows
counter-clockwise. A plane-symmetrical file holds azimuths up to 180 degrees: the other half is added. A file with one
sample rotation is isotropic.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..system.files import require_file
from .measurements import Measurements
from .registry import reader
from .rows import from_rows
from .spectra import to_rgb
from .words import Words

_CONTENTS = {"Monochrome": ("Monochrome",), "XYZ": ("TristimulusX", "TristimulusY", "TristimulusZ")}
_LISTS = ("SampleRotation", "AngleOfIncidence", "ScatterAzimuth", "ScatterRadial")
_SYMMETRIES = ("PlaneSymmetrical", "Asymmetrical", "Asymmetrical4D")


@reader(
    "zemax",
    about="Zemax .bsdf",
    scattered=True,
    knows=lambda head: b"AngleOfIncidence" in head and b"ScatterRadial" in head,
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
        If the file is cut off, transmits (BTDF), or a number or keyword is none.

    References
    ----------
    Rykowski, "BSDF Data Interchange File Format Specification", 2008.

    Examples
    --------
    >>> read("BrownVinyl.bsdf").name  # doctest: +SKIP
    'BrownVinyl'
    """
    where = f'data.load("{path}")'
    words = Words(require_file(path, where), where)
    kinds = {"Symmetry": _SYMMETRIES, "SpectralContent": tuple(_CONTENTS), "ScatterType": ("BRDF", "BTDF")}
    said: dict[str, str] = {}
    lists: dict[str, np.ndarray] = {"SampleRotation": np.zeros(1)}
    word = words.next("a keyword")
    while word not in sum(_CONTENTS.values(), ()) or len(lists) < len(_LISTS):
        if word in kinds:
            said[word] = words.choice(kinds[word], word)
        elif word in _LISTS:
            lists[word] = words.counted(word)
        word = words.keyword("Monochrome or TristimulusX")
    if said.get("ScatterType", "BRDF") != "BRDF":
        raise ValueError(f"{where}: the file holds transmission (BTDF); this package reads reflection.")
    channels = _CONTENTS[said.get("SpectralContent", "Monochrome")]
    rotations, incidences, azimuths, radials = (lists[name] for name in _LISTS)
    shape = (len(rotations), len(incidences), len(azimuths), len(radials))
    f = np.empty((*shape, len(channels)))
    for k, channel in enumerate(channels):
        if k or word != channel:
            _until(words, word if not k else "", channel)
        _until(words, "", "DataBegin")
        for i, j in np.ndindex(shape[:2]):
            _until(words, "", "TIS")
            words.number("the total scatter")
            f[i, j, ..., k] = words.numbers(shape[2] * shape[3], "a value").reshape(shape[2:])
        _until(words, "", "DataEnd")
    rotation, incidence, azimuth, radial = np.deg2rad(
        np.stack(np.meshgrid(rotations, incidences, azimuths, radials, indexing="ij")).reshape(4, -1)
    )
    values = f.reshape(-1, len(channels))
    if said.get("Symmetry") == "PlaneSymmetrical":
        inside = (azimuth > 0) & (azimuth < np.pi - 1e-9)
        rotation, incidence, radial = (np.append(v, v[inside]) for v in (rotation, incidence, radial))
        azimuth, values = np.append(azimuth, -azimuth[inside]), np.append(values, values[inside], axis=0)
    wi, wo = directions(rotation, incidence, azimuth, radial)
    rgb, notes = to_rgb(values, [c[-1] if len(channels) > 1 else c for c in channels], where)
    return from_rows(
        path, wi, wo, rgb, where=where, about="Zemax file", notes=notes, n_samples=n_samples, seed=seed,
        isotropic=len(rotations) == 1,
    )  # fmt: skip


def directions(
    rotation: np.ndarray, incidence: np.ndarray, azimuth: np.ndarray, radial: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the directions of viewer and light (N, 3) of angles in radians.

    Examples
    --------
    >>> wi, wo = directions(*np.deg2rad([[0.0], [30.0], [0.0], [30.0]]))  # from the specular direction to the normal
    >>> (wi + 0.0).round(6).tolist(), wo.round(6).tolist()
    ([[0.0, 0.0, 1.0]], [[-0.5, 0.0, 0.866025]])
    """
    s, c, zero = np.sin(incidence), np.cos(incidence), np.zeros_like(incidence)
    specular, to_normal = np.stack((s, zero, c), 1), np.stack((-c, zero, s), 1)
    side = np.cross(specular, to_normal)
    around = np.cos(azimuth)[:, None] * to_normal + np.sin(azimuth)[:, None] * side
    wi = np.cos(radial)[:, None] * specular + np.sin(radial)[:, None] * around
    wo = np.stack((-s, zero, c), 1)
    cr, sr = np.cos(-rotation), np.sin(-rotation)  # the sample turns, not the light
    turned = [np.stack((cr * w[:, 0] - sr * w[:, 1], sr * w[:, 0] + cr * w[:, 1], w[:, 2]), 1) for w in (wi, wo)]
    return turned[0], turned[1]


def _until(words: Words, word: str, wanted: str) -> None:
    """Skip words up to and with `wanted`."""
    while word != wanted:
        word = words.keyword(wanted)
