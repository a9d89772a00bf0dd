"""The distance of renders from photographs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from .targets import Target

LOSSES = ("log", "relative")
_NEAR = 0.02


def brightness(colours: np.ndarray) -> float:
    """Median of pixels (N, 3): what is dark is compared by difference, what is bright by ratio."""
    values = colours.mean(-1)
    # a tenth of the mean: more than half of the pixels may be black; 1e-6: all of them
    return float(max(np.median(values), 0.1 * values.mean(), 1e-6))


def ratio(targets: Sequence[Target], images: Sequence[np.ndarray], number: int | None = None) -> float:
    """Median of photograph over image, where a pixel counts and neither is dark; of one photograph, by its number."""
    ratios = []
    for target, image in zip(targets, images, strict=True):
        truth = target.image.mean(-1)
        used = (target.weight[..., 0] > 0) & (truth > 0) & (image.mean(-1) > 0)
        used &= ~target.saturated.any(-1)
        if number is not None:
            used &= target.numbers == number
        ratios.append(truth[used] / image.mean(-1)[used])
    every = np.concatenate(ratios)
    return float(np.median(every)) if every.size else 1.0


class Measure(NamedTuple):
    r"""The distance of a render from a target: weighted mean over pixels and channels.

    .. math:: L_{log} = \sum_k w_k \left| \log(1 + x_k / s) - \log(1 + t_k / s) \right|, \qquad
              L_{rel} = \sum_k w_k |x_k - t_k| / (t_k + s)

    Both are robust: a highlight, or a pixel that no parameter explains, counts with its logarithm, or once. Where the
    photograph is saturated the render is compared after clipping: brighter is as good.

    Parameters
    ----------
    kind : {"log", "relative"}
    scale : float
        s, see :func:`brightness`.
    """

    kind: str
    scale: float

    def loss(self, image: np.ndarray, target: Target) -> float:
        """The loss of an image with little noise, (H, W, 3)."""
        truth, weight = target.image, target.weight
        x = np.where(target.saturated, np.minimum(image, truth), image)
        if self.kind == "log":
            difference = np.log1p(np.maximum(x, 0) / self.scale) - np.log1p(truth / self.scale)
        else:
            difference = (x - truth) / (truth + self.scale)
        return float((weight * np.abs(difference)).sum(dtype=np.float64))

    def pull(self, image: np.ndarray, other: np.ndarray, target: Target) -> np.ndarray:
        """Return the derivative of the loss with respect to a noisy render, (H, W, 3), without bias.

        The absolute value of a noisy difference would be least where the median of a render is the photograph, and
        noise of light is skewed: colours came out 10 % too bright at 16 samples. So the difference is squared, over its
        size in an independent render: reweighted least squares.

        Parameters
        ----------
        image : array (H, W, 3)
            Its noise must not be that of the gradient which is multiplied by this.
        other : array (H, W, 3)
            Independent of `image`.
        """
        truth, saturated = target.image, target.saturated
        slope = 1 / ((np.maximum(other, 0) if self.kind == "log" else truth) + self.scale)
        # a share of the brightness: what is explained to within the noise pulls in proportion to its distance
        size = np.abs(other - truth) + _NEAR * (truth + self.scale)
        free = saturated & (other >= truth)
        return np.where(free, 0, target.weight * slope / size * (image - truth))
