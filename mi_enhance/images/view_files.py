"""Files of photographs with poses: images and one ``transforms.json``, whose entries are in docs/images.md."""

from __future__ import annotations

import contextlib
import dataclasses
import itertools
import json
import math
import unicodedata
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np

from ..data.image_files.colour_spaces import decode_srgb
from ..data.image_files.photograph import Photograph, read_photograph, turned
from ..output.srgb import encode_srgb
from ..system.messages import shortened
from .camera_entries import check_camera, check_same_for_all, intrinsics, merged, number, pose, unknown_entries
from .own_files import OwnFiles, inner_name
from .pose_file import FILE, pose_files, read_poses, splits
from .views import View

_SUFFIXES = (".exr", ".png", ".jpg", ".jpeg")
_WHOLE = 0.99  # alpha from which a pixel shows nothing but the object: what is behind it is not known
_SAME_EXPOSURE = 1.1  # more is another setting of the camera, less its rounding
_MASK = 0.2  # linear, half of the 8-bit range: mask files are drawn, not measured


def read_views(path: str | Path, *, factor: int = 1) -> list[View]:
    """Read photographs with poses.

    Parameters
    ----------
    path : str or Path
        A ``transforms.json`` or the folder that holds it, or the three files of a NeRF data set; the entries are
        described in ``docs/images.md``.
    factor : int
        Each image is made so many times smaller as soon as it is read, see :meth:`View.smaller`.

    Returns
    -------
    list of View
        A view without a pixel that counts is left out, with a warning.

    Raises
    ------
    FileNotFoundError, ValueError
        For a missing or damaged file or image, wrong JSON, no frames, a camera that is no pinhole, a matrix that is
        not a rotation and translation, images of the wrong size, with NaN outside of the mask, or all without a pixel
        that counts.

    Examples
    --------
    >>> views = read_views("photos/transforms.json")  # doctest: +SKIP
    """
    where = f'read_views("{path}")'
    files = pose_files(Path(path), where)
    views: list[View] = []
    paths: list[str] = []
    exposures: set[float] = set()
    poses = {file: read_poses(file, where) for file in files}
    contents = [entries for content, frames in poses.values() for entries in (content, *frames)]
    check_same_for_all([merged(content, frame) for content, frames in poses.values() for frame in frames], where)
    for file, (content, frames) in poses.items():
        at = f"{where}, {file.name}" if len(files) > 1 else where
        of_frames = [files[file]] * len(frames) if files[file] else splits(content, frames, at)
        for k, (frame, own) in enumerate(zip(frames, of_frames, strict=True)):
            if own:
                paths.append(frame["file_path"])
                view, exposure = _view(content, frame, file.parent, own, f"{at}, frame {k}")
                views.append(view.smaller(factor))
                exposures |= {exposure} if exposure else set()
    unknown = sorted({name for entries in contents for name in unknown_entries(entries)})
    if unknown:
        warnings.warn(f"{where}: entries that are not known are passed over: {', '.join(unknown)}", stacklevel=2)
    if exposures and max(exposures) > _SAME_EXPOSURE * min(exposures):
        warnings.warn(
            f"{where}: by their EXIF (time, f-number, ISO) some photographs are exposed "
            f"{max(exposures) / min(exposures):.3g} times as much as others, which is not modelled. Bring them to one "
            "brightness if they are not.",
            stacklevel=2,
        )
    if not views:
        raise ValueError(f"{where}: train_filenames and the like name no frame. Give the names that file_path has.")
    return _those_that_count(_with_names(views, where), paths, where)


def _view(
    content: dict[str, Any], frame: dict[str, Any], folder: Path, split: str, where: str
) -> tuple[View, float | None]:
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
    counts = np.ones((height, width), bool) if photograph.alpha is None else photograph.alpha >= _WHOLE
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
    view = View(
        _without_suffix(frame["file_path"]),
        image,
        to_world,
        math.degrees(2 * math.atan(width / (2 * camera.focal_x))),
        counts,
        split,
        ceiling,
        (camera.center_x / width, camera.center_y / height),
    )
    view = view if camera.is_square else view.with_square_pixels(camera.focal_y / camera.focal_x)
    return view, photograph.exposure


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


def _without_suffix(name: str) -> str:
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


def _with_names(views: list[View], where: str) -> list[View]:
    names = [v.name for v in views]
    twice = sorted({n for n in names if names.count(n) > 1})
    if twice:
        raise ValueError(f'{where}: "{twice[0]}" is the name of two frames. Give each image a name of its own.')
    return views


def _those_that_count(views: list[View], paths: list[str], where: str) -> list[View]:
    """The views with a pixel that counts."""
    empty = [path for view, path in zip(views, paths, strict=True) if not view.mask.any()]
    if not empty:
        return views
    names = f"{', '.join(empty[:5])}{', ...' if len(empty) > 5 else ''}"
    advice = f"White (255, not 1) is what counts in a mask, opaque (alpha above {_WHOLE}) in a photograph."
    if len(empty) == len(views):
        raise ValueError(f"{where}: no pixel counts in any of the {len(views)} images ({names}). {advice}")
    warnings.warn(
        f"{where}: {len(empty)} of {len(views)} views left out, no pixel counts: {names}. {advice}", stacklevel=3
    )
    return [view for view in views if view.mask.any()]


def write_views(views: Sequence[View], folder: str | Path, *, suffix: str = ".exr") -> Path:
    """Write photographs with poses, as :func:`read_views` reads them.

    Everything lies inside the folder, whatever the views are called: ``../images/a`` is written as ``images/a``. Files
    that this function has written there before are replaced, no others.

    Parameters
    ----------
    views : sequence of View
    folder : str or Path
        Made if missing.
    suffix : {".exr", ".png"}
        Linear float32, or 8-bit sRGB: clipped to [0, 1].

    Returns
    -------
    Path
        Of ``transforms.json``, which is written last.

    Raises
    ------
    ValueError
        If the suffix is unknown, a PNG file were to hold NaN, or a file of somebody else has the name of one that is to
        be written; then nothing is.

    Examples
    --------
    >>> write_views(views, "photos")  # doctest: +SKIP
    """
    if suffix not in (".exr", ".png"):
        raise ValueError(f'write_views(): suffix "{suffix}" is unknown. Choose one of: .exr, .png.')
    own, frames, taken = OwnFiles(Path(folder), "write_views()"), [], {FILE}
    for view in views:
        if suffix == ".png" and np.isnan(view.image).any():  # which has no NaN; under the mask it has become 0
            raise ValueError(f'write_views(): view "{view.name}" holds NaN where it counts. Mask it, or write .exr.')
        width, height = view.size
        frame: dict[str, Any] = {
            "file_path": _free_name(inner_name(view.name), suffix, taken),
            "transform_matrix": view.to_world.tolist(),
            "camera_angle_x": math.radians(view.fov),
            "w": width,
            "h": height,
            "cx": view.principal_point[0] * width,
            "cy": view.principal_point[1] * height,
            "split": view.split,
        }
        if not view.mask.all():
            frame["mask_path"] = _free_name(f"{inner_name(view.name)}_mask", ".png", taken)
        if suffix == ".exr" and math.isfinite(view.ceiling):
            frame["ceiling"] = view.ceiling
        elif view.ceiling < 1:  # of a PNG file it is 1 else; where it is, as a number of 8 bits
            frame["ceiling"] = float(decode_srgb(np.round(encode_srgb(np.array(view.ceiling)) * 255) / 255))
        frames.append(frame)
    for name in [FILE, *(f[key] for f in frames for key in ("file_path", "mask_path") if key in f)]:
        own.check(name)  # all, before the first is written
    for view, frame in zip(views, frames, strict=True):
        _write_image(view.image, own, frame["file_path"])
        if "mask_path" in frame:
            _write_image(np.repeat(view.mask[..., None], 3, 2).astype(np.float32), own, frame["mask_path"])
    with own.replacing(FILE) as temporary:
        Path(temporary).write_text(json.dumps({"frames": frames}, indent=1) + "\n", encoding="utf-8")
    return own.folder / FILE


def _free_name(stem: str, suffix: str, taken: set[str]) -> str:
    """A name that no other file of the folder has, on no system; it is added to those that are taken."""
    for k in itertools.count(1):
        name = f"{stem}{suffix}" if k == 1 else f"{stem}_{k}{suffix}"
        key = unicodedata.normalize("NFKC", name).casefold()  # A and a are one file on Windows and macOS
        if key not in taken:
            break
    taken.add(key)
    return name


def _write_image(image: np.ndarray, own: OwnFiles, name: str) -> None:
    if name.endswith(".png"):
        bitmap = mi.Bitmap(np.round(encode_srgb(image) * 255).astype(np.uint8))
    else:
        bitmap = mi.Bitmap(np.ascontiguousarray(image, np.float32))
    with own.replacing(name) as temporary:
        bitmap.write(temporary)
