"""JPEG photographs: profile, orientation and colour space are honoured, what is no RGB is refused."""

from __future__ import annotations

import dataclasses
import warnings
from pathlib import Path

import numpy as np

from .colour_spaces import ADOBE_RGB, ColourSpace, decode_srgb, matrix_of_primaries, power
from .exif import exposure_of, is_adobe_rgb, orientation_of
from .icc_profile import read_icc_profile
from .photograph import Photograph, check_size, of_integers


def read_jpeg(file: Path, where: str) -> Photograph:
    """Read a JPEG file, of several pictures the first.

    Raises
    ------
    ValueError
        If it is cut off or damaged, CMYK, or has a profile that cannot be honoured.
    """
    from PIL import Image

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # sizes and metadata: the size is checked here, bad metadata passed over
            with Image.open(file, formats=("JPEG", "MPO")) as opened:
                width, height = opened.size
                check_size(width, height, file.stat().st_size, where)
                mode, profile, tags = opened.mode, opened.info.get("icc_profile"), opened.getexif()
                raw = np.array(opened) if mode in ("L", "RGB") else None
                turn, adobe, exposure = orientation_of(tags), is_adobe_rgb(tags), exposure_of(tags)
    except ValueError as error:
        if str(error).startswith(where):
            raise
        raise ValueError(f"{where} cannot be read as an image ({error}).") from None
    except Exception as error:  # noqa: BLE001  (the library raises anything for damaged files)
        raise ValueError(f"{where} cannot be read as an image ({error}): the JPEG file is damaged.") from None
    if raw is None:
        raise ValueError(f"{where} is a JPEG file in {mode}, whose colours depend on a printer. Convert it to sRGB.")
    try:
        if profile:
            space = read_icc_profile(profile)
        else:
            # Adobe RGB (1998), section 4.3.1.2: gamma 2 + 51/256
            space = ColourSpace(power(563 / 256), matrix_of_primaries(ADOBE_RGB)) if adobe else ColourSpace(decode_srgb)
    except ValueError as error:
        raise ValueError(f"{where}: its colours cannot be told: {error}. Convert it to sRGB.") from None
    return dataclasses.replace(of_integers(raw, space), orientation=turn, exposure=exposure)
