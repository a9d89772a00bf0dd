"""Photographs with poses: the record, cameras around an object, renders of a scene in the place of photographs.

The camera convention is OpenGL's, as in most such files: ``transform_matrix`` takes camera to world coordinates, the
camera looks along its -z, +y is up, +x right. Mitsuba's cameras look along +z with +x to the left; this file is the one
place that translates.
"""

from __future__ import annotations

import dataclasses
import math
from numbers import Integral

import mitsuba as mi
import numpy as np

from ..data.lights import Light

_TURN = np.diag([-1.0, 1.0, -1.0, 1.0])  # OpenGL's camera to Mitsuba's: half a turn about y


@dataclasses.dataclass(frozen=True, eq=False)
class View:
    """One photograph. Immutable.

    Parameters
    ----------
    name : str
        Unique; the path of its file without suffix.
    image : array (H, W, 3)
        Linear RGB radiance, float32.
    to_world : array (4, 4)
        Camera to world, OpenGL convention, float64.
    fov : float
        Field of view over the width, degrees.
    mask : array (H, W) of bool, optional
        Pixels that count; all if left out. What the others hold plays no part; NaN and infinity become 0 there.
    split : {"train", "test"}
        What is fitted, or held out and only reported.
    ceiling : float
        Value at which the camera saturates: there the scene may be brighter. 1 for 8-bit images, else infinite.
    principal_point : (float, float)
        Where the optical axis meets the image, as shares of width and height from the upper left corner.
    light : Light, optional
        That of this photograph, beside those of the scene.

    Raises
    ------
    ValueError
        For a shape or split that is none of these.

    Examples
    --------
    >>> view = View("front", np.zeros((4, 6, 3), np.float32), np.eye(4), 40.0)
    >>> view.size, bool(view.mask.all())
    ((6, 4), True)
    """

    name: str
    image: np.ndarray
    to_world: np.ndarray
    fov: float
    mask: np.ndarray = None  # type: ignore[assignment]  # never None afterwards
    split: str = "train"
    ceiling: float = math.inf
    principal_point: tuple[float, float] = (0.5, 0.5)
    light: Light | None = None

    def __post_init__(self):
        image, to_world = np.asarray(self.image, np.float32), np.asarray(self.to_world, np.float64)
        mask = np.ones(image.shape[:2], bool) if self.mask is None else np.asarray(self.mask).astype(bool)
        if image.ndim != 3 or image.shape[2] != 3 or not image.size or mask.shape != image.shape[:2]:
            raise ValueError(
                f'view "{self.name}": image and mask have shapes {image.shape} and {mask.shape}; needed: (height, '
                "width, 3), and (height, width) of a mask."
            )
        if to_world.shape != (4, 4) or self.split not in ("train", "test"):
            raise ValueError(
                f'view "{self.name}": to_world has shape {to_world.shape}, split is {self.split!r}; needed: (4, 4), '
                'and "train" or "test".'
            )
        hidden = ~mask[..., None] & ~np.isfinite(image)
        if hidden.any():  # 0 times NaN, a weight times a pixel, would be NaN
            image = np.where(hidden, np.float32(0), image)
        x, y = self.principal_point
        numbers = {"fov": float(self.fov), "ceiling": float(self.ceiling), "principal_point": (float(x), float(y))}
        for name, value in {"image": image, "mask": mask, "to_world": to_world, **numbers}.items():
            object.__setattr__(self, name, value)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in pixels."""
        return self.image.shape[1], self.image.shape[0]

    @property
    def saturated(self) -> np.ndarray:
        """Mask (H, W, 3) of the pixels that only say "at least this bright"."""
        return self.image >= self.ceiling * (1 - 1e-6)  # 1e-6: float32

    def sensor(self) -> dict:
        """The camera for ``mi.load_dict``; every pixel is the mean over its square."""
        width, height = self.size
        return {
            "type": "perspective",
            "fov": self.fov,
            "fov_axis": "x",
            "principal_point_offset_x": 0.5 - self.principal_point[0],
            "principal_point_offset_y": 0.5 - self.principal_point[1],
            "to_world": mi.ScalarTransform4f((self.to_world @ _TURN).tolist()),
            "sampler": {"type": "independent"},
            "film": {
                "type": "hdrfilm",
                "width": width,
                "height": height,
                "pixel_format": "rgb",
                "rfilter": {"type": "box"},
            },
        }

    def smaller(self, factor: int) -> View:
        """The same view with `factor` x `factor` pixels averaged; a block counts if all of its pixels do.

        What is left over at the right and lower border is cut off. A block with a saturated pixel is known from below
        only: its value is taken as saturated if it is, and left out of the mask else.
        """
        if isinstance(factor, bool) or not isinstance(factor, Integral) or factor < 1:
            raise ValueError(f'view "{self.name}": made {factor!r} times smaller; needed: a positive integer.')
        if factor == 1:
            return self
        height, width = (n // factor for n in self.image.shape[:2])
        if not min(width, height):
            raise ValueError(
                f'view "{self.name}": {self.size[0]} x {self.size[1]} pixels are too few for 1/{factor} of them.'
            )

        def blocks(a):
            return a[: height * factor, : width * factor].reshape(height, factor, width, factor, *a.shape[2:])

        all_of, any_of = blocks(self.saturated).all((1, 3)), blocks(self.saturated).any((1, 3))
        image = blocks(self.image).mean((1, 3), dtype=np.float64).astype(np.float32)
        share = width * factor / self.size[0], height * factor / self.size[1]
        return self._cut(image, blocks(self.mask).all((1, 3)) & ~(any_of & ~all_of).any(-1), share)

    def with_square_pixels(self, ratio: float) -> View:
        """The same view resampled to square pixels, as Mitsuba's camera has them.

        The finer axis is made coarser: each new pixel is the mean over its square. It counts if all pixels do that it
        covers, and is taken as saturated as in :meth:`smaller`. What is left over at the right or lower border is cut
        off.

        Parameters
        ----------
        ratio : float
            Focal length in rows over that in columns: above 1 where pixels are wider than high.

        Examples
        --------
        >>> View("anamorphic", np.ones((8, 6, 3), np.float32), np.eye(4), 40.0).with_square_pixels(2.0).size
        (6, 4)
        """
        axis, step = (0, ratio) if ratio > 1 else (1, 1 / ratio)
        old = self.image.shape[axis]
        n = int(old / step + 1e-6)  # 1e-6: a whole number that rounding made smaller
        if not n:
            raise ValueError(f'view "{self.name}": {old} pixels are too few for pixels {step:g} times as large.')
        first = np.arange(n) * step
        image, seen = np.zeros((n, *np.delete(self.image.shape, axis)), np.float32), np.moveaxis(self.image, axis, 0)
        mask, bright = np.moveaxis(self.mask, axis, 0), np.moveaxis(self.saturated, axis, 0)
        counts, all_of, any_of = np.ones(image.shape[:2], bool), np.ones(image.shape, bool), np.zeros(image.shape, bool)
        for k in range(int(np.ceil(step)) + 1):
            index = np.floor(first).astype(int) + k
            weight = np.clip(np.minimum(index + 1, first + step) - np.maximum(index, first), 0, None) / step
            index, used = np.minimum(index, old - 1), weight > 1e-6  # less is rounding
            image += (weight * used)[:, None, None].astype(np.float32) * seen[index]
            counts &= mask[index] | ~used[:, None]
            all_of &= bright[index] | ~used[:, None, None]
            any_of |= bright[index] & used[:, None, None]
        # a mean of ones may be 1 - 6e-8
        image = np.where(all_of, max(self.ceiling, 0) if np.isfinite(self.ceiling) else image, image).astype(np.float32)
        share = (1.0, n * step / old) if axis == 0 else (n * step / old, 1.0)
        counts &= ~(any_of & ~all_of).any(-1)
        return self._cut(np.moveaxis(image, 0, axis), np.moveaxis(counts, 0, axis), share)

    def _cut(self, image: np.ndarray, mask: np.ndarray, share: tuple[float, float]) -> View:
        """Another image of that share of width and height, from the upper left corner."""
        return dataclasses.replace(
            self,
            image=np.ascontiguousarray(image),
            mask=mask,
            # the width that is left covers less of the plane in front of the camera
            fov=math.degrees(2 * math.atan(share[0] * math.tan(math.radians(self.fov) / 2))),
            principal_point=(self.principal_point[0] / share[0], self.principal_point[1] / share[1]),
        )
