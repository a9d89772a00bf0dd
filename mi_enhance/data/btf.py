"""UBO BTF archives (Bonn: UBO 2003, ATRIUM, UBO 2014) through the optional package `btf-extractor`.

A BTF is a picture of a flat sample for every pair of directions: each pixel is a texel with an apparent BRDF. The
archives keep angles of light and view in degrees, in the order (theta_l, phi_l, theta_v, phi_v), and pictures as BGR.
"""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np

from ..output.srgb import _linear
from ..system.files import require_file
from ..system.progress import Callback, Progress, silent
from .directions import MIN_COS, direction


def read(
    path: str | Path,
    *,
    rows: tuple[int, int],
    columns: tuple[int, int],
    n_samples: int = 256,
    cosine: bool = True,
    seed: int = 0,
    progress: Callback = silent,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Read texels of a window of a BTF, as :func:`mi_enhance.fitting.fit_texels.fit_texels` takes them.

    Parameters
    ----------
    path : str or Path
        ``.zip`` of UBO 2003 or ATRIUM (JPEG, or HDR), ``.btf`` of UBO 2014.
    rows, columns : (int, int)
        The window: first row and the one after the last, likewise columns.
    n_samples : int
        Pairs of directions, drawn without replacement; all if there are no more.
    cosine : bool
        The pictures hold reflectance times the cosine of the light, as photographs of a lit sample do.
    seed : int
        Of the choice of pairs.
    progress : callable, optional
        ``progress(Progress)`` after every picture.

    Returns
    -------
    wi, wo : array (S, 3), float32
        Towards viewer and light.
    f : array (H, W, S, 3), float32
        1/sr, linear RGB; negative values are 0. White is 1/pi: the archives do not say what their 1 (or 255, sRGB
        decoded) stands for, so all of f is known up to one factor.

    Raises
    ------
    ModuleNotFoundError
        If `btf-extractor` is not installed.
    FileNotFoundError, ValueError
        If the file is missing or damaged, the window does not lie inside, or no pair is above the horizon.

    Examples
    --------
    >>> wi, wo, f = read("UBO_CORDUROY256.zip", rows=(0, 64), columns=(0, 64))  # doctest: +SKIP
    """
    where = f'data.btf.read("{path}")'
    archive = _open(require_file(path, where), where)
    pairs = sorted(archive.angles_set)
    angles = np.array(pairs, np.float64).reshape(-1, 4)
    theta_l, phi_l, theta_v, phi_v = np.deg2rad(angles.T)
    above = np.flatnonzero(np.minimum(np.cos(theta_l), np.cos(theta_v)) >= MIN_COS)
    if not len(above):
        raise ValueError(f"{where}: none of its {len(angles)} pairs of directions is above the horizon.")
    chosen = np.sort(np.random.default_rng(seed).permutation(above)[:n_samples])
    wi = direction(theta_v[chosen], phi_v[chosen]).astype(np.float32)
    wo = direction(theta_l[chosen], phi_l[chosen]).astype(np.float32)
    _check_window(rows, columns, archive.angles_to_image(*pairs[chosen[0]]).shape, where)
    f = np.empty((rows[1] - rows[0], columns[1] - columns[0], len(chosen), 3), np.float32)
    for k, at in enumerate(chosen):
        picture = archive.angles_to_image(*pairs[at])
        progress(Progress("pictures", k + 1, len(chosen)))
        f[:, :, k] = _linear(picture[rows[0] : rows[1], columns[0] : columns[1], ::-1])
    if not np.isfinite(f).all():
        raise ValueError(f"{where}: holds NaN or infinity. The file is damaged; download it again.")
    return wi, wo, np.maximum(f, 0) / (np.float32(np.pi) * (wo[:, 2:] if cosine else 1))


def _open(path: Path, where: str):
    """Return the reader of the package for the kind of the file."""
    try:
        import btf_extractor
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            f"{where}: needs the package btf-extractor ({error}). Install it: pip install 'mi-enhance[btf]'; it is "
            "built with a C++ compiler."
        ) from error
    if zipfile.is_zipfile(path):
        with zipfile.ZipFile(path) as archive:
            is_hdr = any(name.endswith(".hdr") for name in archive.namelist())
        kind = btf_extractor.AtriumHdr if is_hdr else btf_extractor.Ubo2003
    elif path.suffix.lower() == ".btf":
        kind = btf_extractor.Ubo2014
    else:
        raise ValueError(f"{where}: neither a .zip archive of UBO 2003 or ATRIUM nor a .btf file of UBO 2014.")
    try:
        return kind(str(path))
    except Exception as error:  # whatever the package raises for damaged bytes and odd names
        raise ValueError(f"{where}: btf-extractor cannot read this file ({error}).") from error


def _check_window(rows: tuple[int, int], columns: tuple[int, int], shape: tuple[int, ...], where: str) -> None:
    for name, (first, end), size in (("rows", rows, shape[0]), ("columns", columns, shape[1])):
        if not 0 <= first < end <= size:
            raise ValueError(f"{where}: {name} {first} to {end} do not lie within the {size} there are.")
