"""The maps of a material as textures of the plugin."""

# Where types are ignored, the name is missing in Mitsuba's stubs, or of another type there.

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from mi_enhance.bsdfs.properties import choice

from mi_enhance.material.material import Material
from mi_enhance.material.material_maps import MaterialMaps

_FILTERS = {"bilinear": dr.FilterMode.Linear, "nearest": dr.FilterMode.Nearest}
_WRAPS = {"repeat": dr.WrapMode.Repeat, "mirror": dr.WrapMode.Mirror, "clamp": dr.WrapMode.Clamp}


class LatentMap(mi.Texture):
    """A bitmap of as many channels as there are latent numbers; Mitsuba's own has one or three."""

    def __init__(self, data: mi.TensorXf, filter_type: str, wrap_mode: str, to_uv: mi.ScalarTransform3f):
        super().__init__(mi.Properties())
        # Not in texture memory, which a GPU has for up to four channels, and whose values have no gradients.
        self.m_texture = mi.Texture2f(  # type: ignore[operator]
            data, use_accel=False, migrate=False, filter_mode=_FILTERS[filter_type], wrap_mode=_WRAPS[wrap_mode]
        )
        self.m_to_uv = to_uv

    def traverse(self, cb):
        cb.put("data", self.m_texture.tensor(), mi.ParamFlags.Differentiable)
        cb.put("to_uv", self.m_to_uv, mi.ParamFlags.NonDifferentiable)

    def parameters_changed(self, keys=()):
        self.m_texture.update_inplace()

    def numbers(self, si: mi.SurfaceInteraction3f, active) -> list[mi.Float]:
        """All of them at the hit point."""
        m, (u, v) = self.m_to_uv.matrix, si.uv
        uv = mi.Point2f(*(m[k, 0] * u + m[k, 1] * v + m[k, 2] for k in range(2)))
        return list(self.m_texture.eval(uv, active))

    def is_spatially_varying(self):
        return True

    def to_string(self):
        return f"LatentMap[{self.m_texture.shape}]"


def textures_of(props: Any, material: Material) -> dict[str, Any]:
    """Return textures of the parameters that vary: from a file, or from the arrays of ``MaterialMaps.to_dict()``."""
    if "maps" not in props:
        return {}
    if not mi.is_rgb:
        raise ValueError(
            f'bsdf "enhanced": maps hold linear RGB, which variant "{mi.variant()}" does not render. Use an rgb one.'
        )
    filter_type = choice(props, "filter_type", "bilinear", _FILTERS)
    wrap_mode = choice(props, "wrap_mode", "repeat", _WRAPS)
    # in the precision of a bitmap's own, which `mi.traverse` can assign to
    to_uv = mi.ScalarTransform3f(props.get("to_uv", mi.ScalarTransform4f()).extract().matrix)
    if isinstance(props["maps"], str):
        maps = MaterialMaps.load(str(mi.file_resolver().resolve(props["maps"])), material)  # type: ignore[operator]
    else:
        maps = MaterialMaps.from_arrays(material, props["channels"], np.array(props["maps"]))
    result: dict[str, Any] = {}
    kinds = {p.name: p.kind for p in material.brdf.parameters}
    for name, values in maps.maps.items():
        data = mi.TensorXf(values)
        if kinds[name] == "latent":
            result[name] = LatentMap(data, filter_type, wrap_mode, to_uv)
        else:
            how = {"filter_type": filter_type, "wrap_mode": wrap_mode, "to_uv": to_uv}
            result[name] = mi.load_dict({"type": "bitmap", "data": data, "raw": True, **how})
    return result
