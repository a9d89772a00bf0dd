"""Mitsuba's `principled`: the nearest parameters, as an XML file for a scene.

References
----------
Burley, "Physically Based Shading at Disney", 2012, and "Extending the Disney BRDF to a BSDF with Integrated Subsurface
Scattering", 2015; Mitsuba 3, src/bsdfs/principled.cpp: its opaque part.
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
from .microfacets import Pairs, dielectric, f0_of, ggx, schlick, smith_apart
from .nearest import OtherModel, Unknown, nearest
from .registry import exporter

_LUMINANCE = np.array([0.212671, 0.715160, 0.072169])  # of sRGB primaries, as Mitsuba has it


def evaluate(p: Pairs, v: Mapping[str, Any]) -> np.ndarray:
    """Return f_r, (K, N, 3), of values by the plugin's names; see :class:`mi_enhance.export.nearest.OtherModel`."""
    colour, metallic, tint = v["base_color"], v["metallic"][..., None], v["spec_tint"][..., None]
    luminance = np.maximum(colour @ _LUMINANCE, 1e-9)[..., None]  # 1e-9: black has no hue
    hue = colour / luminance
    eta = 2 / (1 - np.sqrt(0.08 * v["specular"])) - 1
    fresnel = metallic * schlick(colour, p.cos_d[:, None]) + (1 - metallic) * (
        tint * schlick(hue * f0_of(eta)[..., None], p.cos_d[:, None]) + (1 - tint) * dielectric(p.cos_d, eta)[..., None]
    )
    aspect = np.sqrt(1 - 0.9 * v["anisotropic"])
    ax, ay = (np.maximum(0.001, a) for a in (v["roughness"] ** 2 / aspect, v["roughness"] ** 2 * aspect))
    result = fresnel * (ggx(p.h, ax, ay) * smith_apart(p, ax, ay))[..., None]
    quarter = np.full((1, 1), 0.25)  # the roughness that the clear coat is masked with
    # the plugin's G, not G / (4 cos_i cos_o)
    masked = 4 * p.cos_i * p.cos_o * smith_apart(p, quarter, quarter)
    gtr1 = _gtr1(p.h[:, 2], 0.1 + (0.001 - 0.1) * v["clearcoat_gloss"])
    result = result + (0.25 * v["clearcoat"] * schlick(np.array(0.04), p.cos_d) * gtr1 * masked)[..., None]
    fi, fo, fd = ((1 - np.minimum(c, 1)) ** 5 for c in (p.cos_i, p.cos_o, p.cos_d))
    r = 2 * v["roughness"] * p.cos_d**2
    diffuse = (1 - 0.5 * fi) * (1 - 0.5 * fo) + r * (fo + fi + fo * fi * (r - 1))
    sheen = v["sheen"][..., None] * (1 + v["sheen_tint"][..., None] * (hue - 1)) * fd[:, None]
    return result + (1 - metallic) * (colour / np.pi * diffuse[..., None] + sheen)


def _gtr1(cos: np.ndarray, alpha: np.ndarray) -> np.ndarray:
    a2 = alpha**2
    return (a2 - 1) / (np.pi * np.log(a2) * (1 + (a2 - 1) * cos**2))


# A parameter that is 0 when the plugin is made is left out for good: boxes begin above 0 where that matters.
MODEL = OtherModel(
    "principled",
    (
        Unknown("base_color", size=3),
        Unknown("roughness", low=0.02, start=0.3),
        Unknown("metallic", start=0.3),
        Unknown("specular", low=0.001),
        Unknown("spec_tint", start=0.1),
        Unknown("anisotropic", start=0.02),
        Unknown("sheen", start=0.1),
        Unknown("sheen_tint", start=0.5),
        Unknown("clearcoat", start=0.2),
        Unknown("clearcoat_gloss", start=0.5),
    ),
    tuple({"roughness": r, "metallic": m} for r in (0.05, 0.1, 0.2, 0.4, 0.7) for m in (0.1, 0.9)),
    evaluate,
)


@exporter(".xml", about="Mitsuba's `principled`, nearest parameters, to be included in a scene", measured=True)
def write_xml(
    source: Material | str | Path, path: str | Path, *, material: str = "", progress: Callback = silent
) -> dict[str, Any]:
    """Write a scene file that holds the BSDF; ``<include filename="..."/>`` brings it into another one.

    Parameters
    ----------
    source : Material, str or Path
        A material, or a measured file of any kind.
    path : str or Path
        ``.xml``; the ``id`` of the BSDF is its name without the suffix.
    material : str
        Which one, in a measured file that holds several.
    progress : callable, optional
        See :class:`mi_enhance.system.progress.Progress`.

    Returns
    -------
    dict
        ``bytes``, ``log_l1`` of the model against the source, and the values by their names.

    Examples
    --------
    >>> write_xml(Material.analytic("ggx"), "ggx.xml")["roughness"]  # doctest: +SKIP
    0.5
    """
    f, name, _ = opened(source, material)
    found = nearest(MODEL, f, progress=progress)
    lines = [f"    {_entry(key, value)}" for key, value in found.values.items()]
    write_text(
        path,
        f'<scene version="3.0.0">\n<!-- {_comment(name)}: log-L1 {found.log_l1:.4f} against its source -->\n'
        f'<bsdf type="principled" id="{identifier(Path(path).stem)}">\n' + "\n".join(lines) + "\n</bsdf>\n</scene>\n",
    )
    return {"bytes": Path(path).stat().st_size, "log_l1": found.log_l1, **found.values}


def _entry(key: str, value: Any) -> str:
    if isinstance(value, list):
        return f'<rgb name="{key}" value="{", ".join(f"{v:.6g}" for v in value)}"/>'
    return f'<float name="{key}" value="{value:.6g}"/>'


def identifier(name: str) -> str:
    """Return a name that XML takes for one: letters, digits and underscores, no digit in front.

    Examples
    --------
    >>> identifier("3 blue-ball")
    '_3_blue_ball'
    """
    word = "".join(c if c.isascii() and c.isalnum() else "_" for c in name) or "_"
    return f"_{word}" if word[0].isdigit() else word


def _comment(text: str) -> str:
    return identifier(text).replace("__", "_")  # two hyphens would end a comment
