"""NPs `.npz`: seven numbers per measured isotropic material, one decoder for all.

The README in bundled/nps has the format. The decoder (`decoder.npz`, 3 MB) lies beside the latents. Any seven numbers
decode to a material: mixtures of latents are further training materials.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from ..system import npz
from ..system.files import require_file
from .directions import half_difference, sample_pairs
from .measurements import Measurements, clamp_negative
from .registry import reader

_BLOCK = 1 << 13  # samples at a time: 13 MB per layer
_LAYERS = range(1, 8)
_N_LATENT = 7


def names(path: str | Path) -> list[str]:
    """List the materials in the file."""
    return read_latents(path)[0]


def read_latents(path: str | Path) -> tuple[list[str], np.ndarray]:
    """Read names and latent vectors of all materials.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    names : list of M str
    latents : array (M, 7), float32
    """
    where = f'data.load("{path}")'
    arrays = npz.read(path, ["names", "mean"], where)
    materials = npz.words(arrays, "names", where)
    return materials, npz.numbers(arrays, "mean", (len(materials), _N_LATENT), where)


def read_decoder(path: str | Path) -> dict[str, np.ndarray]:
    """Read the weights of the decoder.

    Parameters
    ----------
    path : str or Path
        ``decoder.npz``.

    Returns
    -------
    dict
        ``W1 (11, H), b1 (H,), ..., W7 (H, 3), b7 (3,)``, float32; H = 400.
    """
    where = f'data.load("{path}")'
    path = require_file(path, where)
    arrays = npz.read(path, [f"{k}{i}" for i in _LAYERS for k in "Wb"], where)
    sizes = [4 + _N_LATENT, *[arrays["W1"].shape[-1] if arrays["W1"].ndim else 0] * 6, 3]
    shapes: dict[str, tuple[int, ...]] = {}
    for i in _LAYERS:
        shapes |= {f"W{i}": (sizes[i - 1], sizes[i]), f"b{i}": (sizes[i],)}
    return {k: npz.numbers(arrays, k, shape, where) for k, shape in shapes.items()}


def decode(
    decoder: Mapping[str, np.ndarray], latent: np.ndarray, wi: np.ndarray, wo: np.ndarray, *, with_cosine: bool = False
) -> np.ndarray:
    """Return the reflectance of a latent vector; reciprocal to the last bit.

    Parameters
    ----------
    decoder : dict
        From `read_decoder`.
    latent : array (7,)
        Of a material, or a mixture of several.
    wi, wo : array (N, 3)
        Unit vectors towards the viewer and the light, above the horizon.
    with_cosine : bool
        True for the latents of RGL, whose authors encoded f cos(theta_h) cos(theta_d); MERL's hold f itself.

    Returns
    -------
    array (N, 3), float32
        f_r in 1/sr, linear RGB, >= 0.

    References
    ----------
    Zheng, Zheng, Wang, Zhao, Bao, "A Compact Representation of Measured BRDFs Using Neural Processes", 2021.

    Examples
    --------
    >>> materials, latents = read_latents("mi_enhance/bundled/nps/merl.npz")
    >>> decoder = read_decoder("mi_enhance/bundled/nps/decoder.npz")
    >>> decode(decoder, latents[:2].mean(0), [[0.0, 0.0, 1.0]], [[0.0, 0.6, 0.8]]).shape
    (1, 3)
    """
    wi, wo, latent = np.asarray(wi), np.asarray(wo), np.asarray(latent, np.float32)
    if latent.shape != (_N_LATENT,):
        raise ValueError(f"nps.decode(): latent has shape {latent.shape}; one vector of {_N_LATENT} numbers is needed.")
    f = np.empty((len(wi), 3), np.float32)
    for k in range(0, len(wi), _BLOCK):
        theta_h, _, d = half_difference(wi[k : k + _BLOCK], wo[k : k + _BLOCK])
        r2 = d[:, 0] ** 2 + d[:, 1] ** 2
        # cos and sin of 2 phi_d from d itself: exactly the same after a swap; where d is h, phi_d = 0 by definition
        safe = np.where(r2 > 0, r2, 1)
        cos_2phi = np.where(r2 > 0, (d[:, 0] ** 2 - d[:, 1] ** 2) / safe, 1)
        sin_2phi = 2 * d[:, 0] * d[:, 1] / safe
        theta_d = np.arctan2(np.sqrt(r2), d[:, 2])
        x = np.empty((len(d), 4 + _N_LATENT), np.float32)
        angles = (theta_h / (np.pi / 2), theta_d / (np.pi / 2))
        x[:, :4] = np.column_stack((0.5 + 0.5 * cos_2phi, 0.5 + 0.5 * sin_2phi, *angles))
        x[:, 4:] = latent
        for i in _LAYERS:
            x = x @ decoder[f"W{i}"]
            x += decoder[f"b{i}"]
            np.maximum(x, 0, out=x)  # in place: the layers are the memory this takes
        x *= np.float32(0.15)
        with np.errstate(over="ignore"):  # inf from absurd weights is refused by Measurements
            for _ in range(4):
                x = np.expm1(x)
        if with_cosine:
            x /= (np.cos(theta_h) * d[:, 2]).astype(np.float32)[:, None]
        f[k : k + _BLOCK] = x
    return f


def function(path: str | Path, index: int) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """Return the reflectance of material number `index`; see :func:`mi_enhance.data.functions.function_of`."""
    decoder = read_decoder(_decoder_beside(path))
    materials, latents = read_latents(path)
    return lambda wi, wo: decode(decoder, latents[index], wi, wo, with_cosine=_with_cosine(materials))


@reader(
    "nps",
    about="NPs .npz (the latents, with the decoder beside them)",
    arrays=("names", "mean"),
    names=names,
    function=function,
)
def read(path: str | Path, index: int, *, n_samples: int = 100_000, seed: int = 0) -> Measurements:
    """Draw samples of material number `index`; see `mi_enhance.data.loading.load`.

    Raises
    ------
    FileNotFoundError
        If ``decoder.npz`` is not in the same folder.
    """
    beside = _decoder_beside(path)
    materials, latents = read_latents(path)
    wi, wo = sample_pairs(n_samples, seed=seed)
    f = decode(read_decoder(beside), latents[index], wi, wo, with_cosine=_with_cosine(materials))
    f, clamped_fraction = clamp_negative(f)
    return Measurements(wi, wo, f, materials[index], f"NPs file {path}", clamped_fraction)


def _decoder_beside(path: str | Path) -> Path:
    beside = Path(path).with_name("decoder.npz")
    if not beside.exists():
        raise FileNotFoundError(
            f'data.load("{path}"): decoder.npz is not in the same folder; seven numbers per material '
            "mean nothing without it. Put it there (it comes with the latents)."
        )
    return beside


def _with_cosine(materials: list[str]) -> bool:
    """Tell the encoding, which the file does not say: MERL writes its names with hyphens, RGL with underscores."""
    return any("_" in name for name in materials)
