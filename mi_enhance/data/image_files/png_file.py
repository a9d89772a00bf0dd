"""PNG photographs: their chunks first (W3C, Portable Network Graphics, third edition), then the pixels."""

from __future__ import annotations

import dataclasses
import struct
import zlib
from pathlib import Path

import mitsuba as mi
import numpy as np

from .colour_spaces import CICP_CURVES, CICP_PRIMARIES, LINEAR, ColourSpace, decode_srgb, matrix_of_primaries, power
from .exif import exposure_of, orientation_of, read_tags
from .icc_profile import read_icc_profile
from .photograph import Photograph, check_size, of_integers

_CHANNELS = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}  # by colour type
_DEPTHS = {0: (1, 2, 4, 8, 16), 2: (8, 16), 3: (1, 2, 4, 8), 4: (8, 16), 6: (8, 16)}
# Starts and steps of the seven passes of an interlaced image: x, y, step in x, step in y.
_ADAM7 = ((0, 0, 8, 8), (4, 0, 8, 8), (0, 4, 4, 8), (2, 0, 4, 4), (0, 2, 2, 4), (1, 0, 2, 2), (0, 1, 1, 2))
_SRGB_GAMMA = 45455  # 1 / 2.2 in the file's units: what programs write for sRGB
_LARGEST_PROFILE = 1 << 22  # bytes: profiles of cameras have some kB


def read_png(file: Path, where: str, is_linear: bool = False) -> Photograph:
    """Read a PNG file; its gamma, primaries, profile and orientation are honoured or refused.

    Raises
    ------
    ValueError
        If it is damaged, or its colours have a meaning that cannot be honoured.
    """
    content = file.read_bytes()
    try:
        chunks = _chunks(content)
        header = _Header(*struct.unpack(">IIBBBBB", chunks[b"IHDR"][0]))
    except (ValueError, KeyError, struct.error) as error:
        raise ValueError(f"{where} cannot be read as an image ({error}): the PNG file is damaged.") from None
    if header.depth not in _DEPTHS.get(header.colour, ()) or header.interlaced > 1:
        raise ValueError(f"{where} cannot be read as an image: its PNG header is damaged.")
    check_size(header.width, header.height, len(content), where)
    try:
        space = LINEAR if is_linear else _space(chunks)
        ceiling = _ceiling(chunks, header)
    except (ValueError, struct.error, zlib.error) as error:
        raise ValueError(f"{where}: its colours cannot be told: {error}. Convert it to sRGB.") from None
    _check_pixels(chunks, header, where)
    try:
        bitmap = mi.Bitmap(str(file))
    except RuntimeError as error:
        raise ValueError(f"{where} cannot be read as an image ({str(error).splitlines()[-1]}).") from None
    result = of_integers(np.array(bitmap), space, ceiling)
    tags = read_tags(chunks.get(b"eXIf", [b""])[0])
    return dataclasses.replace(result, orientation=orientation_of(tags), exposure=exposure_of(tags))


@dataclasses.dataclass(frozen=True)
class _Header:
    width: int
    height: int
    depth: int
    colour: int
    compression: int
    filters: int
    interlaced: int

    @property
    def n_bytes(self) -> int:
        """Bytes of all rows before compression, each with one for its filter."""
        bits = self.depth * _CHANNELS[self.colour]
        passes = _ADAM7 if self.interlaced else ((0, 0, 1, 1),)
        sizes = [((self.width - x + dx - 1) // dx, (self.height - y + dy - 1) // dy) for x, y, dx, dy in passes]
        return sum(h * (1 + (w * bits + 7) // 8) for w, h in sizes if w > 0 and h > 0)


def _chunks(content: bytes) -> dict[bytes, list[bytes]]:
    """Contents of all chunks by name; a checksum that is wrong is an error."""
    found: dict[bytes, list[bytes]] = {}
    place = 8
    while b"IEND" not in found:
        length, name = struct.unpack_from(">I4s", content, place)
        data = content[place + 8 : place + 8 + length]
        (checksum,) = struct.unpack_from(">I", content, place + 8 + length)
        if zlib.crc32(data, zlib.crc32(name)) != checksum:
            raise ValueError(f"the checksum of its part {name.decode('latin-1')!r} is wrong")
        found.setdefault(name, []).append(data)
        place += 12 + length
    return found


def _check_pixels(chunks: dict[bytes, list[bytes]], header: _Header, where: str) -> None:
    """Refuse pixels that are cut off: the library would fill them with black."""
    stream, n_bytes = zlib.decompressobj(), 0
    try:
        for data in chunks.get(b"IDAT", []):
            while data:  # in steps of 16 MB: what is decompressed is only counted
                n_bytes += len(stream.decompress(data, 1 << 24))
                data = stream.unconsumed_tail
                if n_bytes > header.n_bytes:
                    break
    except zlib.error as error:
        raise ValueError(f"{where} cannot be read as an image ({error}): the PNG file is damaged.") from None
    if n_bytes != header.n_bytes or not stream.eof:
        raise ValueError(f"{where} cannot be read as an image: {n_bytes} bytes of pixels instead of {header.n_bytes}.")


def _space(chunks: dict[bytes, list[bytes]]) -> ColourSpace:
    """Return the colour space: cICP before iCCP before sRGB before gAMA and cHRM, as the standard says."""
    if b"cICP" in chunks:
        primaries, curve, matrix, full = struct.unpack(">BBBB", chunks[b"cICP"][0])
        if primaries not in CICP_PRIMARIES or curve not in CICP_CURVES or matrix or full != 1:
            raise ValueError(f"cICP {primaries}, {curve}, {matrix}, {full} is not known")
        return ColourSpace(CICP_CURVES[curve], matrix_of_primaries(CICP_PRIMARIES[primaries]))
    if b"iCCP" in chunks:
        _, _, rest = chunks[b"iCCP"][0].partition(b"\0")
        return read_icc_profile(zlib.decompressobj().decompress(rest[1:], _LARGEST_PROFILE))
    if b"sRGB" in chunks:
        return ColourSpace(decode_srgb)
    matrix = None
    if b"cHRM" in chunks:
        values = np.array(struct.unpack(">8I", chunks[b"cHRM"][0])) / 1e5
        matrix = matrix_of_primaries(np.roll(values, -2))  # the file has white first
    if b"gAMA" not in chunks:
        return ColourSpace(decode_srgb, matrix)
    (gamma,) = struct.unpack(">I", chunks[b"gAMA"][0])
    if not 10_000 <= gamma <= 1_000_000:
        raise ValueError(f"its gamma is {gamma / 1e5:g}")
    return ColourSpace(decode_srgb if gamma == _SRGB_GAMMA and matrix is None else power(1e5 / gamma), matrix)


def _ceiling(chunks: dict[bytes, list[bytes]], header: _Header) -> int:
    """The largest number, where fewer bits than the file's are significant."""
    top, depth = (65535, 16) if header.depth == 16 else (255, 8)
    if b"sBIT" not in chunks or header.depth < 8 or header.colour == 3:
        return top
    n = len(chunks[b"sBIT"][0]) - (header.colour in (4, 6))
    bits = min([*chunks[b"sBIT"][0][: max(n, 0)], depth])
    return ((1 << bits) - 1) << (depth - bits) if bits > 0 else top
