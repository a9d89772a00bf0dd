"""Spectra to linear sRGB: CIE 1931 2 degree observer under daylight D65, by `colour-science`.

A perfect white reflector is (1, 1, 1). Spectra are linear between their wavelengths and constant beyond the first and
the last.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

NOTE = "spectra to linear sRGB with the CIE 1931 2 degree observer under D65"
_VISIBLE = (380.0, 780.0)  # nm


def rgb_weights(wavelengths: ArrayLike, where: str) -> np.ndarray:
    """Return the weights that turn a spectrum into linear sRGB: ``f_rgb = f @ weights``.

    Parameters
    ----------
    wavelengths : array (W,)
        Nanometres, strictly increasing. A single one is grey, whatever it is.
    where : str
        The beginning of messages.

    Returns
    -------
    array (W, 3), float64
        Columns that add up to 1. Some are negative: sRGB does not hold the purest colours.

    Raises
    ------
    ValueError
        If the wavelengths do not increase, are no lengths, or are two or more, none of them visible.

    References
    ----------
    CIE 15:2004; sRGB: IEC 61966-2-1.

    Examples
    --------
    >>> rgb_weights([550.0], "doc").tolist()
    [[1.0, 1.0, 1.0]]
    >>> w = rgb_weights(np.arange(400, 701, 10), "doc")
    >>> w.shape, bool(np.allclose(w.sum(0), 1)), [int(c) for c in w.argmax(0)]  # 600, 540 and 450 nm
    ((31, 3), True, [20, 14, 5])
    """
    nm = np.asarray(wavelengths, np.float64)
    if nm.ndim != 1 or len(nm) == 0 or not np.isfinite(nm).all() or (np.diff(nm) <= 0).any() or nm[0] <= 0:
        raise ValueError(f"{where}: the wavelengths {nm.ravel()[:8].tolist()} must be lengths in nm that increase.")
    if len(nm) == 1:
        return np.ones((1, 3))
    if nm[0] > _VISIBLE[1] or nm[-1] < _VISIBLE[0]:
        raise ValueError(
            f"{where}: none of its {len(nm)} wavelengths, {nm[0]:g} to {nm[-1]:g} nm, is visible ({_VISIBLE[0]:g} to "
            f"{_VISIBLE[1]:g} nm). Keep one of them and name it f: it is read as grey."
        )
    grid, to_xyz = _observer()
    # What each wavelength contributes at each nm: a hat, with a shoulder for the first and the last.
    hats = np.stack([np.interp(grid, nm, one) for one in np.eye(len(nm))])
    weights = hats @ to_xyz @ _xyz_to_rgb().T
    return weights / weights.sum(0)


def xyz_to_rgb(xyz: np.ndarray) -> np.ndarray:
    """Return linear sRGB (N, 3) of tristimulus values (N, 3), in which (0.9505, 1, 1.089) is white."""
    return xyz @ _xyz_to_rgb().T


def to_rgb(values: np.ndarray, channels: Sequence[str], where: str) -> tuple[np.ndarray, list[str]]:
    """Return linear sRGB of values (N, C) whose channels have names, and what was done, for `source`.

    Parameters
    ----------
    values : array (N, C)
    channels : sequence of str
        ``R, G, B``, ``X, Y, Z``, wavelengths such as ``550nm``, or one of any name, which is grey.
    where : str

    Raises
    ------
    ValueError
        If the names are none of these.
    """
    names = [c.strip().upper() for c in channels]
    if names == ["R", "G", "B"]:
        return values, []
    if names == ["X", "Y", "Z"]:
        return xyz_to_rgb(values), ["XYZ to linear sRGB (white D65)"]
    if len(names) == 1:
        return np.repeat(values, 3, axis=1), []
    try:
        nm = np.array([float(n.removesuffix("NM")) for n in names])
    except ValueError:
        raise ValueError(
            f"{where}: its channels are {', '.join(channels)[:80]}. Known are R, G, B; X, Y, Z; wavelengths such as "
            "550nm; or a single one, which is grey."
        ) from None
    order = np.argsort(nm)
    return values[:, order] @ rgb_weights(nm[order], where), [NOTE]


def _observer() -> tuple[np.ndarray, np.ndarray]:
    """Return nm, and colour matching functions times the illuminant there, (N, 3)."""
    import colour  # 0.5 s to import

    shape = colour.SpectralShape(*_VISIBLE, 1)
    observer = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"].copy().align(shape)
    light = colour.SDS_ILLUMINANTS["D65"].copy().align(shape)
    return np.asarray(observer.wavelengths), observer.values * light.values[:, None]


def _xyz_to_rgb() -> np.ndarray:
    import colour

    return np.asarray(colour.RGB_COLOURSPACES["sRGB"].matrix_XYZ_to_RGB, np.float64)
