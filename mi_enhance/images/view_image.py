"""The photograph of one frame of a ``transforms.json``: image, mask, camera and light together."""

from __future__ import annotations

import contextlib
import dataclasses
import math
from pathlib import Path
from typing import Any

import numpy as np

from ..data.entries import number, pose
from ..data.image_files.photograph import Photograph, read_photograph, turned
from ..data.lights import Light, read_light
from ..system.messages import shortened
from .camera_entries import check_camera, intrinsics, merged
from .views import View

_SUFFIXES = (".exr", ".png", ".jpg", ".jpeg")
WHOLE = 0.99  # alpha from which a pixel shows nothing but the object: what is behind it is not known
_MASK = 0.2  # linear, half of the 8-bit range: mask files are drawn, not measured


def read_view(
    content: dict[str, Any], frame: dict[str, Any], folder: Path, split: str, where: str
) -> tuple[View, float | None]:
    """Read the photograph of a frame, and its mask.

    Parameters
    ----------
    content, frame : dict
        What the file says of all frames, and of this one.
    folder : Path
        Of the file.
    split : {"train", "test"}
    where : str
        What an error begins with.

    Returns
    -------
    view : View
    exposure : float or None
        By its EXIF, see :class:`mi_enhance.data.image_files.photograph.Photograph`.
    """
    both = merged(content, frame)
    check_camera(both, where)
    to_world = pose(frame.get("transform_matrix"), where)
    file = _image_file(folder, frame["file_path"], where, "file_path")
    photograph = _as_seen(read_photograph(file, where), both)
    image = photograph.image
    height, width = image.shape[:2]
    for key, size in (("w", width), ("h", height)):
        if key in both and both[key] != size:
            raise ValueError(
                f"{where}: {file.name} is {width} x {height} pixels, {key} says {shortened(both[key])}. Correct one."
            )
    camera = intrinsics(content, frame, width, height, where)
    counts = np.ones((height, width), bool) if photograph.alpha is None else photograph.alpha >= WHOLE
    if both.get("mask_path"):
        counts &= _read_mask(folder, both["mask_path"], (height, width), both, where)
    bad = np.count_nonzero(~np.isfinite(image[counts]))
    if bad:
        raise ValueError(
            f"{where}: {file.name} holds {bad} values that are NaN or infinite. Repair them, or give a mask_path "
            "that is black there."
        )
    ceiling = number(both, "ceiling", photograph.ceiling, where)
    if not ceiling > 0:
        raise ValueError(f"{where}: ceiling = {ceiling:g}; needed: positive, the linear value of what is saturated.")
    exposure = number(both, "exposure_factor", 1, where)
    if not exposure > 0:
        raise ValueError(f"{where}: exposure_factor = {exposure:g}; needed: positive, 2 for twice as bright a picture.")
    view = View(
        without_suffix(frame["file_path"]),
        image if exposure == 1 else image / np.float32(exposure),
        to_world,
        math.degrees(2 * math.atan(width / (2 * camera.focal_x))),
        counts,
        split,
        ceiling / exposure,
        (camera.center_x / width, camera.center_y / height),
        _light(both["light"], folder, where) if both.get("light") is not None else None,
    )
    view = view if camera.is_square else view.with_square_pixels(camera.focal_y / camera.focal_x)
    return view, photograph.exposure


def _light(entry: object, folder: Path, where: str) -> Light:
    """The light of a frame; the file of an environment map lies beside the poses."""
    light = read_light(entry, where)
    if light.kind != "envmap":
        return light
    return dataclasses.replace(light, file_path=str(_image_file(folder, light.file_path, where, "light, file_path")))


def _image_file(folder: Path, name: str, where: str, entry: str) -> Path:
    for spelling in dict.fromkeys((name, name.replace("\\", "/"))):  # Windows writes images\a.png
        candidates = [folder / spelling, *(folder / f"{spelling}{suffix}" for suffix in _SUFFIXES)]
        with contextlib.suppress(OSError, ValueError):  # a name that is too long, or holds what no name may
            for candidate in candidates:
                if candidate.is_file():
                    return candidate
            # A and a are one file on Windows and macOS, where the poses may come from; cameras write .JPG
            there = list(candidates[0].parent.iterdir())
            for candidate in candidates:
                alike = [p for p in there if p.name.casefold() == candidate.name.casefold() and p.is_file()]
                if len(alike) == 1:
                    return alike[0]
    raise FileNotFoundError(f'{where}: there is no image "{name[:200]}" beside the file. Check {entry}.')


def without_suffix(name: str) -> str:
    """The name of a view: a dot in it need not begin a suffix."""
    path = Path(name.replace("\\", "/"))
    return (path.with_suffix("") if path.suffix.lower() in _SUFFIXES else path).as_posix()


def _as_seen(photograph: Photograph, both: dict[str, Any]) -> Photograph:
    """The photograph turned as its EXIF says, unless w and h are those of the image as it is stored."""
    stored = photograph.image.shape[1], photograph.image.shape[0]
    if photograph.orientation >= 5 and (both.get("w"), both.get("h")) == stored and stored[0] != stored[1]:
        return photograph
    alpha = photograph.alpha if photograph.alpha is None else turned(photograph.alpha, photograph.orientation)
    return dataclasses.replace(photograph, image=turned(photograph.image, photograph.orientation), alpha=alpha)


def _read_mask(folder: Path, name: object, shape: tuple[int, int], both: dict[str, Any], where: str) -> np.ndarray:
    if not isinstance(name, str) or "\0" in name:
        raise ValueError(f"{where}: mask_path must be the name of a file; got {shortened(name)}.")
    mask = _as_seen(read_photograph(_image_file(folder, name, where, "mask_path"), where, is_mask=True), both)
    if mask.image.shape[:2] != shape:
        sizes = [f"{s[1]} x {s[0]}" for s in (mask.image.shape, shape)]
        raise ValueError(f"{where}: mask {name} is {sizes[0]} pixels, its image {sizes[1]}. Give it the same size.")
    white = mask.image.max(-1) > _MASK  # false for NaN
    if mask.alpha is None:
        return white
    opaque = mask.alpha >= 0.5
    # drawn in one colour, any, on a transparent ground: then alpha alone is the mask
    return opaque & white if (white & opaque).any() or opaque.all() else opaque
