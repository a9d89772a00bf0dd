"""Orientation, colour space and exposure from a photograph's EXIF (CIPA DC-008)."""

from __future__ import annotations

import math

_ORIENTATION, _INTEROPERABILITY, _INDEX = 0x0112, 0xA005, 1
_CAMERA, _TIME, _F_NUMBER, _ISO = 0x8769, 0x829A, 0x829D, 0x8827


def orientation_of(tags) -> int:
    """Return the orientation in Pillow's ``Exif``, 1 to 8; 1, as it is to be seen, if there is none."""
    value = tags.get(_ORIENTATION, 1)
    return value if isinstance(value, int) and 1 <= value <= 8 else 1


def is_adobe_rgb(tags) -> bool:
    """Whether Pillow's ``Exif`` says Adobe RGB, as cameras do that embed no profile."""
    try:
        return str(tags.get_ifd(_INTEROPERABILITY).get(_INDEX, "")).startswith("R03")
    except Exception:  # noqa: BLE001  (damaged metadata raises anything; the pixels are as good)
        return False


def exposure_of(tags) -> float | None:
    """Return seconds times ISO over the square of the f-number: what a camera makes of one radiance, or None."""
    try:
        own = tags.get_ifd(_CAMERA)
        exposure = float(own[_TIME]) * float(own.get(_ISO, 100)) / float(own.get(_F_NUMBER, 1)) ** 2
    except Exception:  # noqa: BLE001  (as above)
        return None
    return exposure if 0 < exposure < math.inf else None


def read_tags(data: bytes):
    """Return Pillow's ``Exif`` of bytes; an empty one of what cannot be read."""
    from PIL import Image

    tags = Image.Exif()
    try:
        tags.load(data)
    except Exception:  # noqa: BLE001  (as above)
        return Image.Exif()
    return tags
