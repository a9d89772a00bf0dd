"""The Standard Shader Ball as a page of the viewer holds it: a mesh of integers, and distances to it for shadows."""

from __future__ import annotations

import base64
import functools

import mitsuba as mi
import numpy as np

from ..system.bundled_files import scene_file

_PARTS = ("material_surface", "neutral_core", "neutral_base")
_MATERIAL, _GREY = 1, 2  # what the shader calls the parts
_RADIUS = 1.6  # of the sphere around all parts, in units of the page, whose sphere has 1: so it fills the picture
_CELLS = 64  # of the grid of distances, on a side: a cell is 2 mm of the ball, which is 89 mm wide
_REACH = 0.6  # distances end here: a step of a ray is no longer
_POINTS = 150_000  # on the surface that distances are measured to: less than half a cell apart


@functools.cache
def shader_ball() -> dict:
    """Return the mesh and the distances, numbers as base64.

    Returns
    -------
    dict
        ``vertices``: 8 uint16 or int16 of each, position in the box from -`reach` to `reach` and part, normal and
        tangent as points of an octahedron; ``faces``: uint16; ``distances``: `cells`^3 bytes, 255 is 0.6 and more, z
        slowest; ``reach``; ``cells``; ``floor``: the height on which it stands.

    Examples
    --------
    >>> ball = shader_ball()
    >>> len(base64.b64decode(ball["vertices"])) // 16, len(base64.b64decode(ball["faces"])) // 6
    (7884, 14796)
    """
    meshes = [_mesh(name) for name in _PARTS]
    positions = np.concatenate([m[0] for m in meshes])
    low, high = positions.min(0), positions.max(0)
    positions = (positions - (low + high) / 2) * (2 * _RADIUS / np.linalg.norm(high - low))
    reach = float(np.abs(positions).max()) + 0.1
    offsets = np.cumsum([0] + [len(m[0]) for m in meshes])
    faces = np.concatenate([m[3] + o for m, o in zip(meshes, offsets[:-1], strict=True)])
    parts = np.concatenate([np.full(len(m[0]), _GREY if k else _MATERIAL) for k, m in enumerate(meshes)])
    places = np.column_stack([np.round((positions / reach + 1) / 2 * 65535), parts]).astype("<u2")
    facings = [_octahedral(np.concatenate([m[k] for m in meshes])) for k in (1, 2)]
    vertices = np.column_stack([places, np.column_stack(facings).view("<u2")])
    return {
        "vertices": _text(vertices),
        "faces": _text(faces.astype("<u2")),
        "distances": _text(_distances(positions, faces, reach)),
        "reach": reach,
        "cells": _CELLS,
        "floor": float(positions[:, 1].min()),
    }


def _mesh(name: str) -> tuple[np.ndarray, ...]:
    """Return positions, normals, tangents (each (N, 3)) and faces of a part."""
    mesh = mi.load_dict({"type": "ply", "filename": str(scene_file(f"shader_ball/{name}.ply"))})
    p, n = (
        np.array(a, np.float64).reshape(-1, 3) for a in (mesh.vertex_positions_buffer(), mesh.vertex_normals_buffer())
    )
    uv = np.array(mesh.vertex_texcoords_buffer(), np.float64).reshape(-1, 2)
    faces = np.array(mesh.faces_buffer()).reshape(-1, 3).astype(np.int64)
    (a, b), (u, v) = ((x[faces[:, 1]] - x[faces[:, 0]], x[faces[:, 2]] - x[faces[:, 0]]) for x in (p, uv))
    area = u[:, :1] * v[:, 1:] - u[:, 1:] * v[:, :1]
    along_u = (a * v[:, 1:] - b * u[:, 1:]) * np.sign(area)  # in the direction of dp/du, its length the area's
    tangents = np.zeros_like(p)
    for k in range(3):
        np.add.at(tangents, faces[:, k], along_u)
    tangents -= n * (tangents * n).sum(1, keepdims=True)
    lost = np.linalg.norm(tangents, axis=1) < 1e-12  # no texture coordinates there: any tangent
    tangents[lost] = np.cross(n[lost], [0.36, 0.48, 0.8])
    coarse = _coarse(faces)
    return p[: coarse.max() + 1], n[: coarse.max() + 1], tangents[: coarse.max() + 1], coarse


def _coarse(faces: np.ndarray) -> np.ndarray:
    """Undo the one subdivision of the files: a face of the cage is two triangles instead of eight.

    Triangle k of the first half is (corner of the cage, middle of an edge, middle of the face); the other half of its
    quadrilateral ends with the middle of the other edge. Corners are numbered first.
    """
    half = len(faces) // 2
    (corner, edge, middle), other = faces[:half].T, faces[half:, 2]
    rows = np.argsort(middle, kind="stable").reshape(-1, 4)
    following = (other[rows][:, None, :] == edge[rows][:, :, None]).argmax(2)  # the quadrilateral behind the edge
    k, turn = np.arange(len(rows)), [np.zeros(len(rows), int)]
    for _ in range(3):
        turn.append(following[k, turn[-1]])
    a, b, c, d = (corner[rows[k, t]] for t in turn)
    return np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])


def _octahedral(w: np.ndarray) -> np.ndarray:
    """Return directions as points of the square that an octahedron unfolds to, int16."""
    w = w / np.abs(w).sum(1, keepdims=True)
    folded = (1 - np.abs(w[:, 1::-1])) * np.where(w[:, :2] >= 0, 1, -1)
    return np.round(np.where(w[:, 2:] >= 0, w[:, :2], folded) * 32767).astype("<i2")


def _distances(positions: np.ndarray, faces: np.ndarray, reach: float) -> np.ndarray:
    """Return the distance of each cell of the box to the surface, as bytes."""
    from scipy.ndimage import distance_transform_edt  # 0.2 s to import

    corners, rng = positions[faces], np.random.default_rng(0)
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    chosen = rng.choice(len(faces), _POINTS, p=area / area.sum())
    u, v = np.sqrt(rng.random(_POINTS)), rng.random(_POINTS)  # uniform in the triangle
    weights = np.stack([1 - u, u * (1 - v), u * v], 1)
    points = (corners[chosen] * weights[..., None]).sum(1)
    fine = 2 * _CELLS  # a cell is the mean of eight
    empty = np.ones((fine, fine, fine), bool)
    x, y, z = ((points / reach + 1) * _CELLS).astype(int).T
    empty[z, y, x] = False
    found = distance_transform_edt(empty).reshape(_CELLS, 2, _CELLS, 2, _CELLS, 2).mean((1, 3, 5)) * (reach / _CELLS)
    return np.round(np.minimum(found, _REACH) / _REACH * 255).astype(np.uint8)


def _text(numbers: np.ndarray) -> str:
    return base64.b64encode(np.ascontiguousarray(numbers).tobytes()).decode()
