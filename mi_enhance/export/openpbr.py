"""OpenPBR: the nearest parameters, as a MaterialX document.

The model is the reference graph of OpenPBR 1.1 without transmission, subsurface, thin films and fuzz: diffuse base,
dielectric or metal, coat. Directional albedos are those of GGX with Schlick's Fresnel term.

References
----------
Academy Software Foundation, "OpenPBR Surface specification", 1.1: sections Metal, Glossy-diffuse, Coat, and
open_pbr_surface.mtlx for what the specification leaves to implementations.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..material.material import Material
from ..system.files import write_text
from ..system.progress import Callback, silent
from .measured import opened
from .microfacets import Pairs, albedo, dielectric, f0_of, ggx, oren_nayar, schlick, smith
from .nearest import OtherModel, Unknown, nearest
from .principled import identifier
from .registry import exporter

_COAT_IOR = 1.6  # the default
_EDGE = 1 / 7  # cosine of the angle whose colour `specular_color` is, for metals
_SMOOTH = 1e-4  # least alpha: a mirror has no values


def evaluate(p: Pairs, v: Mapping[str, Any]) -> np.ndarray:
    """Return f_r, (K, N, 3), of values by OpenPBR's names; see :class:`mi_enhance.export.nearest.OtherModel`."""
    colour, tint, metal, coat = v["base_color"], v["specular_color"], v["base_metalness"][..., None], v["coat_weight"]
    roughened = np.minimum(1, v["specular_roughness"] ** 4 + 2 * v["coat_roughness"] ** 4) ** 0.25
    ax, ay = _alphas(_mix(v["specular_roughness"], roughened, coat), v["specular_roughness_anisotropy"])
    lobe = ggx(p.h, ax, ay) * smith(p, ax, ay)
    a, b = albedo(p.cos_i, np.sqrt(ax * ay))
    under = v["specular_ior"] / _COAT_IOR
    eta = _mix(v["specular_ior"], np.where(under > 1, under, 1 / under), coat)
    f0 = f0_of(eta)
    reflected = dielectric(p.cos_d, eta)
    twice = _twice(reflected, a + b)
    gloss = tint * (reflected * lobe * twice)[..., None]
    base = gloss + _left((f0 * a + b) * twice) * oren_nayar(p, colour, v["base_diffuse_roughness"])
    edge = schlick(colour, np.array(_EDGE)) * (1 - tint) / (_EDGE * (1 - _EDGE) ** 6)
    cos = p.cos_d[:, None]
    fresnel = np.maximum(schlick(colour, cos) - cos * (1 - cos) ** 6 * edge, 0)
    base = _mix(base, fresnel * lobe[..., None] * _twice(fresnel, (a + b)[..., None]), metal)
    f0_coat = f0_of(np.array(_COAT_IOR))
    inner = 1 - (1 - f0_coat) / _COAT_IOR**2  # the part of the light that the coat returns to the base
    base = base * _mix(np.ones(3), (1 - inner) / (1 - colour * inner), coat[..., None])
    ax, ay = _alphas(v["coat_roughness"], np.zeros((1, 1)))
    a, b = albedo(p.cos_i, ax)
    reflected = dielectric(p.cos_d, np.array(_COAT_IOR))
    twice = _twice(reflected, a + b)
    top = reflected * ggx(p.h, ax, ay) * smith(p, ax, ay) * twice
    return (coat * top)[..., None] + _left(coat * (f0_coat * a + b) * twice) * base


def _twice(fresnel: np.ndarray, once: np.ndarray) -> np.ndarray:
    """Return the factor for light that is scattered more than once (Turquin 2019); `once`: white, scattered once."""
    return 1 + fresnel * (1 - once) / np.maximum(once, 1e-3)  # 1e-3: no lobe loses more


def _left(reflected: np.ndarray) -> np.ndarray:
    """Return what a layer leaves to the one below, (K, N, 1): the specification's scaling by the albedo."""
    return np.maximum(1 - reflected, 0)[..., None]


def _alphas(roughness: np.ndarray, anisotropy: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    along = roughness**2 * np.sqrt(2 / (1 + (1 - anisotropy) ** 2))
    return np.maximum(along, _SMOOTH), np.maximum((1 - anisotropy) * along, _SMOOTH)


def _mix(a: Any, b: Any, t: Any) -> Any:
    return a + t * (b - a)


MODEL = OtherModel(
    "open_pbr_surface",
    (
        Unknown("base_color", high=0.999, size=3),
        Unknown("base_metalness", start=0.3),
        Unknown("base_diffuse_roughness", start=0.3),
        Unknown("specular_color", start=0.8, size=3),
        Unknown("specular_roughness", low=0.02, start=0.3),
        Unknown("specular_ior", low=1.02, high=3.0, start=1.5),
        Unknown("specular_roughness_anisotropy", high=0.95, start=0.02),
        Unknown("coat_weight", start=0.2),
        Unknown("coat_roughness", low=0.02, start=0.2),
    ),
    tuple({"specular_roughness": r, "base_metalness": m} for r in (0.05, 0.1, 0.2, 0.4, 0.7) for m in (0.1, 0.9)),
    evaluate,
)


@exporter(".mtlx", about="MaterialX document with OpenPBR's surface, nearest parameters", measured=True)
def write_mtlx(
    source: Material | str | Path, path: str | Path, *, material: str = "", progress: Callback = silent
) -> dict[str, Any]:
    """Write a MaterialX 1.39 document with one surface and one material, in linear sRGB.

    Parameters
    ----------
    source, material, progress
        As for :func:`mi_enhance.export.principled.write_xml`.
    path : str or Path
        ``.mtlx``; the material bears its name without the suffix.

    Returns
    -------
    dict
        ``bytes``, ``log_l1`` of the model against the source, and the values by their names.

    Examples
    --------
    >>> write_mtlx(Material.analytic("ggx"), "ggx.mtlx")["log_l1"]  # doctest: +SKIP
    0.002
    """
    f, _, _ = opened(source, material)
    found = nearest(MODEL, f, progress=progress)
    name = identifier(Path(path).stem)
    inputs = "\n".join(f"    {_input(key, value)}" for key, value in found.values.items())
    write_text(
        path,
        f"""<?xml version="1.0"?>
<materialx version="1.39" colorspace="lin_rec709">
  <!-- log-L1 {found.log_l1:.4f} against its source -->
  <open_pbr_surface name="surface_{name}" type="surfaceshader">
{inputs}
  </open_pbr_surface>
  <surfacematerial name="{name}" type="material">
    <input name="surfaceshader" type="surfaceshader" nodename="surface_{name}" />
  </surfacematerial>
</materialx>
""",
    )
    return {"bytes": Path(path).stat().st_size, "log_l1": found.log_l1, **found.values}


def _input(key: str, value: Any) -> str:
    kind, numbers = ("color3", value) if isinstance(value, list) else ("float", [value])
    return f'<input name="{key}" type="{kind}" value="{", ".join(f"{v:.6g}" for v in numbers)}" />'
