"""A page for the browser that shows a material: on a ball in a room, with sliders and figures. One file, no network."""

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
from ..data.functions import function_of
from ..data.measurements import Measurements
from ..data.scattered import interpolated
from ..evaluation.ancestor import fitted_ancestor
from ..material.material import Material
from ..neural.enhance import enhance
from ..system.bundled_files import scene_file
from ..system.files import material_name, write_text
from . import javascript, shaders, truth
from .ball import shader_ball
from .program import record
from .registry import exporter

_SIZE = (128, 64)  # of the environment map in the page
_FILES = ("gl.js", "room.js", "viewer.js", "plots.js", "controls.js")  # in the order in which the page runs them
_SHADERS = ("surface", "blocks", "trace", "show")


@exporter(".html", about="A page for the browser: on a ball in a room, sliders, beside the analytic model")
def write_html(material: Material, path: Path) -> dict:
    """Write a material as a page, see :func:`page`."""
    text = page(material, name=Path(path).stem)
    write_text(path, text)
    return {"bytes": len(text.encode())}


def page(
    material: Material,
    measured: Measurements | str | Path | None = None,
    *,
    name: str = "material",
    collected: str | None = None,
) -> str:
    """Return one HTML file that shows a material beside its analytic model and a measurement.

    Parameters
    ----------
    material : Material
    measured : Measurements, str or Path, optional
        What the material was fitted to, or a file of it of any kind that :func:`mi_enhance.data.load` reads. The page
        holds the mean over its azimuths. The analytic model is then fitted to it; otherwise it has the parameters of
        the material.
    name : str
        What the page calls the material, and the file in the command line that repeats an edit.
    collected : str, optional
        Name of the measured material, in a file that holds several.

    Returns
    -------
    str

    Raises
    ------
    FileNotFoundError, ValueError, RuntimeError
        If `measured` cannot be read, or no variant is active that evaluates the material.

    Examples
    --------
    >>> text = page(Material.analytic("ggx"))
    >>> text.startswith("<!doctype html>"), "http" in text
    (True, False)
    """
    is_enhanced = bool(material.brdf.networks or material.brdf.distilled)
    analytic = material.brdf.model.name
    models = [_model("enhanced" if is_enhanced else analytic, material)]
    table = _table(measured, collected)
    if is_enhanced and measured is None:
        models.append(_model(f"{analytic}, same parameters", _without_networks(material)))
    elif is_enhanced:
        label, ancestor = fitted_ancestor(material, measured, collected)
        models.append(_model(label, ancestor))
    ranges = [
        {"name": q.name, "low": [q.low] * q.size, "high": [q.high] * q.size, "log": q.log}
        for q in material.brdf.model.parameters
    ]
    lines = ["thick: enhanced", f"thin: {analytic}"] if is_enhanced else [f"lines: {analytic}"]
    fields = {
        "NAME": html.escape(name),
        "EQUATION": html.escape(str(material.brdf)) + ("; brackets are neural networks" if is_enhanced else ""),
        "VERSION": __version__,
        "LINES": html.escape(", ".join(lines + (["pale: measured"] if table else []))),
        "SLICES": html.escape(
            "from the left: " + ", ".join([*(m[0] for m in models), *(["measured"] if table else [])])
        ),
        "SCRIPT": "\n".join(
            [
                f"const NAME = {_literal(name)}, PARAMETERS = {_literal(ranges)}, TRUTH = {_literal(table)};",
                f"const MODELS = [{', '.join(text for _, text in models)}];",
                *(f"const {part.upper()} = {_literal(_part(f'{part}.glsl'))};" for part in _SHADERS),
                f"const ENVIRONMENT = {_literal(_environment())}, BALL = {_literal(shader_ball())};",
                *map(_part, _FILES),
            ]
        ),
    }
    text = _part("page.html")
    for key, value in fields.items():
        text = text.replace(f"%{key}%", value, 2)
    return text


def _part(name: str) -> str:
    return (Path(__file__).parent / "page" / name).read_text(encoding="utf-8")


def _literal(value: object) -> str:
    """Return JSON that may stand in a script: nothing in it closes the element."""
    return json.dumps(value).replace("<", "\\u003c")


def _model(label: str, material: Material) -> tuple[str, str]:
    """Return a label and a JavaScript object: the functions of a model, shader, first parameters."""
    program = record(material)
    values = {q.name: material.params[q.name].tolist() for q in program.parameters}
    fields = {
        "label": label,
        "values": values,
        "source": shaders.source(program, "m"),
    }
    return label, f"{{ ...{javascript.source(program)}, ...{_literal(fields)} }}"


def _table(measured: Measurements | str | Path | None, collected: str | None) -> dict | None:
    if measured is None:
        return None
    if isinstance(measured, Measurements):
        f, label = interpolated(measured), measured.name
    else:
        f, label = function_of(measured, material=collected), collected or material_name(measured)
    return {"label": f"measured: {label}", "size": truth.SIZE, "texels": truth.table(f)}


def _without_networks(material: Material) -> Material:
    """Return the model without its networks, of the same parameters."""
    brdf = enhance(material.brdf.model, replace=())
    params = {q.name: material.params[q.name] for q in brdf.parameters}
    return dataclasses.replace(material, brdf=brdf, params=params, library=None)


@functools.cache
def _environment() -> dict:
    """Return the bundled environment map as base64 of float16, RGB row after row."""
    bitmap = mi.Bitmap(str(scene_file("envmaps/apartment.exr")))
    bitmap = bitmap.convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32, srgb_gamma=False)
    texels = np.array(bitmap.resample(mi.ScalarVector2u(*_SIZE)))
    text = base64.b64encode(np.clip(texels, 0, 6e4).astype("<f2").tobytes()).decode()
    return {"width": _SIZE[0], "height": _SIZE[1], "texels": text}


class View:
    """What :func:`view` returns: it shows itself in a notebook."""

    def __init__(self, text: str):
        self.html = text

    def _repr_html_(self) -> str:
        escaped = html.escape(self.html, quote=True)
        return f'<iframe srcdoc="{escaped}" style="width: 100%; height: 900px; border: 0"></iframe>'


def view(
    material: Material,
    measured: Measurements | str | Path | None = None,
    *,
    name: str = "material",
    collected: str | None = None,
) -> View:
    """Show a material in a notebook, live: it can be turned, lit and edited.

    Parameters
    ----------
    material, measured, name, collected
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
    return View(page(material, measured, name=name, collected=collected))
