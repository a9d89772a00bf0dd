"""Photographs as the target of a fit: pixels, the rays through them, and how much each counts."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping, Sequence

import mitsuba as mi
import numpy as np

from .plugin_tables import CAMERA_ROWS, fill, pixel_camera
from .views import View

# Most pixels that are rendered at once: prb keeps about 1 kB per path with 69 unknowns, 8 samples make that 2 GB.
_PIXELS = 1 << 18
WIDTH = 64  # of a batch of random pixels: Mitsuba places a sample with 24 bits, so that 18 are left inside a pixel


@dataclasses.dataclass(frozen=True, eq=False)
class Target:
    """Pixels that are rendered together: views of one size side by side, or any pixels of any views.

    Parameters
    ----------
    views : list of View
        Side by side; empty for random pixels.
    sensor : mi.Sensor
    image : array (H, W, 3), float32
        Of views (H, views * W, 3).
    weight : array (H, W, 3), float32
        1 where a pixel counts, over how many do.
    saturated : array (H, W, 3) of bool
        Where the photograph is known from below only.
    numbers : array (H, W) of int
        Of the photograph of every pixel.
    """

    views: list[View]
    sensor: mi.Sensor
    image: np.ndarray
    weight: np.ndarray
    saturated: np.ndarray
    numbers: np.ndarray


def targets(views: Sequence[View], factor: int = 1, numbers: Mapping[str, int] | None = None) -> list[Target]:
    """Views, each `factor` times smaller, in groups of one size that are rendered together.

    Parameters
    ----------
    views : sequence of View
    factor : int
    numbers : mapping of str to int, optional
        Number of each photograph by the name of its view, by which its light is found; 0 for all if left out.

    Raises
    ------
    ValueError
        If no pixel is left that counts.
    """
    groups: dict[tuple, list[View]] = {}
    for view in (v.smaller(factor) for v in views):
        most = max(1, _PIXELS // (view.size[0] * view.size[1]))
        number = sum(len(g) for key, g in groups.items() if key[0] == view.size) // most
        groups.setdefault((view.size, number), []).append(view)
    result = [_target(group, numbers or {}) for group in groups.values() if any(v.mask.any() for v in group)]
    if not result:
        raise ValueError(f"fit_images(): no pixel of the {len(views)} views counts at 1/{factor} of their size.")
    return result


def _target(views: list[View], numbers: Mapping[str, int]) -> Target:
    width, height = views[0].size
    y, x = np.mgrid[:height, :width]
    tables = [rays(camera(v), x.ravel(), y.ravel(), numbers.get(v.name, 0)) for v in views]
    table = np.concatenate([t.reshape(CAMERA_ROWS, height, width) for t in tables], 2).reshape(CAMERA_ROWS, -1)
    mask = np.concatenate([v.mask for v in views], 1)[..., None].repeat(3, 2)
    image = np.maximum(np.concatenate([v.image for v in views], 1), 0)
    saturated = np.concatenate([v.saturated for v in views], 1)
    sensor = pixel_camera(table, width * len(views), height)
    return _made(views, sensor, image, mask / max(mask.sum(), 1), saturated, table[-1])


def _made(views, sensor, image, weight, saturated, number) -> Target:
    numbers = np.asarray(number, np.int64).reshape(image.shape[:2])
    return Target(views, sensor, image, weight.astype(np.float32), saturated, numbers)


def camera(view: View) -> np.ndarray:
    """Return the 15 numbers of a camera: place, axes to the right, up and backwards, and middle and focal length."""
    width, height = view.size
    focal = width / (2 * math.tan(math.radians(view.fov) / 2))
    middle = view.principal_point[0] * width, view.principal_point[1] * height
    return np.concatenate([view.to_world[:3, 3], view.to_world[:3, :3].T.ravel(), middle, [focal]])


def rays(cameras: np.ndarray, x: np.ndarray, y: np.ndarray, number: np.ndarray | int) -> np.ndarray:
    """Return the table of a :func:`mi_enhance.images.plugin_tables.pixel_camera`.

    Parameters
    ----------
    cameras : array (15,) or (N, 15)
        One for all pixels or of each, see :func:`camera`.
    x, y : array (N,)
        Columns and rows.
    number : int or array (N,)
        Of the photograph.
    """
    o, right, up, back, (cx, cy, focal) = np.split(cameras.T.reshape(15, -1), [3, 6, 9, 12])
    table = np.empty((CAMERA_ROWS, len(x)))
    table[:3], table[6:9], table[9:12], table[12] = o, right / focal, -up / focal, number
    table[3:6] = (x - cx) * table[6:9] + (y - cy) * table[9:12] - back
    return table


def split(image: np.ndarray, target: Target) -> list[np.ndarray]:
    """A wide picture cut into that of each view."""
    return np.split(image, len(target.views), axis=1)


class RandomPixels:
    """Random pixels of many photographs, drawn in one pass over them: each is read once, and forgotten.

    Every photograph counts as much as any other, whatever its size and mask.

    Parameters
    ----------
    n : int
        Pixels of an iteration.
    n_steps : int
        Iterations.
    n_views : int
        Photographs that will be added.
    rng : numpy.random.Generator

    Examples
    --------
    >>> pixels = RandomPixels(64, 10, 2, np.random.default_rng(0))
    >>> for k in range(2):
    ...     pixels.add(View(f"{k}", np.ones((8, 8, 3)), np.eye(4), 40.0), k)
    >>> [target] = pixels.batches(0, 1)
    >>> target.image.shape
    (1, 64, 3)
    """

    def __init__(self, n: int, n_steps: int, n_views: int, rng: np.random.Generator):
        n = WIDTH * math.ceil(n / WIDTH)
        self.n, self.n_steps, self._rng = n, n_steps, rng
        self._image = np.zeros((n_steps, n, 3), np.float32)
        self._saturated = np.zeros((n_steps, n, 3), bool)
        self._counts = np.zeros((n_steps, n), bool)
        self._place = np.zeros((n_steps, n, 2), np.int32)  # column and row
        # which photograph each pixel is of: as many of each as of any other, in every iteration
        self._owner = np.stack([rng.permutation(n) % n_views for _ in range(n_steps)]).astype(np.int32)
        self._cameras, self._numbers = np.empty((n_views, 15)), np.empty(n_views, np.int32)
        self._added, self._sensor = 0, None

    def add(self, view: View, number: int) -> None:
        """Draw the pixels of a photograph; `number` is that of its light."""
        mine = self._owner == self._added
        self._cameras[self._added], self._numbers[self._added] = camera(view), number
        self._added += 1
        candidates, needed = np.flatnonzero(view.mask), int(mine.sum())
        if not len(candidates):
            return
        # every pixel once before any comes again
        rounds = [self._rng.permutation(candidates) for _ in range(math.ceil(needed / len(candidates)))]
        chosen = np.concatenate([*rounds, candidates[:0]])[:needed]
        y, x = np.divmod(chosen, view.size[0])
        self._counts[mine] = True
        self._place[mine] = np.stack([x, y], 1)
        self._image[mine] = np.maximum(view.image[y, x], 0)
        self._saturated[mine] = view.saturated[y, x]

    @property
    def counts(self) -> bool:
        """True if there is any pixel that counts."""
        return bool(self._counts.any())

    def values(self) -> np.ndarray:
        """Return the colours (N, 3) of all pixels that count."""
        return self._image[self._counts]

    def batches(self, first: int, last: int, *, keep: bool = False) -> Iterator[Target]:
        """Yield the pixels of iterations; each is valid until the next, unless they are to be kept."""
        for k in range(first, last):
            shape, owner = (self.n // WIDTH, WIDTH, 3), self._owner[k]
            table = rays(self._cameras[owner], self._place[k, :, 0], self._place[k, :, 1], self._numbers[owner])
            if self._sensor is None or keep:
                self._sensor = pixel_camera(table, WIDTH, self.n // WIDTH)
            fill(self._sensor, table)
            image, saturated = self._image[k].reshape(shape), self._saturated[k].reshape(shape)
            counts = self._counts[k].reshape(*shape[:2], 1).repeat(3, 2)
            yield _made([], self._sensor, image, counts / max(counts.sum(), 1), saturated, table[-1])
