"""Channels of an OpenEXR file in their place in the picture; the header is checked before the pixels are read."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

_MOST_NUMBERS = 1 << 31  # of all channels: 8 GB
_MOST_PER_BYTE = 4096  # numbers that a byte of the file can stand for; ZIP reaches 500


def read_channels(path: Path, where: str) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Read all channels of a file of one part, and its header.

    Parameters
    ----------
    path : Path
    where : str
        For error messages.

    Returns
    -------
    channels : dict of str to array (H, W)
        Over the display window; what lies outside is cut off.
    header : dict

    Raises
    ------
    ValueError
        If the file is damaged, deep or of several parts, or if its data window does not fill the display window: what
        lies outside has no values.
    """
    import OpenEXR

    with path.open("rb") as opened:
        if opened.read(4) != b"\x76\x2f\x31\x01":
            raise ValueError(f"{where}: this is no OpenEXR file. Give one with a channel for each number.")
    try:
        with OpenEXR.File(str(path), separate_channels=True, header_only=True) as file:
            headers = [dict(part.header) for part in file.parts]
        if len(headers) == 1:
            names = [str(channel.name) for channel in headers[0]["channels"]]
            steps = {(channel.xSampling, channel.ySampling) for channel in headers[0]["channels"]}
            kind = getattr(headers[0]["type"], "name", str(headers[0]["type"]))
            windows = [_box(headers[0], key) for key in ("dataWindow", "displayWindow")]
    except Exception as error:  # the bindings raise RuntimeError, ValueError and TypeError on damaged bytes
        raise ValueError(_damaged(where, error)) from None
    if len(headers) != 1:
        raise ValueError(f"{where}: this OpenEXR file has {len(headers)} parts; one is read. Save one part.")
    if kind not in ("scanlineimage", "tiledimage") or steps - {(1, 1)}:
        what = "channels with fewer samples than texels" if steps - {(1, 1)} else f"deep pixels ({kind})"
        raise ValueError(f"{where}: this OpenEXR file has {what}. Save one number for each texel and channel.")
    (x, y, width, height), (left, top, full_width, full_height) = windows
    numbers = width * height * len(names)
    if min(width, height, full_width, full_height) < 1 or not 0 < numbers <= _MOST_NUMBERS:
        raise ValueError(_damaged(where, f"{len(names)} channels of {width} x {height} texels"))
    if numbers > _MOST_PER_BYTE * path.stat().st_size:
        raise ValueError(_damaged(where, f"{path.stat().st_size} bytes are too few for {numbers} numbers"))
    if x > left or y > top or x + width < left + full_width or y + height < top + full_height:
        raise ValueError(
            f"{where}: this OpenEXR file is cropped: its data window is {width} x {height} texels from column "
            f"{x - left}, row {y - top} of a picture of {full_width} x {full_height}, and what lies outside has no "
            "values. Save it without cropping."
        )
    try:
        with OpenEXR.File(str(path), separate_channels=True) as file:
            # copies: closing the file empties what it gave
            channels = {name: np.array(file.channels()[name].pixels) for name in names}
    except Exception as error:  # as above
        raise ValueError(_damaged(where, error)) from None
    if any(v.shape != (height, width) for v in channels.values()):
        raise ValueError(_damaged(where, "its pixels are cut off"))
    rows, columns = slice(top - y, top - y + full_height), slice(left - x, left - x + full_width)
    return {name: v[rows, columns] for name, v in channels.items()}, headers[0]


def _box(header: Mapping[str, Any], key: str) -> tuple[int, int, int, int]:
    """Left, top, width and height of a window."""
    (x0, y0), (x1, y1) = ([int(v) for v in corner] for corner in header[key])
    return x0, y0, x1 - x0 + 1, y1 - y0 + 1


def _damaged(where: str, error: object) -> str:
    return f"{where}: OpenEXR cannot read this file ({error}). It is damaged; save it again."
