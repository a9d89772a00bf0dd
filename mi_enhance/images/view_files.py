"""Files of photographs with poses: images and one ``transforms.json``, whose entries are in docs/images.md."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path

import mitsuba as mi
import numpy as np

from ..output.srgb import encode_srgb
from ..system.files import read_json, replacing, require_file
from .views import View

FILE = "transforms.json"
SPLITS = ("train", "test")
_RIGID = 1e-3  # largest deviation from a rotation: files hold 4 to 7 digits
_SQUARE = 2e-3  # relative difference of fl_x and fl_y that is a rounded calibration, not another pixel shape
_FLOATS = (mi.Struct.Type.Float16, mi.Struct.Type.Float32, mi.Struct.Type.Float64)


def read_views(path) -> list[View]:
    """Read photographs with poses.

    Parameters
    ----------
    path : str or Path
        A ``transforms.json`` or the folder that holds it; its entries are described in ``docs/images.md``.

    Returns
    -------
    list of View

    Raises
    ------
    FileNotFoundError, ValueError
        For a missing file or image, wrong JSON, no frames, a matrix that is not a rotation and translation, images of
        the wrong size, with NaN, or without a single pixel that counts.

    Examples
    --------
    >>> views = read_views("photos/transforms.json")  # doctest: +SKIP
    """
    path = Path(path) / FILE if Path(path).is_dir() else Path(path)
    where = f'read_views("{path}")'
    content = read_json(require_file(path, where), "read_views()", ["frames"])
    frames = content["frames"]
    if not isinstance(frames, list) or not frames:
        raise ValueError(f"{where}: frames must be a list of at least one frame; got {_short(frames)}.")
    views = [_view(content, frame, path.parent, f"{where}, frame {k}") for k, frame in enumerate(frames)]
    names = [v.name for v in views]
    twice = sorted({n for n in names if names.count(n) > 1})
    if twice:
        raise ValueError(f'{where}: "{twice[0]}" is the name of two frames. Give each image a file of its own.')
    return views


def _view(content: dict, frame, folder: Path, where: str) -> View:
    if not isinstance(frame, dict) or not isinstance(frame.get("file_path"), str):
        raise ValueError(f"{where}: must be an object with file_path; got {_short(frame)}.")
    both = {**content, **frame}  # a frame's own camera wins
    for name in ("k1", "k2", "k3", "k4", "p1", "p2"):
        if both.get(name):
            raise ValueError(
                f"{where}: lens distortion ({name} = {both[name]}) is not modelled. Undistort the images, set it to 0."
            )
    file = _image_file(folder, frame["file_path"], where)
    image, ceiling = _read_image(file, where)
    height, width = image.shape[:2]
    for key, size in (("w", width), ("h", height)):
        if key in both and both[key] != size:
            raise ValueError(f"{where}: {file.name} is {width} x {height} pixels, {key} says {both[key]}. Correct one.")
    split = frame.get("split", "train")
    if split not in SPLITS:
        raise ValueError(f'{where}: split "{split}" is unknown. Choose one of: {", ".join(SPLITS)}.')
    mask = _read_mask(folder, frame["mask_path"], image, where) if frame.get("mask_path") else None
    center = (_number(both, "cx", width / 2, where) / width, _number(both, "cy", height / 2, where) / height)
    return View(
        Path(frame["file_path"]).with_suffix("").as_posix(),
        image,
        _pose(frame.get("transform_matrix"), where),
        _fov(both, width, where),
        mask,
        split,
        ceiling,
        center,
    )


def _image_file(folder: Path, name: str, where: str) -> Path:
    for candidate in (folder / name, folder / f"{name}.exr", folder / f"{name}.png"):
        if candidate.is_file():
            return candidate
    raise FileNotFoundError(f'{where}: there is no image "{name}" beside the file. Check file_path.')


def _read_image(file: Path, where: str) -> tuple[np.ndarray, float]:
    """Linear RGB, and where the camera saturates."""
    try:
        bitmap = mi.Bitmap(str(file))
    except RuntimeError as error:
        raise ValueError(f"{where}: {file.name} cannot be read as an image ({str(error).splitlines()[-1]}).") from None
    ceiling = math.inf if bitmap.component_format() in _FLOATS else 1.0
    image = np.array(bitmap.convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32, False))
    bad = np.count_nonzero(~np.isfinite(image))
    if bad:
        raise ValueError(f"{where}: {file.name} holds {bad} values that are NaN or infinite. Repair them or mask them.")
    return image, ceiling


def _read_mask(folder: Path, name, image: np.ndarray, where: str) -> np.ndarray:
    mask, _ = _read_image(_image_file(folder, str(name), where), where)
    if mask.shape != image.shape:
        sizes = [f"{a.shape[1]} x {a.shape[0]}" for a in (mask, image)]
        raise ValueError(f"{where}: mask {name} is {sizes[0]} pixels, its image {sizes[1]}. Give it the same size.")
    mask = mask[..., 0] > 0.2  # 0.2 linear is half of the 8-bit range: mask files are drawn, not measured
    if not mask.any():
        raise ValueError(f"{where}: mask {name} is black, no pixel counts. White is what counts.")
    return mask


def _pose(matrix, where: str) -> np.ndarray:
    try:
        m = np.array(matrix, np.float64)
    except (TypeError, ValueError):
        m = np.zeros(0)
    if m.shape != (4, 4) or not np.isfinite(m).all():
        raise ValueError(f"{where}: transform_matrix must be 4 x 4 numbers, camera to world; got {_short(matrix)}.")
    rotation = m[:3, :3]
    error = max(np.abs(rotation @ rotation.T - np.eye(3)).max(), np.abs(m[3] - [0, 0, 0, 1]).max())
    if error > _RIGID or np.linalg.det(rotation) < 0:
        raise ValueError(
            f"{where}: transform_matrix is not a rotation and a translation (off by {error:.2g}, determinant "
            f"{np.linalg.det(rotation):.3g}). Take scale and mirroring out of it."
        )
    return m


def _fov(both: dict, width: int, where: str) -> float:
    if "fl_x" in both:
        focal = _number(both, "fl_x", None, where)
        other = _number(both, "fl_y", focal, where)
        if focal <= 0 or abs(other / focal - 1) > _SQUARE:
            raise ValueError(
                f"{where}: fl_x = {focal:g}, fl_y = {other:g}; needed: positive and equal (square pixels)."
            )
        return math.degrees(2 * math.atan(width / (2 * focal)))
    if "camera_angle_x" not in both:
        raise ValueError(f"{where}: neither camera_angle_x (radians) nor fl_x (pixels) is given. One is needed.")
    angle = _number(both, "camera_angle_x", None, where)
    if not 0 < angle < math.pi:
        raise ValueError(f"{where}: camera_angle_x = {angle:g}; it is in radians, between 0 and pi.")
    return math.degrees(angle)


def _number(both: dict, key: str, default, where: str) -> float:
    value = both.get(key, default)
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise ValueError(f"{where}: {key} must be a number; got {_short(value)}.")
    return float(value)


def _short(value) -> str:
    text = repr(value)
    return text if len(text) < 80 else f"{text[:77]}..."


def write_views(views: Sequence[View], folder, *, suffix: str = ".exr") -> Path:
    """Write photographs with poses, as :func:`read_views` reads them.

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

    Examples
    --------
    >>> write_views(views, "photos")  # doctest: +SKIP
    """
    if suffix not in (".exr", ".png"):
        raise ValueError(f'write_views(): suffix "{suffix}" is unknown. Choose one of: .exr, .png.')
    folder, frames = Path(folder), []
    folder.mkdir(parents=True, exist_ok=True)
    for view in views:
        width, height = view.size
        frame = {
            "file_path": f"{view.name}{suffix}",
            "transform_matrix": view.to_world.tolist(),
            "camera_angle_x": math.radians(view.fov),
            "w": width,
            "h": height,
            "cx": view.principal_point[0] * width,
            "cy": view.principal_point[1] * height,
            "split": view.split,
        }
        _write_image(view.image, folder / frame["file_path"])
        if not view.mask.all():
            frame["mask_path"] = f"{view.name}_mask.png"
            _write_image(np.repeat(view.mask[..., None], 3, 2).astype(np.float32), folder / frame["mask_path"])
        frames.append(frame)
    with replacing(folder / FILE) as temporary:
        Path(temporary).write_text(json.dumps({"frames": frames}, indent=1) + "\n", encoding="utf-8")
    return folder / FILE


def _write_image(image: np.ndarray, path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.suffix == ".png":
        bitmap = mi.Bitmap(np.round(encode_srgb(image) * 255).astype(np.uint8))
    else:
        bitmap = mi.Bitmap(np.ascontiguousarray(image, np.float32))
    with replacing(path) as temporary:
        bitmap.write(temporary)
