"""The transfer curve of sRGB, both ways."""

from __future__ import annotations

import numpy as np


def _linear(picture):
    """Linear values; 8-bit pictures are taken for sRGB."""
    if picture.dtype != np.uint8:
        return picture.astype(np.float32)
    v = picture.astype(np.float32) / 255
    return np.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4)


def encode_srgb(image):
    """Clip linear RGB to [0, 1] and apply the sRGB curve of IEC 61966-2-1, as for a PNG file.

    Examples
    --------
    >>> encode_srgb(np.array([-1.0, 0.0, 1.0, 7.0])).round(6).tolist()
    [0.0, 0.0, 1.0, 1.0]
    """
    image = np.clip(image, 0, 1)
    return np.where(image <= 0.0031308, 12.92 * image, 1.055 * image ** (1 / 2.4) - 0.055)
