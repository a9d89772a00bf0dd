"""NBRDF `.npz`: a 6-21-21-3 network per measured isotropic material; the README in bundled/nbrdf has the format."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from ..system import npz
from .directions import half_difference, sample_pairs
from .measurements import Measurements, clamp_negative
from .registry import reader

_BLOCK = 1 << 16  # samples at a time: 6 MB per layer, which stays in the cache


def names(path: str | Path) -> list[str]:
    """List the materials in the file."""
    where = f'data.load("{path}")'
    return npz.words(npz.read(path, ["names"], where), "names", where)


def read_networks(path: str | Path) -> tuple[list[str], dict[str, np.ndarray]]:
    """Read the weights of all materials.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    names : list of M str
    networks : dict
        ``W1 (M, 6, H), b1 (M, H), W2 (M, H, H), b2 (M, H), W3 (M, H, 3), b3 (M, 3)``, float32; H = 21.

    Raises
    ------
    ValueError
        If an array is missing, of another shape, or not finite.
    """
    where = f'data.load("{path}")'
    arrays = npz.read(path, ["names", "W1", "b1", "W2", "b2", "W3", "b3"], where)
    materials = npz.words(arrays, "names", where)
    m, h = len(materials), arrays["b1"].shape[-1] if arrays["b1"].ndim else 0
    shapes = {"W1": (m, 6, h), "b1": (m, h), "W2": (m, h, h), "b2": (m, h), "W3": (m, h, 3), "b3": (m, 3)}
    return materials, {k: npz.numbers(arrays, k, shape, where) for k, shape in shapes.items()}


def decode(network: Mapping[str, np.ndarray], wi: np.ndarray, wo: np.ndarray) -> np.ndarray:
    """Return the reflectance of one network.

    Parameters
    ----------
    network : dict
        ``W1 (6, H), b1 (H,), W2 (H, H), b2 (H,), W3 (H, 3), b3 (3,)``: one material of `read_networks`.
    wi, wo : array (N, 3)
        Unit vectors towards the viewer and the light, above the horizon. The network is not exactly reciprocal.

    Returns
    -------
    array (N, 3), float32
        f_r in 1/sr, linear RGB, >= 0.

    References
    ----------
    Sztrajman, Rainer, Ritschel, Weyrich, "Neural BRDF Representation and Importance Sampling", 2021.

    Examples
    --------
    >>> materials, networks = read_networks("mi_enhance/bundled/nbrdf/merl.npz")
    >>> paint = {k: w[materials.index("white-paint")] for k, w in networks.items()}
    >>> decode(paint, [[0.0, 0.0, 1.0]], [[0.0, 0.6, 0.8]]).shape
    (1, 3)
    """
    return np.maximum(_signed(network, wi, wo), 0)


def _signed(network: Mapping[str, np.ndarray], wi: np.ndarray, wo: np.ndarray) -> np.ndarray:
    """Return what `decode` does before it cuts off negative values."""
    wi, wo = np.asarray(wi), np.asarray(wo)
    f = np.empty((len(wi), 3), np.float32)
    for k in range(0, len(wi), _BLOCK):
        theta_h, _, d = half_difference(wi[k : k + _BLOCK], wo[k : k + _BLOCK])
        x = np.column_stack((np.sin(theta_h), np.zeros_like(theta_h), np.cos(theta_h), d)).astype(np.float32)
        x = np.maximum(x @ network["W1"] + network["b1"], 0)
        x = np.maximum(x @ network["W2"] + network["b2"], 0)
        with np.errstate(over="ignore"):  # inf from absurd weights is refused by Measurements
            f[k : k + _BLOCK] = np.expm1(x @ network["W3"] + network["b3"])
    return f


def function(path: str | Path, index: int) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """Return the reflectance of material number `index`; see :func:`mi_enhance.data.functions.function_of`."""
    network = {k: w[index] for k, w in read_networks(path)[1].items()}
    return lambda wi, wo: decode(network, wi, wo)


@reader("nbrdf", about="NBRDF .npz", arrays=("names", "W1", "W2", "W3"), names=names, function=function)
def read(path: str | Path, index: int, *, n_samples: int = 100_000, seed: int = 0) -> Measurements:
    """Draw samples of material number `index`; see `mi_enhance.data.loading.load`."""
    materials, networks = read_networks(path)
    wi, wo = sample_pairs(n_samples, seed=seed)
    f, clamped_fraction = clamp_negative(_signed({k: w[index] for k, w in networks.items()}, wi, wo))
    return Measurements(wi, wo, f, materials[index], f"NBRDF file {path}", clamped_fraction)
