"""glTF 2.0: the nearest metallic-roughness parameters, as a file that holds one material.

The colour of the specular reflection and a clear coat are extensions that most viewers read; what does not know them
shows the rest.

References
----------
Khronos Group, "glTF 2.0 Specification", appendix B; extensions KHR_materials_specular, KHR_materials_clearcoat and
KHR_materials_anisotropy.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from .. import __version__
from ..material.material import Material
from ..system.files import write_text
from ..system.progress import Callback, silent
from .measured import opened
from .microfacets import Pairs, ggx, schlick, smith
from .nearest import OtherModel, Unknown, nearest
from .registry import exporter

_F0 = 0.04  # of index 1.5, which the specification fixes
_SMOOTH = 1e-4  # least alpha: a mirror has no values


def evaluate(p: Pairs, v: Mapping[str, Any]) -> np.ndarray:
    """Return f_r, (K, N, 3), of values by glTF's names; see :class:`mi_enhance.export.nearest.OtherModel`."""
    colour, metallic = v["baseColorFactor"], v["metallicFactor"][..., None]
    alpha = np.maximum(v["roughnessFactor"] ** 2, _SMOOTH)
    along = alpha + (1 - alpha) * v["anisotropyStrength"] ** 2
    lobe = _lobe(p, along, alpha, v["anisotropyRotation"])
    cos = p.cos_d[:, None]
    fresnel = schlick(np.minimum(_F0 * v["specularColorFactor"], 1), cos)
    dielectric = (1 - fresnel.max(-1, keepdims=True)) * colour / np.pi + fresnel * lobe
    metal = schlick(colour, cos) * lobe
    coat = np.maximum(v["clearcoatRoughnessFactor"] ** 2, _SMOOTH)
    share = (v["clearcoatFactor"] * schlick(np.array(_F0), p.cos_i))[..., None]
    base = dielectric + metallic * (metal - dielectric)
    return base + share * (_lobe(p, coat, coat, np.zeros((1, 1))) - base)


def _lobe(p: Pairs, ax: np.ndarray, ay: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """Return D V, (K, N, 1), of a lobe whose tangent is turned from x, counterclockwise."""
    if not np.any(ax != ay):
        return (ggx(p.h, ax, ay) * smith(p, ax, ay))[..., None]
    parts = []
    for a, b, t in zip(*np.broadcast_arrays(ax, ay, turn), strict=True):
        c, s = float(np.cos(t[0])), float(np.sin(t[0]))
        to_tangent = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])  # of row vectors
        q = p._replace(i=p.i @ to_tangent, o=p.o @ to_tangent, h=p.h @ to_tangent)
        parts.append(ggx(q.h, a, b) * smith(q, a, b))
    return np.stack(parts)[..., None]


MODEL = OtherModel(
    "glTF metallic-roughness",
    (
        Unknown("baseColorFactor", size=3),
        Unknown("metallicFactor", start=0.3),
        Unknown("roughnessFactor", low=0.02, start=0.3),
        Unknown("specularColorFactor", high=1 / _F0, start=1.0, size=3),
        Unknown("clearcoatFactor", start=0.2),
        Unknown("clearcoatRoughnessFactor", low=0.02, start=0.2),
        Unknown("anisotropyStrength", start=0.02),
        Unknown("anisotropyRotation", low=-np.pi / 2, high=np.pi, start=0.0),
    ),
    (
        *({"roughnessFactor": r, "metallicFactor": m} for r in (0.05, 0.1, 0.2, 0.4, 0.7) for m in (0.1, 0.9)),
        {"roughnessFactor": 0.3, "anisotropyStrength": 0.3, "anisotropyRotation": np.pi / 2},
    ),
    evaluate,
)


def write_gltf(
    source: Material | str | Path, path: str | Path, *, material: str = "", progress: Callback = silent
) -> dict[str, Any]:
    """Write a glTF file without geometry; its one entry of ``materials`` is to be put into that of a model.

    Parameters
    ----------
    source, material, progress
        As for :func:`mi_enhance.export.principled.write_xml`.
    path : str or Path
        ``.json`` or ``.gltf``; the material bears its name without the suffix.

    Returns
    -------
    dict
        ``bytes``, ``log_l1`` of the model against the source, and the values by their names.

    Examples
    --------
    >>> write_gltf(Material.analytic("ggx"), "ggx.gltf")["log_l1"]  # doctest: +SKIP
    0.004
    """
    f, _, _ = opened(source, material)
    found = nearest(MODEL, f, progress=progress)
    v = {key: np.round(value, 6).tolist() for key, value in found.values.items()}
    extensions = {
        "KHR_materials_specular": {"specularColorFactor": v["specularColorFactor"]},
        "KHR_materials_clearcoat": {k: v[k] for k in ("clearcoatFactor", "clearcoatRoughnessFactor")},
        "KHR_materials_anisotropy": {k: v[k] for k in ("anisotropyStrength", "anisotropyRotation")},
    }
    one = {
        "name": Path(path).stem,
        "pbrMetallicRoughness": {
            "baseColorFactor": [*v["baseColorFactor"], 1.0],
            "metallicFactor": v["metallicFactor"],
            "roughnessFactor": v["roughnessFactor"],
        },
        "extensions": extensions,
        "extras": {"log_l1": round(found.log_l1, 6)},
    }
    asset = {"version": "2.0", "generator": f"mi_enhance {__version__}"}
    write_text(
        path,
        json.dumps({"asset": asset, "extensionsUsed": sorted(extensions), "materials": [one]}, indent=1) + "\n",
    )
    return {"bytes": Path(path).stat().st_size, "log_l1": found.log_l1, **found.values}


for _suffix in (".json", ".gltf"):
    exporter(_suffix, about="glTF 2.0 material, nearest parameters", measured=True)(write_gltf)
