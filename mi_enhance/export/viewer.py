"""A page for the browser that shows a material: a sphere in a room, sliders, the lobe. One file, no network needed."""

from __future__ import annotations

import base64
import dataclasses
import functools
import html
import json
from pathlib import Path

import mitsuba as mi
import numpy as np

from .. import __version__
from ..material.material import Material
from ..neural.enhance import enhance
from ..system.bundled_files import scene_file
from ..system.files import write_text
from . import javascript, shaders
from .program import record
from .registry import exporter

_SIZE = (128, 64)  # of the environment map in the page


@exporter(".html", about="A page for the browser: a sphere in a room, sliders, beside the analytic model")
def write_html(material: Material, path: Path) -> dict:
    """Write a material as a page, see :func:`page`."""
    text = page(material, Path(path).stem)
    write_text(path, text)
    return {"bytes": len(text.encode())}


def page(material: Material, name: str = "material") -> str:
    """Return one HTML file that shows a material, and the analytic model of the same parameters beside it.

    Parameters
    ----------
    material : Material
    name : str
        What the page calls it, and the file in the command line that repeats an edit.

    Returns
    -------
    str

    Examples
    --------
    >>> text = page(Material.analytic("ggx"))
    >>> text.startswith("<!doctype html>"), "http" in text
    (True, False)
    """
    programs = {"a": record(material), "b": record(_analytic(material))}
    ranges = [
        {"name": q.name, "low": q.low, "high": q.high, "log": q.log, "value": material.params[q.name].tolist()}
        for q in material.brdf.model.parameters
    ]
    fields = {
        "NAME": html.escape(name),
        "EQUATION": html.escape(str(material.brdf)),
        "VERSION": __version__,
        "FILE": _literal(name),
        "SHADER": _literal("\n".join(shaders.source(p, key) for key, p in programs.items())),
        "MODELS": f"[{', '.join(map(javascript.source, programs.values()))}]",
        "PARAMETERS": _literal(ranges),
        "ENVIRONMENT": _environment(),
    }
    text = (Path(__file__).parent / "viewer.html").read_text(encoding="utf-8")
    for key, value in fields.items():
        text = text.replace(f"%{key}%", value)
    return text


def _literal(value: object) -> str:
    """Return JSON that may stand in a script: nothing in it closes the element."""
    return json.dumps(value).replace("<", "\\u003c")


def _analytic(material: Material) -> Material:
    """Return the model without its networks, of the same parameters."""
    brdf = enhance(material.brdf.model, replace=())
    params = {q.name: material.params[q.name] for q in brdf.parameters}
    return dataclasses.replace(material, brdf=brdf, params=params, library=None)


@functools.cache
def _environment() -> str:
    """Return the bundled environment map as base64 of float16, RGB row after row."""
    bitmap = mi.Bitmap(str(scene_file("envmaps/apartment.exr")))
    bitmap = bitmap.convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32, srgb_gamma=False)
    texels = np.array(bitmap.resample(mi.ScalarVector2u(*_SIZE)))
    return base64.b64encode(np.clip(texels, 0, 6e4).astype("<f2").tobytes()).decode()


class View:
    """What :func:`view` returns: it shows itself in a notebook."""

    def __init__(self, text: str):
        self.html = text

    def _repr_html_(self) -> str:
        escaped = html.escape(self.html, quote=True)
        return f'<iframe srcdoc="{escaped}" style="width: 100%; height: 640px; border: 0"></iframe>'


def view(material: Material, name: str = "material") -> View:
    """Show a material in a notebook, live: it can be turned, lit and edited.

    Parameters
    ----------
    material : Material
    name : str
        As of :func:`page`.

    Returns
    -------
    View
        Its ``html`` is the page.

    Examples
    --------
    >>> view(Material.analytic("ggx")).html == page(Material.analytic("ggx"))
    True
    """
    return View(page(material, name))
