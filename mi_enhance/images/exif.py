"""Orientation and colour space from a photograph's EXIF (CIPA DC-008)."""

from __future__ import annotations

_ORIENTATION, _INTEROPERABILITY, _INDEX = 0x0112, 0xA005, 1


def orientation(data: bytes) -> int:
    """Return 1 to 8; 1, as it is to be seen, if there is none that can be read."""
    return orientation_of(_read(data))


def orientation_of(tags) -> int:
    """Return the orientation in Pillow's ``Exif``."""
    value = tags.get(_ORIENTATION, 1)
    return value if isinstance(value, int) and 1 <= value <= 8 else 1


def is_adobe_rgb(tags) -> bool:
    """True if Pillow's ``Exif`` says Adobe RGB, as cameras do that embed no profile."""
    try:
        return str(tags.get_ifd(_INTEROPERABILITY).get(_INDEX, "")).startswith("R03")
    except Exception:  # noqa: BLE001  (damaged metadata raises anything; the pixels are as good)
        return False


def _read(data: bytes):
    from PIL import Image

    tags = Image.Exif()
    try:
        tags.load(data)
    except Exception:  # noqa: BLE001  (as above)
        return Image.Exif()
    return tags
