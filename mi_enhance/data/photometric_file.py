"""Photographs with known normals and lights: ``photometric.json``, read frame by frame.

Its entries are in docs/photographs.md. Each pixel is a pair of directions and a value, as long as light comes from the
light alone: no interreflection.
"""

from __future__ import annotations

import functools
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..system.files import read_json
from ..system.messages import did_you_mean, shortened
from .directions import MIN_COS
from .entries import positive, vector
from .image_files.photograph import read_photograph
from .lights import Light, read_light
from .photometric_surface import Seen, surface

FILE = "photometric.json"
_OF_ALL = ("camera", "normals", "positions", "sphere", "plane", "mesh", "mask_path", "encoding", "ceiling", "tangent")
_OF_BOTH = ("light", "exposure_factor")  # an entry of a frame counts, else that of the file
_OF_FRAME = ("file_path", "light", "exposure_factor", "split", "camera", "mask_path", "ceiling")
_WHITE = 0.5
_DIRECTIONAL = "directional"


class Frame(NamedTuple):
    """Samples of one photograph, a row for each pixel of the mask of all.

    Parameters
    ----------
    wi, wo : array (P, 3)
        Towards viewer and light, in the frame of the surface at each pixel.
    f : array (P, 3)
        Reflectance in 1/sr without the cosine; meaningless where it does not count.
    counts : array (P,) of bool
        Lit, seen, neither saturated nor masked.
    """

    name: str
    split: str
    wi: np.ndarray
    wo: np.ndarray
    f: np.ndarray
    counts: np.ndarray


class PhotometricFile:
    """A ``photometric.json`` and the photographs beside it, which are read one at a time.

    Parameters
    ----------
    path : str or Path
        The file, or its folder.

    Raises
    ------
    FileNotFoundError, ValueError
        For a missing or damaged file, unknown entries, or values out of range.
    """

    def __init__(self, path: str | Path):
        file = Path(path) / FILE if Path(path).is_dir() else Path(path)
        self.where, self.folder = f'data.photometric("{path}")', file.parent
        if not file.is_file():
            raise FileNotFoundError(f"{self.where}: there is no {file.name}. Write one (docs/photographs.md).")
        self.content = read_json(file, self.where, ("frames",))
        frames = self.content["frames"]
        if not isinstance(frames, list) or not frames or not all(isinstance(f, dict) for f in frames):
            raise ValueError(f"{self.where}: frames must be a list of objects; got {shortened(frames)}.")
        _refuse_unknown(self.content, (*_OF_ALL, *_OF_BOTH, "frames"), self.where)
        self.content.setdefault("camera", {"type": "orthographic"})
        self.tangent = vector({"tangent": [1, 0, 0], **self.content}, "tangent", self.where)
        if not (length := np.linalg.norm(self.tangent)):
            raise ValueError(f"{self.where}: tangent is [0, 0, 0], which points nowhere. Give another vector.")
        self.tangent /= length
        if self.content.get("encoding", "file") not in ("file", "linear"):
            encoding = shortened(self.content["encoding"])
            raise ValueError(f'{self.where}: encoding is {encoding}; it must be "file" (what files say) or "linear".')
        self.frames = [self._checked(frame, f"{self.where}, frame {k}") for k, frame in enumerate(frames)]
        self.mask = self._mask()

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of all photographs."""
        return self.mask.shape[1], self.mask.shape[0]

    def read(self, split: str | None = None) -> Iterator[Frame]:
        """Yield the samples of every frame of a split, of all frames if it is None."""
        for k, frame in enumerate(self.frames):
            if split in (None, frame["split"]):
                yield self._read(frame, f"{self.where}, frame {k}")

    def _checked(self, frame: Mapping[str, Any], where: str) -> dict[str, Any]:
        _refuse_unknown(frame, _OF_FRAME, where)
        if not isinstance(frame.get("file_path"), str):
            raise ValueError(f"{where}: file_path is missing. It names the photograph.")
        frame = {**{name: self.content.get(name) for name in _OF_BOTH}, **frame}
        if frame.get("light") is None:
            raise ValueError(f"{where}: light is missing. Each photograph needs the one light that it was taken in.")
        split = frame.get("split", "train")
        if split not in ("train", "test"):
            raise ValueError(f'{where}: split is {shortened(split)}; it must be "train" or "test".')
        light = read_light(frame["light"], where)
        if light.kind == "envmap":
            raise ValueError(f"{where}: an envmap lights from everywhere: no pair of directions. Use fit-images.")
        exposure = positive(frame, "exposure_factor", where) if frame.get("exposure_factor") is not None else 1.0
        return {**frame, "split": split, "light": light, "exposure_factor": exposure}

    def _mask(self) -> np.ndarray:
        first = self._image(self.frames[0], self.where)[0]
        if self.content.get("mask_path") is None:
            return np.ones(first.shape[:2], bool)
        return self._white(self.content["mask_path"], first.shape[:2], self.where)

    def _image(self, frame: Mapping[str, Any], where: str) -> tuple[np.ndarray, float]:
        file = self.folder / frame["file_path"]
        if not file.is_file():
            raise FileNotFoundError(f'{where}: there is no image "{frame["file_path"][:200]}". Check file_path.')
        photograph = read_photograph(file, where, is_linear=self.content.get("encoding") == "linear")
        both = {**self.content, **frame}
        given = both.get("ceiling") is not None
        return photograph.image, positive(both, "ceiling", where) if given else photograph.ceiling

    def _white(self, name: object, shape: tuple[int, ...], where: str) -> np.ndarray:
        file = self.folder / str(name)
        if not file.is_file():
            raise FileNotFoundError(f'{where}: there is no mask "{str(name)[:200]}". Check mask_path.')
        white = read_photograph(file, where, is_mask=True).image.max(-1) > _WHITE
        if white.shape != shape:
            sizes = [f"{s[1]} x {s[0]}" for s in (white.shape, shape)]
            raise ValueError(f"{where}: mask {name} is {sizes[0]} pixels, its image {sizes[1]}. Give it the same size.")
        return white

    @functools.lru_cache(maxsize=1)  # noqa: B019  (one entry; frames mostly share one camera)
    def _seen(self, camera: str) -> Seen:
        content = {**self.content, **({"camera": json.loads(camera)} if camera != "null" else {})}
        return surface(content, self.folder, self.size, self.where)

    def _read(self, frame: Mapping[str, Any], where: str) -> Frame:
        image, ceiling = self._image(frame, where)
        if image.shape[:2] != self.mask.shape:
            sizes = [f"{s[1]} x {s[0]}" for s in (image.shape, self.mask.shape)]
            raise ValueError(f"{where}: {frame['file_path']} is {sizes[0]} pixels, the first one {sizes[1]}.")
        seen = self._seen(json.dumps(frame.get("camera"), sort_keys=True))
        value, normal, viewer = image[self.mask], seen.normals[self.mask], seen.viewer[self.mask]
        light: Light = frame["light"]
        if light.kind == "flash":
            light = light.in_world(self._camera_pose(frame, where))
        if light.kind != _DIRECTIONAL and seen.points is None:
            raise ValueError(
                f"{where}: a {light.kind} light needs to know where each pixel's point is: give positions."
            )
        points = np.zeros_like(normal) if seen.points is None else seen.points[self.mask]
        toward, irradiance = light.at(points)
        cos = (normal * toward).sum(-1)
        if len(cos) and not (cos >= MIN_COS).any():
            raise ValueError(
                f"{where}: its light lies below the horizon of all {len(cos)} pixels. A direction points towards the "
                "light; normals, places and directions have the same axes (x right, y up, z towards the camera)."
            )
        counts = (cos >= MIN_COS) & ((normal * viewer).sum(-1) >= MIN_COS)
        counts &= (value < ceiling * (1 - 1e-6)).all(-1) & np.isfinite(value).all(-1)  # 1e-6: float32
        counts &= (irradiance > 0).any(-1)
        if frame.get("mask_path") is not None:
            counts &= self._white(frame["mask_path"], self.mask.shape, where)[self.mask]
        if seen.blocked is not None:
            counts[counts] &= ~seen.blocked(points[counts], toward[counts])
        received = np.where(counts, cos, 1)[:, None] * irradiance * frame["exposure_factor"]
        f = np.divide(value, received, out=np.zeros_like(received), where=counts[:, None] & (received > 0))
        to_local = _frames(normal, self.tangent)
        wi, wo = (np.einsum("pij,pj->pi", to_local, v).astype(np.float32) for v in (viewer, toward))
        return Frame(frame["file_path"], frame["split"], wi, wo, f.astype(np.float32), counts)

    def _camera_pose(self, frame: Mapping[str, Any], where: str) -> np.ndarray:
        camera = frame.get("camera") or self.content["camera"]
        if camera.get("type") == "orthographic":
            raise ValueError(f"{where}: an orthographic camera has no place, so a flash at it has none. Give a point.")
        pose = np.eye(4)
        if camera.get("type") == "rectified":
            pose[:3, 3] = camera["position"]
        elif camera.get("transform_matrix") is not None:
            pose[:3] = np.array(camera["transform_matrix"], np.float64).reshape(-1, 4)[:3]
        return pose


def _refuse_unknown(entries: Mapping[str, Any], known: tuple[str, ...], where: str) -> None:
    for name in entries:
        if name not in known:
            raise ValueError(f'{where}: unknown entry "{name}". It has: {", ".join(known)}.{did_you_mean(name, known)}')


def _frames(normal: np.ndarray, tangent: np.ndarray) -> np.ndarray:
    """Return for each normal (P, 3) the rotation (3, 3) to its own axes: x along the tangent, as far as it can."""
    x = tangent - (normal @ tangent)[:, None] * normal
    length = np.linalg.norm(x, axis=-1, keepdims=True)
    other = np.cross(normal, np.roll(tangent, 1))  # where the normal is the tangent itself
    x = np.where(length > 1e-6, x, other)  # 1e-6: rounding
    x /= np.maximum(np.linalg.norm(x, axis=-1, keepdims=True), 1e-12)  # 1e-12: no normal at all
    return np.stack([x, np.cross(normal, x), normal], 1)
