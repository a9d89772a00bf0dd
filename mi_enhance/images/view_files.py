"""Files of photographs with poses: images and one ``transforms.json``, whose entries are in docs/images.md."""

from __future__ import annotations

import itertools
import json
import math
import unicodedata
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import mitsuba as mi
import numpy as np

from ..data.image_files.colour_spaces import decode_srgb
from ..output.srgb import encode_srgb
from .camera_entries import check_camera, check_same_for_all, merged, unknown_entries
from .own_files import OwnFiles, inner_name
from .pose_file import FILE, pose_files, read_poses, splits
from .view_image import WHOLE, read_view, without_suffix
from .views import View

_SAME_EXPOSURE = 1.1  # more is another setting of the camera, less its rounding


class ViewFiles(Sequence[View]):
    """Photographs with poses that are read when they are asked for, and not kept.

    Parameters
    ----------
    path : str or Path
        A ``transforms.json`` or the folder that holds it, or the three files of a NeRF data set; the entries are
        described in ``docs/images.md``.
    factor : int
        Each image is made so many times smaller as soon as it is read, see :meth:`View.smaller`.

    Attributes
    ----------
    splits, names : list of str
        Of all views, known without reading them.

    Raises
    ------
    FileNotFoundError, ValueError
        As :func:`read_views`, for what the file says; for an image when it is read.

    Examples
    --------
    >>> photos = ViewFiles("photos")  # doctest: +SKIP
    >>> found = me.fit_images(scene, photos)  # doctest: +SKIP
    """

    def __init__(self, path: str | Path, *, factor: int = 1):
        where = f'read_views("{path}")'
        files = pose_files(Path(path), where)
        poses = {file: read_poses(file, where) for file in files}
        check_same_for_all([merged(content, frame) for content, frames in poses.values() for frame in frames], where)
        self._frames: list[_Frame] = []
        for file, (content, frames) in poses.items():
            at = f"{where}, {file.name}" if len(files) > 1 else where
            of_frames = [files[file]] * len(frames) if files[file] else splits(content, frames, at)
            for k, (frame, own) in enumerate(zip(frames, of_frames, strict=True)):
                if own:
                    check_camera(merged(content, frame), f"{at}, frame {k}")
                    self._frames.append(_Frame(content, frame, file.parent, own, f"{at}, frame {k}"))
        if not self._frames:
            raise ValueError(f"{where}: train_filenames and the like name no frame. Give the names that file_path has.")
        self._where, self._factor = where, factor
        self._exposures: set[float] = set()
        self.splits = [f.split for f in self._frames]
        self.names = [without_suffix(f.frame["file_path"]) for f in self._frames]
        twice = sorted({n for n in self.names if self.names.count(n) > 1})
        if twice:
            raise ValueError(f'{where}: "{twice[0]}" is the name of two frames. Give each image a name of its own.')
        contents = [entries for content, frames in poses.values() for entries in (content, *frames)]
        unknown = sorted({name for entries in contents for name in unknown_entries(entries)})
        if unknown:
            warnings.warn(f"{where}: entries that are not known are passed over: {', '.join(unknown)}", stacklevel=3)

    def __len__(self) -> int:
        return len(self._frames)

    def __getitem__(self, k):
        if isinstance(k, slice):
            return [self[i] for i in range(*k.indices(len(self)))]
        f = self._frames[k]
        view, exposure = read_view(f.content, f.frame, f.folder, f.split, f.where)
        self._note(exposure)
        return view.smaller(self._factor)

    def _note(self, exposure: float | None) -> None:
        """Warn, once, if photographs were exposed differently by what their EXIF says."""
        found = self._exposures
        was_told = bool(found) and max(found) > _SAME_EXPOSURE * min(found)
        found |= {exposure} if exposure else set()
        if found and not was_told and max(found) > _SAME_EXPOSURE * min(found):
            warnings.warn(
                f"{self._where}: by their EXIF (time, f-number, ISO) some photographs are exposed "
                f"{max(found) / min(found):.3g} times as much as others. If they are, say so by exposure_factor, bring "
                "them to one brightness, or let the fit seek the factors (exposures).",
                stacklevel=4,
            )


class _Frame(NamedTuple):
    content: dict[str, Any]
    frame: dict[str, Any]
    folder: Path
    split: str
    where: str


def read_views(path: str | Path, *, factor: int = 1) -> list[View]:
    """Read photographs with poses.

    Parameters
    ----------
    path, factor
        As of :class:`ViewFiles`, which reads them one at a time: for more than memory holds.

    Returns
    -------
    list of View
        A view without a pixel that counts is left out, with a warning.

    Raises
    ------
    FileNotFoundError, ValueError
        For a missing or damaged file or image, wrong JSON, no frames, a camera that is no pinhole, a matrix that is
        not a rotation and translation, a wrong light, images of the wrong size, with NaN outside of the mask, or all
        without a pixel that counts.

    Examples
    --------
    >>> views = read_views("photos/transforms.json")  # doctest: +SKIP
    """
    files = ViewFiles(path, factor=factor)
    paths = [f.frame["file_path"] for f in files._frames]
    return _those_that_count(list(files), paths, f'read_views("{path}")')


def _those_that_count(views: list[View], paths: list[str], where: str) -> list[View]:
    """The views with a pixel that counts."""
    empty = [path for view, path in zip(views, paths, strict=True) if not view.mask.any()]
    if not empty:
        return views
    names = f"{', '.join(empty[:5])}{', ...' if len(empty) > 5 else ''}"
    advice = f"White (255, not 1) is what counts in a mask, opaque (alpha above {WHOLE}) in a photograph."
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
        if view.light:
            frame["light"] = view.light.entry()
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
