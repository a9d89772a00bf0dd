"""One photograph or mask from a file, as linear RGB: which reader takes it, and what all readers share."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np

from .colour_spaces import ColourSpace

# The largest cameras have 150 million pixels. More is a damaged header, and 2 GB as float32.
_MOST_PIXELS = 175_000_000


@dataclasses.dataclass(frozen=True, eq=False)
class Photograph:
    """The content of an image file.

    Parameters
    ----------
    image : array (H, W, 3)
        Linear RGB, float32.
    alpha : array (H, W), optional
        Coverage in [0, 1], where the file has one; 0 where it has no pixels.
    ceiling : float
        Value at which the camera saturates.
    orientation : int
        As EXIF counts, 1 to 8: `image` is as it is stored, see :func:`turned`.
    exposure : float, optional
        What the camera has made of the same radiance, relative to other photographs, where EXIF tells it.
    """

    image: np.ndarray
    alpha: np.ndarray | None = None
    ceiling: float = math.inf
    orientation: int = 1
    exposure: float | None = None


def read_photograph(file: Path, where: str, *, is_mask: bool = False, is_linear: bool = False) -> Photograph:
    """Read one image: EXR, PNG or JPEG, whatever its suffix.

    Mitsuba's readers of other formats end the process where a file is damaged.

    Parameters
    ----------
    file : Path
    where : str
        What an error begins with.
    is_mask : bool
        Whether a single channel of an EXR file is what is sought, whatever its name.
    is_linear : bool
        Whether the numbers of a PNG file are proportional to light, whatever the file says of them. A JPEG file is
        refused then.

    Raises
    ------
    ValueError
        If it is no image, is damaged, or holds what cannot be honoured.
    """
    from .exr_file import read_exr
    from .jpeg_file import read_jpeg
    from .png_file import read_png

    where = f"{where}: {file.name}"
    with file.open("rb") as opened:
        start = opened.read(8)
    if start[:4] == b"\x76\x2f\x31\x01":
        return read_exr(file, where, is_mask)
    if start == b"\x89PNG\r\n\x1a\n":
        return read_png(file, where, is_linear)
    if start[:3] == b"\xff\xd8\xff":
        if is_linear:
            raise ValueError(f"{where} is a JPEG file, whose numbers are not linear. Give PNG of 16 bits, or EXR.")
        return read_jpeg(file, where)
    raise ValueError(f"{where} cannot be read as an image: it is no EXR, PNG or JPEG file. Convert it to one of them.")


def check_size(width: int, height: int, n_bytes: int, where: str) -> None:
    """Refuse a size that is none, or that a file of so many bytes cannot hold, before memory is asked for.

    Raises
    ------
    ValueError
    """
    if min(width, height) < 1 or width * height > _MOST_PIXELS:
        raise ValueError(
            f"{where} says that it has {width} x {height} pixels; read are 1 to {_MOST_PIXELS:,}. Make it smaller, or "
            "save it again if that is not its size."
        )
    # 8192 pixels a byte: deflate reaches 1032 bytes (8256 pixels of one bit) in one, JPEG 512 pixels
    if width * height > 8192 * n_bytes + 8192:
        raise ValueError(
            f"{where} cannot be read as an image: {width} x {height} pixels do not fit in it. It is cut off."
        )


def of_integers(raw: np.ndarray, space: ColourSpace, ceiling: int | None = None) -> Photograph:
    """Return a photograph of 8 or 16 bits.

    Parameters
    ----------
    raw : array (H, W) or (H, W, C) of uint8 or uint16
        Grey, grey and alpha, RGB, or RGB and alpha.
    space : ColourSpace
        What the numbers mean, alpha apart.
    ceiling : int, optional
        Number at which the camera saturates; the largest if left out.
    """
    top = int(np.iinfo(raw.dtype).max)
    ceiling = top if ceiling is None else ceiling
    raw = raw[..., None] if raw.ndim == 2 else raw
    colours, alpha = (raw[..., :-1], raw[..., -1] / np.float32(top)) if raw.shape[2] in (2, 4) else (raw, None)
    linear = np.asarray(space.decode(np.arange(top + 1) / top), np.float64)
    image = linear.astype(np.float32)[colours if colours.shape[2] == 3 else colours.repeat(3, 2)]
    if space.matrix is None or colours.shape[2] == 1:
        return Photograph(image, alpha, float(np.float32(linear[ceiling])))
    # With other primaries a saturated channel leaves all three unknown: such a pixel does not count.
    saturated = (colours >= ceiling).any(-1)
    alpha = np.where(saturated, np.float32(0), np.float32(1) if alpha is None else alpha)
    return Photograph((image @ space.matrix.T.astype(np.float32)), alpha)


def turned(a: np.ndarray, orientation: int) -> np.ndarray:
    """Return an array (H, W, ...) as it is to be seen: EXIF's orientation 1 to 8 (CIPA DC-008, tag 274).

    Examples
    --------
    >>> turned(np.array([[1, 2, 3]]), 6).tolist()
    [[1], [2], [3]]
    """
    if orientation in (5, 6, 7, 8):  # row and column change places
        a = a.swapaxes(0, 1)
    if orientation in (2, 3, 6, 7):
        a = a[:, ::-1]
    if orientation in (3, 4, 7, 8):
        a = a[::-1]
    return a
