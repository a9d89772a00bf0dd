"""The JSON of photographs with poses: which file, what is in it, which frames are held out."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from ..system.files import require_file
from ..system.messages import shortened

FILE = "transforms.json"
SPLITS = ("train", "test")
# The files of NeRF's own data sets, which stand for one file, and the split of each.
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
    """Read a pose file: return its entries for all frames, and those of each frame."""
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
    return content, frames


def split(content: dict[str, Any], frame: dict[str, Any], where: str) -> str | None:
    """Return "train" if a frame is fitted, "test" if it is held out; None where lists of files leave it out."""
    split = frame.get("split")
    if split is not None:
        if split not in SPLITS:
            raise ValueError(f'{where}: split "{str(split)[:60]}" is unknown. Choose one of: {", ".join(SPLITS)}.')
        return str(split)
    for name, of_list in _SPLIT_LISTS.items():
        listed = content.get(name) or []
        if not isinstance(listed, list):
            raise ValueError(f"{where}: {name} must be a list of file names; got {shortened(listed)}.")
        if frame["file_path"] in listed:
            return of_list
    return None if content.get("train_filenames") else "train"
