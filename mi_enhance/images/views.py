"""Photographs with poses: the record, cameras around an object, renders of a scene in the place of photographs.

The camera convention is OpenGL's, as in most such files: ``transform_matrix`` takes camera to world coordinates, the
camera looks along its -z, +y is up, +x right. Mitsuba's cameras look along +z with +x to the left; this file is the one
place that translates.
"""

from __future__ import annotations

import dataclasses
import math

import mitsuba as mi
import numpy as np

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
        Pixels that count; all if left out.
    split : {"train", "test"}
        What is fitted, or held out and only reported.
    ceiling : float
        Value at which the camera saturates: there the scene may be brighter. 1 for 8-bit images, else infinite.
    principal_point : (float, float)
        Where the optical axis meets the image, as shares of width and height from the upper left corner.

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
    mask: np.ndarray | None = None
    split: str = "train"
    ceiling: float = math.inf
    principal_point: tuple[float, float] = (0.5, 0.5)

    def __post_init__(self):
        if self.mask is None:
            object.__setattr__(self, "mask", np.ones(self.image.shape[:2], bool))

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in pixels."""
        return self.image.shape[1], self.image.shape[0]

    @property
    def saturated(self) -> np.ndarray:
        """Where the photograph only says "at least this bright", (H, W, 3) of bool."""
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
        if factor == 1:
            return self
        height, width = (n // factor for n in self.image.shape[:2])
        if not min(width, height):
            raise ValueError(
                f'view "{self.name}": {self.size[0]} x {self.size[1]} pixels are too few for 1/{factor} of them.'
            )

        def blocks(a):
            return a[: height * factor, : width * factor].reshape(height, factor, width, factor, *a.shape[2:])

        full, rest = blocks(self.saturated).all((1, 3)), blocks(self.saturated).any((1, 3))
        image = blocks(self.image).mean((1, 3), dtype=np.float64).astype(np.float32)
        share = width * factor / self.size[0], height * factor / self.size[1]
        return dataclasses.replace(
            self,
            image=image,
            mask=blocks(self.mask).all((1, 3)) & ~(rest & ~full).any(-1),
            # the width that is left covers less of the plane in front of the camera
            fov=math.degrees(2 * math.atan(share[0] * math.tan(math.radians(self.fov) / 2))),
            principal_point=(self.principal_point[0] / share[0], self.principal_point[1] / share[1]),
        )
