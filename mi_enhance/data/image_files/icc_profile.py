"""ICC profiles of photographs: those of three primaries and a curve each (ICC.1:2022, sections 9.2, 10.6, 10.18)."""

from __future__ import annotations

import struct

import numpy as np

from .colour_spaces import ColourSpace, Curve, decode_srgb, matrix_of_xyz

# A curve that is nowhere further from that of sRGB is a table of it: half of an 8-bit step, where it is steepest.
_SAME = 4e-3


def read_icc_profile(profile: bytes) -> ColourSpace:
    """Return the colour space that a profile describes.

    Raises
    ------
    ValueError
        If it has another form (tables for printers, Lab), is damaged, or its channels have different curves.
    """
    try:
        tags = _tags(profile)
        grey = profile[16:20] == b"GRAY"
        curves = [_curve(tags[name]) for name in ([b"kTRC"] if grey else [b"rTRC", b"gTRC", b"bTRC"])]
        matrix = None if grey else matrix_of_xyz(np.stack([_xyz(tags[n]) for n in (b"rXYZ", b"gXYZ", b"bXYZ")], 1))
    except (KeyError, IndexError, struct.error) as error:
        raise ValueError(f"its ICC profile has no three primaries and curves ({error})") from None
    v = np.linspace(0, 1, 257)
    with np.errstate(all="ignore"):  # what overflows is refused by the next line
        values = [np.asarray(curve(v), np.float64) for curve in curves]
    if not all(np.isfinite(y).all() and np.abs(y - values[0]).max() < _SAME for y in values):
        raise ValueError("the curves of its ICC profile are no numbers, or differ between red, green and blue")
    is_srgb = np.abs(values[0] - decode_srgb(v)).max() < _SAME
    return ColourSpace(decode_srgb if is_srgb else curves[0], matrix)


def _tags(profile: bytes) -> dict[bytes, bytes]:
    (count,) = struct.unpack_from(">I", profile, 128)
    found = {}
    for k in range(min(count, 100)):  # profiles have about a dozen; a damaged count is any number
        name, offset, size = struct.unpack_from(">4sII", profile, 132 + 12 * k)
        found[name] = profile[offset : offset + size]
    return found


def _xyz(tag: bytes) -> np.ndarray:
    return np.array(struct.unpack_from(">3i", tag, 8)) / 65536


def _curve(tag: bytes) -> Curve:
    if tag[:4] == b"curv":
        (count,) = struct.unpack_from(">I", tag, 8)
        if count == 0:
            return lambda v: v
        table = np.array(struct.unpack_from(f">{count}H", tag, 12), np.float64)
        if count == 1:
            return lambda v: v ** (table[0] / 256)
        return lambda v: np.interp(v, np.linspace(0, 1, count), table / 65535)
    if tag[:4] != b"para":
        raise KeyError("a curve of another type")
    (kind,) = struct.unpack_from(">H", tag, 8)
    n = (1, 3, 4, 5, 7)[kind]
    g, a, b, c, d, e, f = [x / 65536 for x in struct.unpack_from(f">{n}i", tag, 12)] + [0.0] * (7 - n)
    if kind == 0:
        return lambda v: v**g
    # Of the five forms the first two begin at -b / a, and the second and third add their last number, c.
    start, low, above = ((-b / a if a else 0.0), 0.0, c if kind == 2 else 0.0) if kind < 3 else (d, c, e)
    below = (0.0, 0.0, c, 0.0, f)[kind]
    return lambda v: np.where(v >= start, np.maximum(a * v + b, 0) ** g + above, low * v + below)
