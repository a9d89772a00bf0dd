"""What every pixel of a photograph shows, where the shape is known: point, normal and the direction to the viewer.

World axes are those of the file: for a map of normals and an orthographic camera x right, y up, z towards the camera.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..system.files import require_file
from ..system.messages import did_you_mean, shortened
from .entries import Entries, pose, positive, vector
from .image_files.photograph import read_photograph

_RAY_OFFSET = 1e-4  # of the size of a mesh: where a shadow ray starts, above rounding of its own triangle
_CAMERAS = {
    "orthographic": ("width", "transform_matrix"),
    "perspective": ("camera_angle_x", "fl_x", "cx", "cy", "transform_matrix"),
    "rectified": ("position",),
}


class Seen(NamedTuple):
    """What the pixels of a camera show; all of shape (H, W, 3).

    Parameters
    ----------
    points : array or None
        In the world; None where only normals are known.
    normals : array
        Unit vectors, 0 where there is no surface.
    viewer : array
        Unit vectors from the surface to the camera.
    blocked : callable or None
        ``blocked(points, directions) -> bool array``: what the shape keeps light from, if it can tell.
    """

    points: np.ndarray | None
    normals: np.ndarray
    viewer: np.ndarray
    blocked: Callable[[np.ndarray, np.ndarray], np.ndarray] | None = None


def surface(content: Entries, folder: Path, size: tuple[int, int], where: str) -> Seen:
    """Return what a camera of `size` (width, height) sees of the shape that an entry describes.

    Parameters
    ----------
    content : mapping
        With one of ``normals``, ``sphere``, ``plane``, ``mesh``, and ``camera``.
    folder : Path
        Of the file that says so.
    size : (int, int)
    where : str
        What an error begins with.

    Raises
    ------
    ValueError
        If no shape is given or several, or its entries do not fit together.
    """
    shapes = [name for name in ("normals", "sphere", "plane", "mesh") if content.get(name) is not None]
    if len(shapes) != 1:
        raise ValueError(
            f"{where}: {' and '.join(shapes) or 'no shape'} is given; needed is one of normals (a map), sphere, plane, "
            "mesh."
        )
    camera = _camera(content["camera"], shapes[0], where)
    if shapes[0] == "normals":
        return _of_normals(content, camera, folder, size, where)
    if shapes[0] == "plane":
        return _of_plane(_object(content, "plane", ("width",), where), camera, size, where)
    origins, directions = _rays(camera, size, where)
    if shapes[0] == "sphere":
        return _of_sphere(_object(content, "sphere", ("center", "radius"), where), origins, directions, where)
    return _of_mesh(content["mesh"], folder, origins, directions, where)


def _camera(entry: object, shape: str, where: str) -> Entries:
    kind = entry.get("type") if isinstance(entry, Mapping) else None
    if not isinstance(entry, Mapping) or kind not in _CAMERAS:
        raise ValueError(
            f"{where}: camera is {shortened(entry)}; needed is an object whose type is one of {', '.join(_CAMERAS)}."
        )
    for name in entry:
        if name != "type" and name not in _CAMERAS[kind]:
            raise ValueError(
                f'{where}: a camera of type {kind} has no entry "{name}". It has: {", ".join(_CAMERAS[kind])}.'
                f"{did_you_mean(name, _CAMERAS[kind])}"
            )
    if (kind == "rectified") != (shape == "plane"):
        raise ValueError(
            f"{where}: camera is {kind}, the shape {shape}. A plane has rectified photographs (a pixel is a texel), "
            "and nothing else has."
        )
    return entry


def _of_normals(content: Entries, camera: Entries, folder: Path, size: tuple[int, int], where: str) -> Seen:
    normals = _map(folder, content["normals"], size, where, "normals", is_encoded=True)
    length = np.linalg.norm(normals, axis=-1, keepdims=True)
    normals = np.where(length > 0.5, normals / np.maximum(length, 0.5), 0)  # 0.5: no surface, or a pixel at its edge
    given = content.get("positions")
    points = None if given is None else _map(folder, given, size, where, "positions")
    _, directions = _rays(camera, size, where)
    return Seen(points, normals, -directions)


def _of_plane(entry: Entries, camera: Entries, size: tuple[int, int], where: str) -> Seen:
    """The plane z = 0 with its middle in the origin, x right and y up; the picture shows all of it."""
    pixel = positive(entry, "width", where) / size[0]
    x = (np.arange(size[0]) + 0.5 - size[0] / 2) * pixel
    y = (size[1] / 2 - np.arange(size[1]) - 0.5) * pixel
    points = np.stack([*np.meshgrid(x, y), np.zeros(size[::-1])], -1)
    position = vector(camera, "position", where)
    if not position[2] > 0:
        raise ValueError(f"{where}: camera has position {position.tolist()}, which is not above the plane (z > 0).")
    viewer = position - points
    normals = np.broadcast_to([0.0, 0.0, 1.0], points.shape)
    return Seen(points, normals, viewer / np.linalg.norm(viewer, axis=-1, keepdims=True))


def _of_sphere(entry: Entries, origins: np.ndarray, directions: np.ndarray, where: str) -> Seen:
    center, radius = vector(entry, "center", where), positive(entry, "radius", where)
    to_center = center - origins
    along = (to_center * directions).sum(-1)
    beside = (to_center**2).sum(-1) - along**2
    hit = (beside < radius**2) & (along > 0)
    if not hit.any():
        raise ValueError(f"{where}: no pixel shows the sphere. Check center and radius, and the camera.")
    distance = along - np.sqrt(np.maximum(radius**2 - beside, 0))
    points = origins + distance[..., None] * directions
    normals = np.where(hit[..., None], (points - center) / radius, 0)
    return Seen(points, normals, -directions)


def _of_mesh(name: object, folder: Path, origins: np.ndarray, directions: np.ndarray, where: str) -> Seen:
    import mitsuba as mi

    from ..numerics.arrays import vector3f
    from ..system.variants import require_variant

    require_variant(where, jit=True)
    file = require_file(folder / str(name), f"{where}, mesh")
    kind = file.suffix.lower().lstrip(".")
    if kind not in ("obj", "ply", "serialized"):
        raise ValueError(f"{where}: mesh {file.name} must be .obj, .ply or .serialized. Convert it.")
    scene = mi.load_dict({"type": "scene", "mesh": {"type": kind, "filename": str(file)}})
    shape = directions.shape
    hit = scene.ray_intersect(
        mi.Ray3f(mi.Point3f(vector3f(origins.reshape(-1, 3))), vector3f(directions.reshape(-1, 3)))
    )
    valid = np.array(hit.is_valid()).reshape(shape[:2])
    if not valid.any():
        raise ValueError(f"{where}: no pixel shows the mesh. Check transform_matrix (camera to world) and units.")
    points, normals = (np.array(v).T.reshape(shape).astype(np.float64) for v in (hit.p, hit.sh_frame.n))
    normals = np.where(valid[..., None], normals, 0)
    offset = _RAY_OFFSET * float(np.linalg.norm(np.array(scene.bbox().extents())))

    def blocked(points: np.ndarray, toward: np.ndarray) -> np.ndarray:
        return np.array(scene.ray_test(mi.Ray3f(mi.Point3f(vector3f(points + offset * toward)), vector3f(toward))))

    return Seen(points, normals, -directions, blocked)


def _rays(camera: Entries, size: tuple[int, int], where: str) -> tuple[np.ndarray, np.ndarray]:
    """Return origins and unit directions of rays through the middles of all pixels, in the world."""
    width, height = size
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    to_world = np.eye(4)
    if camera.get("transform_matrix") is not None:
        to_world = pose(camera["transform_matrix"], where)
    if camera["type"] == "orthographic":
        pixel = positive(camera, "width", where) / width if camera.get("width") is not None else 2.0 / width
        plane = np.stack([(x - width / 2) * pixel, (height / 2 - y) * pixel, np.zeros_like(x)], -1)
        # behind everything: a camera without a place looks from far away
        origins = plane @ to_world[:3, :3].T + to_world[:3, 3] + 1e4 * pixel * width * to_world[:3, 2]
        return origins, np.broadcast_to(-to_world[:3, 2], origins.shape)
    if (camera.get("fl_x") is None) == (camera.get("camera_angle_x") is None):
        raise ValueError(f"{where}: a perspective camera needs fl_x (pixels) or camera_angle_x (radians), one of them.")
    if camera.get("fl_x") is not None:
        focal = positive(camera, "fl_x", where)
    else:
        angle = positive(camera, "camera_angle_x", where)
        if angle >= math.pi:
            raise ValueError(f"{where}: camera_angle_x is {angle:g}; it is in radians, between 0 and pi.")
        focal = width / (2 * math.tan(angle / 2))
    cx, cy = (
        positive(camera, k, where) if camera.get(k) is not None else n / 2 for k, n in (("cx", width), ("cy", height))
    )
    own = np.stack([(x - cx) / focal, (cy - y) / focal, -np.ones_like(x)], -1)
    directions = own @ to_world[:3, :3].T
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    return np.broadcast_to(to_world[:3, 3], directions.shape), directions


def _map(
    folder: Path, name: object, size: tuple[int, int], where: str, entry: str, is_encoded: bool = False
) -> np.ndarray:
    """Return a map of vectors (H, W, 3) from .npy, EXR, or (normals) PNG, where 0 stands for -1 and 1 for 1."""
    file = require_file(folder / str(name), f"{where}, {entry}")
    if file.suffix.lower() == ".npy":
        try:
            vectors = np.load(file, allow_pickle=False)
        except (ValueError, OSError, EOFError) as error:
            raise ValueError(f"{where}: {entry} {file.name} cannot be read ({error}). It is damaged.") from None
    else:
        is_png = file.suffix.lower() == ".png"
        vectors = read_photograph(file, where, is_linear=is_png).image
        if is_png:
            if not is_encoded:
                raise ValueError(f"{where}: {entry} {file.name} is a PNG file, which is too coarse. Give .npy or .exr.")
            vectors = 2 * vectors - 1
    if vectors.shape != (size[1], size[0], 3) or vectors.dtype.kind != "f":
        raise ValueError(
            f"{where}: {entry} {file.name} has shape {vectors.shape} and type {vectors.dtype}; needed are floating "
            f"point numbers of shape {(size[1], size[0], 3)}, one vector a pixel."
        )
    return np.where(np.isfinite(vectors).all(-1, keepdims=True), vectors, 0).astype(np.float64)


def _object(content: Entries, name: str, needed: tuple[str, ...], where: str) -> Entries:
    value = content[name]
    if not isinstance(value, Mapping) or set(value) != set(needed):
        raise ValueError(f"{where}: {name} must be an object with {' and '.join(needed)}; got {shortened(value)}.")
    return value
