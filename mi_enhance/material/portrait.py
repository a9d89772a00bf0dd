"""How a material shows itself in a notebook: a sphere between two soft boxes, its equation and its numbers."""

from __future__ import annotations

import base64
import html
import io
from typing import TYPE_CHECKING, Any

import drjit as dr
import mitsuba as mi
import numpy as np

from ..output.srgb import encode_srgb

if TYPE_CHECKING:
    from .material import Material

_SIZE, _SAMPLES = 144, 64  # pixels on a side, samples of each: 0.2 s once the kernel is compiled
_STEPS = tuple(
    1.1347241384**-k % 1 for k in range(1, 6)
)  # irrational to one another: 1 / g^k, g^6 = g + 1 (R sequence)


def portrait(material: Material) -> np.ndarray:
    """Return a picture of a sphere, seen from far away: (144, 144, 4), uint8, sRGB and coverage.

    No scene is loaded: directions are drawn from the material, and light comes from two soft boxes in a grey room.

    Examples
    --------
    >>> mi.set_variant("llvm_ad_rgb")
    >>> from mi_enhance import Material
    >>> picture = portrait(Material.analytic("ggx"))
    >>> picture.shape, picture[0, 0].tolist()
    ((144, 144, 4), [0, 0, 0, 0])
    """
    lane = dr.arange(mi.UInt32, _SIZE * _SIZE * _SAMPLES)
    pixel, k = lane // _SAMPLES, mi.Float(lane % _SAMPLES)
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(0, _SIZE * _SIZE)

    def spread(alpha: float) -> Any:  # numbers of a pixel that lie evenly, each pixel's moved by another amount
        v = dr.gather(mi.Float, sampler.next_1d(), pixel) + k * alpha
        return v - dr.floor(v)

    x = (mi.Float(pixel % _SIZE) + spread(_STEPS[3])) * (2 / _SIZE) - 1
    y = 1 - (mi.Float(pixel // _SIZE) + spread(_STEPS[4])) * (2 / _SIZE)
    inside: Any = x * x + y * y < 1
    n = mi.Vector3f(x, y, dr.safe_sqrt(1 - x * x - y * y))
    across = dr.normalize(mi.Vector3f(n.z + 1e-6, 0, -n.x))  # a tangent along the equator
    frame = mi.Frame3f(across, dr.cross(n, across), n)
    si = dr.zeros(mi.SurfaceInteraction3f, dr.width(lane))
    si.wi = frame.to_local(mi.Vector3f(0, 0, 1))
    point = mi.Point2f(spread(_STEPS[0]), spread(_STEPS[1]))
    drawn: Any
    weight: Any
    drawn, weight = material.bsdf().sample(mi.BSDFContext(), si, spread(_STEPS[2]), point, inside)
    colour = dr.select(inside, weight * _light(frame.to_world(drawn.wo)), 0)
    channels = [dr.block_sum(c, _SAMPLES) / _SAMPLES for c in (*colour, dr.select(inside, mi.Float(1), 0))]
    picture = np.array([np.array(c) for c in channels]).T.reshape(_SIZE, _SIZE, 4)
    coverage = picture[..., 3:]
    seen = encode_srgb(picture[..., :3] / np.maximum(coverage, 1 / _SAMPLES))
    return np.round(255 * np.concatenate([np.nan_to_num(seen), coverage], 2)).astype(np.uint8)


def _light(d: mi.Vector3f) -> Any:
    """Return the radiance from a direction: a dark floor, a brighter ceiling, two soft boxes."""
    grey = 0.35 + 0.25 * d.y
    boxes = (((-0.6, 0.65, 0.5), 0.9, 5), ((0.85, 0.2, 0.45), 0.95, 3))  # towards, cosine of the radius, radiance
    for towards, cos, radiance in boxes:
        c = dr.dot(d, dr.normalize(mi.Vector3f(towards)))
        grey += radiance * dr.clip((c - cos) * 30, 0, 1)  # a soft rim, which hides the noise of the samples
    return grey


def page(material: Material) -> str:
    """Return HTML with the picture, where the active variant can make it, and what `Material.show` says."""
    text = f'<pre style="margin: 0; line-height: 1.35">{html.escape(material.show())}</pre>'
    variant = mi.variant() or "none"
    if "_rgb" not in variant or variant.startswith("scalar"):
        return text
    from PIL import Image

    file = io.BytesIO()
    Image.fromarray(portrait(material)).save(file, "png")
    data = base64.b64encode(file.getvalue()).decode()
    image = f'<img src="data:image/png;base64,{data}" width="{_SIZE}" height="{_SIZE}" alt="a sphere of the material">'
    return f'<div style="display: flex; gap: 16px; align-items: flex-start">{image}{text}</div>'
