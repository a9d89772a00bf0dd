"""RGL files in the form that Mitsuba's `measured` reads in an RGB variant: RGB, and azimuths from -pi to pi.

Mitsuba interpolates linearly, and both changes are linear, so they change no value between the points: spectra become
RGB entry by entry; an anisotropic file with azimuths of a whole turn from 0 is cut open at pi, where it gets the point
that linear interpolation finds there.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from . import spectra

# Fields with a slice for each azimuth of the viewer
_BY_PHI = ("vndf", "luminance", "rgb")
_WHOLE_TURN = 2 * np.pi - 1e-2


def needs_rewriting(names: Mapping, phi_i: np.ndarray) -> bool:
    """Tell whether Mitsuba would refuse the file, or ask it for azimuths that it does not have.

    Parameters
    ----------
    names : mapping
        With the names of the file's fields as keys.
    phi_i : array
        Its azimuths.

    Examples
    --------
    >>> needs_rewriting({"spectra": 0}, np.zeros(1)), needs_rewriting({"rgb": 0}, np.array([-np.pi, 0.0, np.pi]))
    (True, False)
    """
    return "rgb" not in names or (len(phi_i) > 2 and bool(phi_i[-1] > np.pi + 1e-3))


def rewritten(fields: Mapping[str, np.ndarray], where: str) -> dict[str, np.ndarray]:
    """Return the fields in the form that Mitsuba reads.

    Parameters
    ----------
    fields : dict of str to array
        ``spectra`` (phi, theta, W, u, v) with ``wavelengths`` (W,) in nm, or ``rgb``; and the others.
    where : str
        The beginning of messages.

    Raises
    ------
    ValueError
        If the wavelengths cannot be seen, or azimuths above pi are no whole turn.
    """
    result = dict(fields)
    if "rgb" not in result:
        weights = spectra.rgb_weights(result.pop("wavelengths"), where)
        table = result.pop("spectra")
        result["rgb"] = np.einsum("ptwuv,wc->ptcuv", table, weights.astype(np.float32)).astype(np.float32)
    phi = result["phi_i"].astype(np.float64)
    if len(phi) > 2 and phi[-1] > np.pi + 1e-3:
        if abs(phi[0]) > 1e-3 or phi[-1] < _WHOLE_TURN:
            raise ValueError(
                f"{where}: phi_i runs from {phi[0]:.4g} to {phi[-1]:.4g}; known are files from 0 or -pi over half a "
                "turn or a whole one."
            )
        result |= _cut_at_pi(phi, {name: result[name] for name in _BY_PHI})
    return {name: np.ascontiguousarray(v) for name, v in result.items()}


def _cut_at_pi(phi: np.ndarray, slices: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return azimuths from -pi to pi instead of 0 to 2 pi, and the slices in their order."""
    upper = np.flatnonzero((phi > np.pi + 1e-3) & (phi < 2 * np.pi - 1e-3))
    lower = np.flatnonzero(phi < np.pi - 1e-3)
    new_phi = np.concatenate(([-np.pi], phi[upper] - 2 * np.pi, phi[lower], [np.pi]))
    k = int(np.searchsorted(phi, np.pi))
    t = (np.pi - phi[k - 1]) / (phi[k] - phi[k - 1])
    result = {"phi_i": new_phi.astype(np.float32)}
    for name, v in slices.items():
        at_pi = ((1 - t) * v[k - 1] + t * v[k])[None].astype(np.float32)
        result[name] = np.concatenate((at_pi, v[upper], v[lower], at_pi))
    return result
