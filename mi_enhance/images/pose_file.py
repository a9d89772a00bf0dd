"""The JSON of photographs with poses: which file, what is in it, which frames are held out."""

from __future__ import annotations

import json
from pathlib import Path, PurePosixPath
from typing import Any

from ..system.files import require_file
from ..system.messages import shortened

FILE = "transforms.json"
_SPLITS = {"train": "train", "test": "test", "val": "test"}
# Names that other programs have for entries of a camera.
_ALSO = {"fx": "fl_x", "fy": "fl_y", "width": "w", "height": "h", "image_width": "w", "image_height": "h"}
# What NeRF's own data sets have in the place of one file, and what is held out of it.
_SPLIT_FILES = {"transforms_train.json": "train", "transforms_val.json": "test", "transforms_test.json": "test"}
_SPLIT_LISTS = {"train_filenames": "train", "val_filenames": "test", "test_filenames": "test"}


def pose_files(path: Path, where: str) -> dict[Path, str | None]:
    """Files of poses, each with the split of all of its frames, where that is in its name."""
    if path.is_dir() and not (path / FILE).exists():
        several = {path / name: split for name, split in _SPLIT_FILES.items() if (path / name).is_file()}
        if several:
            return dict(several)
    file = path / FILE if path.is_dir() else path
    return {require_file(file, f'read_views("{file}")'): None}


def read_poses(file: Path, where: str) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """What a file says of all frames, and of each."""
    try:
        content = json.loads(file.read_bytes())  # bytes: UTF-8 with and without mark, UTF-16, UTF-32
    except (ValueError, RecursionError) as error:  # no JSON, no text, or nested to break the parser
        raise ValueError(
            f"{where}: {file.name} is no JSON ({error}). Correct it there, or export the poses again."
        ) from None
    frames = content.pop("frames", None) if isinstance(content, dict) else None
    if not isinstance(frames, list) or not frames:
        raise ValueError(f"{where}: frames must be a list of at least one frame; got {shortened(frames)}.")
    for k, frame in enumerate(frames):
        if not isinstance(frame, dict) or not isinstance(frame.get("file_path"), str) or "\0" in frame["file_path"]:
            raise ValueError(f"{where}, frame {k}: must be an object with file_path; got {shortened(frame)}.")
    content, *frames = (_renamed(entries) for entries in (content, *frames))
    return content, frames


def _renamed(entries: dict[str, Any]) -> dict[str, Any]:
    """Entries by the names that are used here."""
    return {_ALSO.get(name, name) if _ALSO.get(name) not in entries else name: v for name, v in entries.items()}


def splits(content: dict[str, Any], frames: list[dict[str, Any]], where: str) -> list[str | None]:
    """Whether each frame is fitted or held out; None where lists of files leave it out."""
    of_name: dict[str, str] = {}
    for name, of_list in _SPLIT_LISTS.items():
        listed = content.get(name) or []
        if not isinstance(listed, list) or not all(isinstance(file, str) for file in listed):
            raise ValueError(f"{where}: {name} must be a list of file names; got {shortened(listed)}.")
        for file in listed:
            of_name.setdefault(_plain(file), of_list)
    strangers = sorted(set(of_name) - {_plain(frame["file_path"]) for frame in frames})
    if strangers:
        raise ValueError(
            f'{where}: train_filenames and the like name "{strangers[0][:200]}", which no frame has '
            f"({len(strangers)} such names). Give the names that file_path has."
        )
    return [
        _split_of(content, frame, f"{where}, frame {k}")
        or of_name.get(_plain(frame["file_path"]), None if content.get("train_filenames") else "train")
        for k, frame in enumerate(frames)
    ]


def _split_of(content: dict[str, Any], frame: dict[str, Any], where: str) -> str | None:
    split = frame.get("split", content.get("split"))
    if split is not None and (not isinstance(split, str) or split not in _SPLITS):
        raise ValueError(f'{where}: split "{str(split)[:60]}" is unknown. Choose one of: {", ".join(_SPLITS)}.')
    return _SPLITS[split] if split else None


def _plain(name: str) -> str:
    """One spelling of ./a.png and .\\a.png."""
    return PurePosixPath(name.replace("\\", "/")).as_posix()
