"""Small photographs of all kinds, and damage that gets past checksums: what ``test_photograph_fuzzing.py`` reads."""

from __future__ import annotations

import io
import json
import struct
import sys
import warnings
import zlib
from pathlib import Path

import fuzzing
import numpy as np
import OpenEXR
from PIL import Image, ImageCms

import mi_enhance  # noqa: F401  (before mitsuba)

import mitsuba as mi  # isort: skip

from mi_enhance.benchmark.timing import peak_megabytes
from mi_enhance.images.view_files import read_views

WIDTH, HEIGHT = 9, 7
_EXR_ATTRIBUTE = b"box2i\0"  # type of the windows


def _pixels(channels: int = 3) -> np.ndarray:
    return np.random.default_rng(0).integers(0, 256, (HEIGHT, WIDTH, channels), np.uint8)


def _image(image: Image.Image, kind: str, **how) -> bytes:
    file = io.BytesIO()
    image.save(file, kind, **how)
    return file.getvalue()


def png(header: tuple, pixels: bytes, *chunks: tuple[bytes, bytes]) -> bytes:
    """A PNG file: IHDR's numbers, rows with their filters, and more chunks in front of them."""
    parts = [(b"IHDR", struct.pack(">IIBBBBB", *header)), *chunks, (b"IDAT", zlib.compress(pixels)), (b"IEND", b"")]
    return b"\x89PNG\r\n\x1a\n" + b"".join(map(_chunk, parts))


def _chunk(part: tuple[bytes, bytes]) -> bytes:
    name, data = part
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))


def rows(pixels: np.ndarray) -> bytes:
    """Rows of a PNG file, without filters; 16-bit numbers have the high byte first."""
    big = pixels.astype(pixels.dtype.newbyteorder(">")).reshape(len(pixels), -1)
    return b"".join(b"\0" + row.tobytes() for row in big)


def exr(path: Path, channels: dict, **header) -> bytes:
    """An EXR file of one part."""
    head = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, **header}
    with OpenEXR.File(head, channels) as file:
        file.write(str(path))
    return path.read_bytes()


def window(x: int, y: int, width: int, height: int) -> tuple[np.ndarray, np.ndarray]:
    """A window as the header has it."""
    return np.array([x, y], np.int32), np.array([x + width - 1, y + height - 1], np.int32)


def _parts(path: Path, rgb: np.ndarray) -> bytes:
    head = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    depth = OpenEXR.Part({**head, "name": "depth"}, {"Z": rgb[..., 0].copy()})
    with OpenEXR.File([depth, OpenEXR.Part({**head, "name": "beauty"}, {"RGB": rgb})]) as file:
        file.write(str(path))
    return path.read_bytes()


def _deep(path: Path) -> bytes:
    samples = np.empty((HEIGHT, WIDTH), object)
    for k, index in enumerate(np.ndindex(samples.shape)):
        samples[index] = np.full(k % 3 + 1, 0.5, np.float32)
    deep = {"type": OpenEXR.deepscanline, "compression": OpenEXR.ZIPS_COMPRESSION}
    return exr(path, {c: samples.copy() for c in "RGBA"}, **deep)


def samples(folder: Path) -> dict[str, bytes]:
    """Intact files by name; what is deep or CMYK is refused as it is."""
    rgb = _pixels().astype(np.float32) / 255
    path, wide = folder / "sample.exr", np.random.default_rng(1).random((70, 80, 3), np.float32)
    icc = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    exif = Image.Exif()
    exif[0x0112] = 6
    profile = (b"iCCP", b"p\0\0" + zlib.compress(icc))
    colour, both = Image.fromarray(_pixels()), {"exif": exif, "icc_profile": icc}
    sixteen = _pixels(4).astype(np.uint16) * 257
    compressions = ("NO", "RLE", "ZIPS", "PIZ", "PXR24", "B44", "B44A", "DWAA", "DWAB")
    tiles = {"type": OpenEXR.tiledimage, "tiles": OpenEXR.TileDescription()}
    return {
        **{
            f"{c}.exr": exr(path, {"RGB": wide}, compression=getattr(OpenEXR, f"{c}_COMPRESSION")) for c in compressions
        },
        "zip.exr": exr(path, {"RGBA": np.concatenate([rgb, np.ones_like(rgb[..., :1])], 2), "Z": rgb[..., 0].copy()}),
        "half.exr": exr(path, {"RGB": rgb.astype(np.float16)}),
        "tiled.exr": exr(path, {"RGB": wide}, **tiles),
        "overscan.exr": exr(path, {"RGB": rgb}, dataWindow=window(-2, -1, 9, 7), displayWindow=window(0, 0, 5, 4)),
        "parts.exr": _parts(path, rgb),
        "deep.exr": _deep(path),
        "rgb.png": _image(colour, "PNG"),
        "palette.png": _image(colour.quantize(16), "PNG", transparency=3),
        "grey.png": png((WIDTH, HEIGHT, 16, 0, 0, 0, 0), rows(sixteen[..., 0]), (b"tRNS", b"\0\5")),
        "rgba16.png": png((WIDTH, HEIGHT, 16, 6, 0, 0, 0), rows(sixteen), profile, (b"sBIT", b"\x0c\x0c\x0c\x10")),
        "gamma.png": png((WIDTH, HEIGHT, 8, 2, 0, 0, 0), rows(_pixels()), (b"gAMA", b"\0\1\x86\xa0")),
        "baseline.jpg": _image(colour, "JPEG", **both),
        "progressive.jpg": _image(colour.resize((70, 50)), "JPEG", progressive=True),
        "grey.jpg": _image(colour.convert("L"), "JPEG"),
        "cmyk.jpg": _image(colour.convert("CMYK"), "JPEG"),
        FILE: json.dumps(poses("rgb.png", k1=0.0, fl_x=9, fl_y=9.1, w=WIDTH, h=HEIGHT, mask_path="rgb.png")).encode(),
    }


FILE = "transforms.json"


def poses(file_path: str, **entries) -> dict:
    """The content of a transforms.json with one frame."""
    frame = {"file_path": file_path, "transform_matrix": np.eye(4).tolist()}
    frame |= {name: entries.pop(name) for name in ("mask_path", "split") if name in entries}
    return {**({} if "fl_x" in entries else {"camera_angle_x": 0.7}), **entries, "frames": [frame]}


def damage(name: str, content: bytes, rng: np.random.Generator) -> bytes:
    """A copy with something wrong; half of the time where checksums and lengths still hold."""
    if name == FILE:
        return fuzzing.damage(content, rng)
    if rng.random() < 0.5:
        return fuzzing._damaged_bytes(content, rng)
    if name.endswith(".png"):
        return _damaged_png(content, rng)
    if name.endswith(".exr"):
        return _damaged_exr(content, rng)
    return fuzzing._damaged_bytes(fuzzing._damaged_bytes(content, rng), rng)


def _damaged_png(content: bytes, rng: np.random.Generator) -> bytes:
    place, parts = 8, []
    while place < len(content):
        (length,) = struct.unpack_from(">I", content, place)
        parts.append((content[place + 4 : place + 8], content[place + 8 : place + 8 + length]))
        place += 12 + length
    k = int(rng.integers(len(parts)))
    name, data = parts[k]
    kind = rng.integers(5)
    if kind == 0 and name == b"IDAT":
        data = zlib.compress(fuzzing._damaged_bytes(zlib.decompress(data), rng))
    elif kind == 1:
        del parts[k]
        return content[:8] + b"".join(map(_chunk, parts))
    elif kind == 2:
        parts.insert(int(rng.integers(len(parts))), parts[k])
        return content[:8] + b"".join(map(_chunk, parts))
    elif kind == 3:
        names = [b"tRNS", b"PLTE", b"gAMA", b"cHRM", b"sBIT", b"cICP", b"iCCP", b"eXIf", b"acTL", b"bKGD"]
        parts.insert(1, (names[rng.integers(len(names))], rng.bytes(int(rng.integers(0, 40)))))
        return content[:8] + b"".join(map(_chunk, parts))
    else:
        data = fuzzing._damaged_bytes(data, rng)
    parts[k] = name, data
    return content[:8] + b"".join(map(_chunk, parts))


def _damaged_exr(content: bytes, rng: np.random.Generator) -> bytes:
    """Numbers of the header: windows, sampling of channels, tiles, compression, flags, offsets of chunks."""
    changed = bytearray(content)
    value = struct.pack("<i", [0, 1, -1, 2, 7, 255, 4096, 65536, 2**30, 2**31 - 1, -(2**31)][rng.integers(11)])
    kind = rng.integers(5)
    windows = [k for k in range(len(content)) if content.startswith(_EXR_ATTRIBUTE, k)]
    if kind < 2 and windows:
        place = windows[rng.integers(len(windows))] + len(_EXR_ATTRIBUTE) + 4 + 4 * int(rng.integers(4))
    elif kind == 2:
        place = content.find(b"chlist\0") + 11 + int(rng.integers(60))
    elif kind == 3:
        place = max(content.find(b"tiledesc\0"), content.find(b"compression\0")) + 12 + int(rng.integers(24))
    else:
        place = 4 + int(rng.integers(min(len(content) - 8, 700)))
    changed[place : place + 4] = value
    return bytes(changed)


def attempt(folder: Path, name: str) -> str:
    """``"read"``, ``"refused"``, or what went wrong: another error, or a message that does not say where."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            views = read_views(folder)
    except (ValueError, FileNotFoundError) as error:
        return "refused" if str(error).startswith("read_views(") else f"message {error}"
    except Exception as error:  # noqa: BLE001  (what this file is here to find)
        return f"{type(error).__name__}: {error}"
    whole = all(np.isfinite(v.image).all() and v.mask.any() and v.image.dtype == np.float32 for v in views)
    return "read" if whole else "read, but with NaN or without a pixel"


def run(folder: Path, names: list[str], inputs: int, seed: int) -> dict[str, float]:
    """Read `inputs` damaged copies of each sample; the last one is in the folder, and its number in ``tried``."""
    mi.set_variant("llvm_ad_rgb")
    intact, result = samples(folder), {"tried": 0, "read": 0, "refused": 0, "wrong": 0}
    for name in names or intact:
        rng = np.random.default_rng([seed, zlib.crc32(name.encode())])
        (folder / "rgb.png").write_bytes(intact["rgb.png"])
        (folder / FILE).write_text(json.dumps(poses(name, mask_path=name if seed % 2 else "")))
        for _ in range(inputs):
            damaged = damage(name, intact[name], rng)
            (folder / name).write_bytes(damaged)
            (folder / "tried").write_text(f"{name} {result['tried']}")
            outcome = attempt(folder, name)
            result["tried"] += 1
            result[outcome if outcome in ("read", "refused") else "wrong"] += 1
            if outcome not in ("read", "refused"):
                (folder / f"wrong-{result['tried']}-{name}").write_bytes(damaged)
                print(f"{name}: {outcome[:300]}", file=sys.stderr, flush=True)
    return result | {"megabytes": peak_megabytes()}


if __name__ == "__main__":
    print(json.dumps(run(Path(sys.argv[1]), sys.argv[4:], int(sys.argv[2]), int(sys.argv[3]))))
