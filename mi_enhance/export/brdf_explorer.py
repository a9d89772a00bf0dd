"""Disney's BRDF Explorer: a ``.brdf`` file with a slider for every parameter of the model."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np

from .. import __version__
from ..analytic.parameters import Parameter
from ..material.material import Material
from ..system.files import write_text
from .program import Program, name_of, record
from .registry import exporter
from .shaders import Writer
from .statements import number


@exporter(".brdf", about="BRDF Explorer of Disney: f_r as GLSL, with sliders")
def write_brdf(material: Material, path: Path) -> dict:
    """Write a material as a ``.brdf`` file, see :func:`source`."""
    program = record(material)
    text = source(program, name_of(path))
    write_text(path, text)
    return {"bytes": len(text.encode()), "multiply_adds": program.multiply_adds}


def source(program: Program, name: str) -> str:
    """Return the text of a ``.brdf`` file.

    The viewer's colours end at 1: one that may be larger is split into a colour and its largest channel.

    Examples
    --------
    >>> text = source(record(Material.analytic("ggx")), "grey")
    >>> [line for line in text.splitlines() if line.startswith(("color", "float F0"))]
    ['color rho_d 0.5 0.5 0.5', 'color rho_s 1.0 1.0 1.0', 'float F0 0.0 1.0 0.04']
    """
    evaluated = dataclasses.replace(program, functions={"eval": program.functions["eval"]})
    lines, values = [], []
    for q in program.parameters:
        declared, value = _slider(q, program.defaults[q.name])
        lines += declared
        values.append(f"    p.{q.name} = {value};")
    body = Writer(evaluated, name).definitions()
    return "\n".join(
        [
            "analytic",
            f"# {name}: {program.equation}; brackets are neural networks. Written by mi_enhance {__version__}.",
            "",
            *("::begin parameters", *lines, "::end parameters", ""),
            "::begin shader",
            *body,
            "vec3 BRDF(vec3 L, vec3 V, vec3 N, vec3 X, vec3 Y)",
            "{",
            f"    {name}_Parameters p;",
            *values,
            "    vec3 wi = vec3(dot(V, X), dot(V, Y), dot(V, N));",
            "    vec3 wo = vec3(dot(L, X), dot(L, Y), dot(L, N));",
            f"    return {name}_eval({name}_prepare(p), wi, wo);",
            "}",
            *("::end shader", ""),
        ]
    )


def _slider(q: Parameter, value: np.ndarray) -> tuple[list[str], str]:
    """Return the lines that declare a parameter, and what its value is in the shader."""
    if not q.is_colour:
        return [f"float {q.name} {number(q.low)} {number(q.high)} {number(value[0])}"], q.name
    largest = float(value.max())
    scale = largest if q.high > 1 and largest > 0 else 1.0
    shown = value / scale if largest > 0 or q.high <= 1 else np.ones(3)  # white times 0, else no scale would help
    lines = [f"color {q.name} {' '.join(map(number, shown))}"]
    if q.high <= 1:
        return lines, q.name
    return [*lines, f"float {q.name}_scale 0.0 {number(q.high)} {number(largest)}"], f"{q.name}_scale * {q.name}"
