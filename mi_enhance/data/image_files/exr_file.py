"""OpenEXR photographs: header first, then the channels that are its colours, in their place in the picture."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from .colour_spaces import matrix_of_primaries
from .photograph import Photograph, check_size

# Layers and parts that renderers call the picture itself, beside others.
_BEAUTY = re.compile(r"(.*\.)?(combined|beauty|rgba?|colou?r|default)$", re.IGNORECASE)
_MOST_NUMBERS = 1 << 31  # of all channels together: 8 GB, and more than the memory of most


class _Channel:
    """A channel as the header describes it; a name that is no text raises here."""

    def __init__(self, channel: Any):
        self.name, self.step_x, self.step_y = str(channel.name), channel.xSampling, channel.ySampling


class _Layer(NamedTuple):
    """Channels of one part that make a picture."""

    part: int
    name: str
    colours: tuple[str, ...]  # three, or one for grey
    alpha: str | None


def read_exr(file: Path, where: str, is_mask: bool = False) -> Photograph:
    """Read the colours of an EXR file; what lies outside its data window does not count.

    Raises
    ------
    ValueError
        If it is damaged or deep, or if it cannot be told which of its channels are the picture.
    """
    import OpenEXR

    try:
        with OpenEXR.File(str(file), separate_channels=True, header_only=True) as opened:
            headers = [{**p.header, "channels": [_Channel(c) for c in p.header["channels"]]} for p in opened.parts]
    except Exception as error:  # noqa: BLE001  (the library raises several kinds)
        raise ValueError(f"{where} cannot be read as an image ({error}): the EXR file is damaged.") from None
    n_bytes = file.stat().st_size
    for header in headers:
        _check_part(header, n_bytes, where)
    if is_mask and [len(header["channels"]) for header in headers] == [1]:
        layer = _Layer(0, "", (headers[0]["channels"][0].name,), None)
    else:
        layer = _picture(headers, where)
    header = headers[layer.part]
    _check_picture(header, layer, where)
    try:
        with OpenEXR.File(str(file), separate_channels=True) as opened:
            if len(opened.parts) != len(headers):  # the library drops a part that it cannot read
                raise ValueError("its pixels are cut off or broken")
            channels = opened.parts[layer.part].channels
            colours = [np.asarray(channels[name].pixels) for name in layer.colours]
            alpha = np.asarray(channels[layer.alpha].pixels) if layer.alpha else None
    except Exception as error:  # noqa: BLE001
        raise ValueError(f"{where} cannot be read as an image ({error}): the EXR file is damaged.") from None
    shape = _box(header, "dataWindow")[2:][::-1]
    if any(c.shape != shape or c.dtype.kind != "f" for c in [*colours, *([] if alpha is None else [alpha])]):
        raise ValueError(
            f"{where}: its channels {', '.join(layer.colours)} are no numbers with a fraction for each pixel."
        )
    image = np.stack(colours * (3 // len(colours)), -1).astype(np.float32)
    return _placed(_converted(image, header, where), alpha, header)


def _box(header: dict[str, Any], name: str) -> tuple[int, int, int, int]:
    """Left, top, width and height of a window."""
    (x0, y0), (x1, y1) = ([int(v) for v in corner] for corner in header[name])
    return x0, y0, x1 - x0 + 1, y1 - y0 + 1


def _check_part(header: dict[str, Any], n_bytes: int, where: str) -> None:
    """Refuse what the library should not be asked to read; it reads all parts at once."""
    kind = getattr(header.get("type"), "name", str(header.get("type")))
    if kind not in ("scanlineimage", "tiledimage"):
        raise ValueError(f"{where} is a deep EXR file ({kind}). Flatten it.")
    if not header.get("channels"):
        raise ValueError(f"{where} cannot be read as an image: a part of the EXR file has no channels.")
    for name in ("dataWindow", "displayWindow"):
        *_, width, height = _box(header, name)
        # a small crop may lie in a large picture: only what is stored is measured by the file
        check_size(width, height, n_bytes if name == "dataWindow" else width * height, where)
        if name == "dataWindow" and width * height * len(header["channels"]) > _MOST_NUMBERS:
            raise ValueError(f"{where} has {len(header['channels'])} channels of {width} x {height} pixels: too many.")


def _check_picture(header: dict[str, Any], layer: _Layer, where: str) -> None:
    used = {*layer.colours, layer.alpha}
    if any(c.name in used and (c.step_x, c.step_y) != (1, 1) for c in header["channels"]):
        raise ValueError(f"{where}: {', '.join(layer.colours)} have fewer samples than pixels. Save it with full RGB.")
    aspect = float(header.get("pixelAspectRatio", 1.0))
    if not abs(aspect - 1) < 1e-3:  # rounding
        raise ValueError(f"{where}: its pixels are not square (pixelAspectRatio {aspect:g}). Resample it.")
    if "envmap" in header:
        raise ValueError(f"{where} is an environment map, which no pinhole camera has taken.")


def _picture(headers: list[dict[str, Any]], where: str) -> _Layer:
    """The layer that is the picture: the only one, or the only one that is called so."""
    layers = [layer for k, header in enumerate(headers) for layer in _layers(k, header)]
    for chosen in (
        [one for one in layers if not one.name],  # R, G, B as they are, of a part without a name
        [one for one in layers if _BEAUTY.match(one.name)],
        layers,
    ):
        colours = [one for one in chosen if len(one.colours) == 3] or chosen
        if len(colours) == 1:
            return colours[0]
    names = [c.name for header in headers for c in header["channels"]]
    found = f"several layers that may be it: {', '.join(one.name or 'R, G, B' for one in layers)}" if layers else "none"
    raise ValueError(
        f"{where}: which of its channels are the picture cannot be told; found: {found}. It has "
        f"{', '.join(names[:16])}{', ...' if len(names) > 16 else ''}. Save it with channels R, G, B."
    )


def _layers(k: int, header: dict[str, Any]) -> list[_Layer]:
    """Groups R, G, B or a single Y below one prefix; a part's name is that of what has no other."""
    prefixes: dict[str, dict[str, str]] = {}
    for channel in header["channels"]:
        prefix, _, last = channel.name.rpartition(".")
        prefixes.setdefault(prefix, {})[last.upper()] = channel.name
    found = []
    for prefix, names in prefixes.items():
        label = prefix or str(header.get("name", ""))
        alpha = names.get("A")
        if {"R", "G", "B"} <= set(names):
            found.append(_Layer(k, label, (names["R"], names["G"], names["B"]), alpha))
        elif "Y" in names and not {"RY", "BY", "X", "Z"} & set(names):  # X, Y, Z: colours of the eye, or a position
            found.append(_Layer(k, label, (names["Y"],), alpha))
    return found


def _converted(image: np.ndarray, header: dict[str, Any], where: str) -> np.ndarray:
    """Colours with the primaries of sRGB, where the header names others."""
    if "chromaticities" not in header:
        return image
    try:
        matrix = matrix_of_primaries(np.ravel(np.asarray(header["chromaticities"], np.float64)))
    except (ValueError, TypeError) as error:
        raise ValueError(f"{where}: its chromaticities are none ({error}). Save it with those of sRGB.") from None
    if matrix is None:
        return image
    with np.errstate(invalid="ignore", over="ignore"):  # what is not finite is told, or masked, later
        return image @ matrix.T.astype(np.float32)


def _placed(image: np.ndarray, alpha: np.ndarray | None, header: dict[str, Any]) -> Photograph:
    """The data window in the display window: what sticks out is cut off, what is missing has alpha 0."""
    x, y, width, height = _box(header, "dataWindow")
    left, top, full_width, full_height = _box(header, "displayWindow")
    x, y = x - left, y - top
    if alpha is not None:
        alpha = np.nan_to_num(np.clip(alpha.astype(np.float32), 0, 1))
        with np.errstate(invalid="ignore", over="ignore"):  # EXR's colours are premultiplied
            image = np.where(alpha[..., None] > 0, image / np.where(alpha > 0, alpha, 1)[..., None], image)
    if (x, y, width, height) == (0, 0, full_width, full_height):
        return Photograph(image, alpha)
    rows, columns = slice(max(y, 0), min(y + height, full_height)), slice(max(x, 0), min(x + width, full_width))
    placed = np.zeros((full_height, full_width, 3), np.float32)
    covered = np.zeros((full_height, full_width), np.float32)
    if rows.start < rows.stop and columns.start < columns.stop:
        source = slice(rows.start - y, rows.stop - y), slice(columns.start - x, columns.stop - x)
        placed[rows, columns] = image[source]
        covered[rows, columns] = 1 if alpha is None else alpha[source]
    complete = alpha is None and covered.all()
    return Photograph(placed, None if complete else covered)
