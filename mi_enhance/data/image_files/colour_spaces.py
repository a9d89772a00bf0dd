"""Colours of a photograph: from the numbers in its file to linear RGB with the primaries of sRGB."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

SRGB = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)  # x, y of red, green, blue and white: IEC 61966-2-1
ADOBE_RGB = (0.64, 0.33, 0.21, 0.71, 0.15, 0.06, 0.3127, 0.3290)  # Adobe RGB (1998)
# ITU-T H.273, table 2: the primaries that a PNG file names by number.
CICP_PRIMARIES = {
    1: SRGB,
    9: (0.708, 0.292, 0.170, 0.797, 0.131, 0.046, 0.3127, 0.3290),
    12: (0.680, 0.320, 0.265, 0.690, 0.150, 0.060, 0.3127, 0.3290),
}
_BRADFORD = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])
_D50 = np.array([0.9642, 1.0, 0.8249])  # white of ICC profiles
_SAME = 5e-3  # entries of a matrix that differ by less are rounded primaries of sRGB, not others

Curve = Callable[[np.ndarray], np.ndarray]


class ColourSpace(NamedTuple):
    """A conversion of numbers in [0, 1] to linear RGB with the primaries of sRGB.

    Parameters
    ----------
    decode : callable
        From an array of numbers to linear ones, each for itself.
    matrix : array (3, 3) or None
        From linear RGB to that of sRGB; None if the primaries are those of sRGB.
    """

    decode: Curve
    matrix: np.ndarray | None = None


def decode_srgb(v: np.ndarray) -> np.ndarray:
    """Return linear values of numbers in [0, 1], IEC 61966-2-1.

    Examples
    --------
    >>> decode_srgb(np.array([0.0, 0.5, 1.0])).round(4).tolist()
    [0.0, 0.214, 1.0]
    """
    return np.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4)


def power(exponent: float) -> Curve:
    """Return the curve v ** exponent."""
    return lambda v: v**exponent


LINEAR = ColourSpace(power(1.0))

# ITU-T H.273, table 3. What is left out (PQ, HLG, the curves of cameras) has a meaning that depends on a display.
CICP_CURVES: dict[int, Curve] = {4: power(2.2), 5: power(2.8), 8: power(1.0), 13: decode_srgb}


def matrix_of_primaries(chromaticities: Sequence[float] | np.ndarray) -> np.ndarray | None:
    """Return the matrix from linear RGB of some primaries to linear sRGB; None if it is the identity.

    Parameters
    ----------
    chromaticities : sequence of 8 float
        x, y of red, green, blue and white, which becomes the white of sRGB (Bradford).

    Raises
    ------
    ValueError
        If they span no colour space.

    Examples
    --------
    >>> matrix_of_primaries(SRGB) is None
    True
    >>> matrix_of_primaries(ADOBE_RGB)[0, :2].round(3).tolist()
    [1.398, -0.398]
    """
    return matrix_of_xyz(*_xyz_of(chromaticities))


def matrix_of_xyz(to_xyz: np.ndarray, white: np.ndarray = _D50) -> np.ndarray | None:
    """Return the matrix from linear RGB to linear sRGB; None if it is the identity.

    Parameters
    ----------
    to_xyz : array (3, 3)
        From linear RGB to CIE XYZ.
    white : array (3,)
        XYZ of the white that `to_xyz` is relative to.
    """
    srgb, d65 = _xyz_of(SRGB)
    adapted = np.linalg.inv(_BRADFORD) @ np.diag((_BRADFORD @ d65) / (_BRADFORD @ white)) @ _BRADFORD
    matrix = np.linalg.inv(srgb) @ adapted @ to_xyz
    if not np.isfinite(matrix).all():
        raise ValueError("its primaries are no numbers")
    return None if np.abs(matrix - np.eye(3)).max() < _SAME else matrix


def _xyz_of(chromaticities: Sequence[float] | np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Matrix to XYZ, and XYZ of white, whose Y is 1."""
    xy = np.asarray(chromaticities, np.float64).reshape(-1, 2)
    if xy.shape != (4, 2) or not np.isfinite(xy).all() or (xy[:, 1] <= 0).any():
        raise ValueError(f"its primaries {np.ravel(xy).tolist()} are none")
    columns = np.stack([xy[:, 0] / xy[:, 1], np.ones(4), (1 - xy.sum(1)) / xy[:, 1]])
    if abs(np.linalg.det(columns[:, :3])) < 1e-6:  # on one line: no colour but theirs can be mixed
        raise ValueError(f"its primaries {np.ravel(xy).tolist()} lie on one line")
    return columns[:, :3] * np.linalg.solve(columns[:, :3], columns[:, 3]), columns[:, 3]
