"""LightTools BSDF: text, `.bsdf`, a block of values for each incidence.

Keywords with a value or a counted list: Symmetry (Asymmetric), SpectralContent (Monochrome, XYZ), ScatterAzimuth,
ScatterRadial (degrees); DataBegin; then blocks of AOI and POI (angle and plane of incidence, degrees), Side (Front,
Back), Wavelength, ScatterType (BRDF, BTDF), TristimulusValue (TrisX, TrisY, TrisZ), and TIS with a number and a value
(1/sr) for each azimuth and radial angle, the latter faster; DataEnd.

ScatterRadial is the angle to the normal. The plane of incidence lies at azimuth 90 degrees + POI. Reflection from the
front is read; blocks of other sides are left out. Several wavelengths are a spectrum. With one POI the file is
isotropic.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from ..system.files import require_file
from .directions import direction
from .measurements import Measurements
from .registry import reader
from .rows import from_rows
from .spectra import to_rgb
from .words import Words

_AOI = re.compile(rb"^\s*AOI\b", re.MULTILINE)  # no comment
_TRISTIMULUS = ("TrisX", "TrisY", "TrisZ")


@reader(
    "lighttools",
    about="LightTools .bsdf",
    scattered=True,
    knows=lambda head: b"ScatterRadial" in head and bool(_AOI.search(head)),
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
        If the file is cut off, holds no reflection from the front, or channels of an incidence are missing.

    References
    ----------
    The format as the optics libraries that read it describe it; no specification is public.

    Examples
    --------
    >>> read("paint.bsdf").name  # doctest: +SKIP
    'paint'
    """
    where = f'data.load("{path}")'
    words = Words(require_file(path, where), where)
    lists: dict[str, np.ndarray] = {}
    word = words.next("a keyword")
    while word != "DataBegin":
        if word in ("ScatterAzimuth", "ScatterRadial"):
            lists[word] = words.counted(word)
        elif word == "Symmetry":
            words.choice(("Asymmetric", "Asymmetrical"), word)
        elif word == "SpectralContent":
            words.choice(("Monochrome", "XYZ"), word)
        word = words.keyword("DataBegin")
    if len(lists) < 2:
        raise ValueError(f"{where}: ScatterAzimuth and ScatterRadial must stand before DataBegin.")
    blocks = _blocks(words, len(lists["ScatterAzimuth"]) * len(lists["ScatterRadial"]))
    if not blocks:
        raise ValueError(f"{where}: no block is a reflection (BRDF) from the front.")
    channels = sorted({c for of in blocks.values() for c in of})
    for (aoi, poi), of in blocks.items():
        if sorted(of) != channels:
            raise ValueError(
                f"{where}: the block of AOI {aoi:g}, POI {poi:g} has the channels {', '.join(sorted(of))}; others have "
                f"{', '.join(channels)}."
            )
    azimuth, radial = np.deg2rad(
        np.stack(np.meshgrid(lists["ScatterAzimuth"], lists["ScatterRadial"], indexing="ij")).reshape(2, -1)
    )
    wi = np.tile(direction(radial, azimuth), (len(blocks), 1))
    lights = [direction(np.deg2rad(aoi), np.deg2rad(90 + poi)) for aoi, poi in blocks]
    wo = np.repeat(np.array(lights), len(azimuth), axis=0)
    f = np.concatenate([np.stack([of[c] for c in channels], 1) for of in blocks.values()])
    f, notes = to_rgb(f, [c.removeprefix("Tris") for c in channels], where)
    return from_rows(
        path, wi, wo, f, where=where, about="LightTools file", notes=notes, n_samples=n_samples, seed=seed,
        isotropic=len({poi for _, poi in blocks}) == 1,
    )  # fmt: skip


def _blocks(words: Words, n: int) -> dict[tuple[float, float], dict[str, np.ndarray]]:
    """Return the values of each incidence (AOI, POI), by channel."""
    result: dict[tuple[float, float], dict[str, np.ndarray]] = {}
    now, named = _empty(), None
    while (word := words.keyword("DataEnd")) != "DataEnd":
        if word in ("AOI", "POI", "Wavelength"):
            now[word] = words.number(word)
        elif word == "Side":
            now[word] = words.choice(("Front", "Back"), word)
        elif word == "ScatterType":
            now[word] = words.choice(("BRDF", "BTDF"), word)
        elif word == "TristimulusValue":
            now["channel"] = words.choice(_TRISTIMULUS, word)
        elif word == "TIS":
            given = {name for name in ("AOI", "POI", "Side") if now[name] is not None}
            named = given if named is None else named
            if given != named or "AOI" not in given:
                raise ValueError(
                    f"{words.where}: line {words.line} ends the entries of a block; each must have an AOI, and those "
                    f"of AOI, POI, Side that others have ({', '.join(sorted(named)) or 'none'}); it has "
                    f"{', '.join(sorted(given)) or 'none'}."
                )
            words.number("the total scatter")
            values = words.numbers(n, "a value")
            if (now["Side"] or "Front", now["ScatterType"]) == ("Front", "BRDF"):
                channel = now["channel"] or f"{now['Wavelength']:g}nm"
                block = result.setdefault((now["AOI"], now["POI"] or 0.0), {})
                if channel in block:
                    raise ValueError(
                        f"{words.where}: line {words.line} ends a block that stood there before ({channel})."
                    )
                block[channel] = values
            now = _empty()
    return result


def _empty() -> dict:
    return {"AOI": None, "POI": None, "Wavelength": 0.0, "Side": None, "ScatterType": "BRDF", "channel": ""}
