"""GLSL, HLSL and Slang: the same functions in three spellings, plain multiply-adds without any extension."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path

from .. import __version__
from ..material.material import Material
from ..system.files import write_text
from .program import Program, name_of, record
from .recorder import Value
from .registry import exporter
from .statements import Language, Statements, number, wrapped

_WORDS = frozenset("in out inout input output half sample line point precise shared buffer this".split())
_GLSL = Language(
    functions={"rsqrt": "inversesqrt", "atan2": "atan"},
    types={"float": "float", "int": "int", "bool": "bool", "vector": "vec3", "packed": "vec4"},
    reserved=_WORDS,
)
_HLSL = dataclasses.replace(_GLSL, functions={}, types={**_GLSL.types, "vector": "float3", "packed": "float4"})


@dataclasses.dataclass(frozen=True)
class Style:
    """What differs between the shader languages besides the names of operations.

    Parameters
    ----------
    language : Language
    table : str
        A table of constants, of a name, a length `n` and its numbers.
    attribute : str
        Stands before functions that can be differentiated.
    struct : str
        Stands behind the name of a structure.
    public : str
        Stands before all that users may call.
    """

    language: Language
    table: str
    attribute: str = ""
    struct: str = ""
    public: str = ""


GLSL = Style(_GLSL, "const float {name}[{n}] = float[{n}]({numbers});")
HLSL = Style(_HLSL, "static const float {name}[{n}] = {{{numbers}}};")
SLANG = dataclasses.replace(HLSL, attribute="[Differentiable]\n", struct=" : IDifferentiable", public="public ")


@exporter(".glsl", about="GLSL: eval, sample and pdf for WebGL 2, OpenGL 3.3 and Vulkan")
def write_glsl(material: Material, path: Path, *, editable: bool = True) -> dict:
    """Write a material as GLSL, see :func:`source`."""
    return _write(material, path, GLSL, editable)


@exporter(".hlsl", about="HLSL: the same for Direct3D and Unity")
def write_hlsl(material: Material, path: Path, *, editable: bool = True) -> dict:
    """Write a material as HLSL, see :func:`source`."""
    return _write(material, path, HLSL, editable)


@exporter(".slang", about="Slang: the same, differentiable, for Slang and Falcor")
def write_slang(material: Material, path: Path, *, editable: bool = True) -> dict:
    """Write a material as Slang, see :func:`source`."""
    return _write(material, path, SLANG, editable)


def _write(material: Material, path: Path, style: Style, editable: bool) -> dict:
    program = record(material, editable=editable)
    text = source(program, name_of(path), style)
    write_text(path, text)
    return {"bytes": len(text.encode()), "multiply_adds": program.multiply_adds}


def source(program: Program, name: str, style: Style = GLSL) -> str:
    """Return the functions of a material in a shader language.

    Parameters
    ----------
    program : Program
    name : str
        All that is defined begins with it.
    style : Style

    Returns
    -------
    str

    Examples
    --------
    >>> text = source(record(Material.analytic("ggx")), "grey")
    >>> "vec3 grey_eval(grey_Material m, vec3 wi, vec3 wo)" in text
    True
    """
    writer = Writer(program, name, style)
    return "\n".join([*writer.head(), "", *writer.definitions()]) + "\n"


class Writer:
    """The parts of a file; arguments as of :func:`source`."""

    def __init__(self, program: Program, name: str, style: Style = GLSL):
        self._program, self._prefix, self._style = program, name, style
        self._types, self._tables = style.language.types, dict[tuple, str]()

    def definitions(self) -> list[str]:
        """Return the lines that define structures, constants and functions."""
        bodies = [*self._prepare(), *(line for name in self._program.functions for line in self._function(name))]
        tables = [line for numbers, name in self._tables.items() for line in self._table(name, numbers)]
        return [*self._structures(), *tables, *bodies]

    def head(self) -> list[str]:
        """Return a comment that says what the file is and how it is used."""
        p, m, vector = self._prefix, self._material_argument, self._types["vector"]
        made = (
            f"{p}_Material m = {p}_material();  // as it was written; edited: {p}_prepare(parameters), or k as uniforms"
        )
        call = f"{p}_%s({'m, ' if m else ''}%s);"
        return [
            f"// {p}: {self._program.equation}; brackets are neural networks. Written by mi_enhance {__version__}.",
            "// Unit vectors away from the surface in its frame, normal (0, 0, 1): wi to the viewer, wo to the light.",
            "//",
            *([f"//   {made}"] if m else []),
            f"//   {vector} f = {call % ('eval', 'wi, wo')}  // reflectance in 1/sr, without the cosine",
            f"//   float density = {call % ('pdf', 'wi, wo')}  // of sample, in 1/sr",
            f"//   {vector} wo = {call % ('sample', 'wi, u')}  // u: uniform in [0, 1)^3; below the horizon f is 0",
        ]

    @property
    def _material_argument(self) -> str:
        return f"{self._prefix}_Material m" if self._program.parameters else ""

    def _table(self, name: str, numbers: Sequence[float]) -> list[str]:
        text = self._style.table.format(name=name, n=len(numbers), numbers=", ".join(map(number, numbers)))
        return [*wrapped(text, ""), ""]

    def _table_name(self, numbers: Sequence[float]) -> str:
        return self._tables.setdefault(tuple(numbers), f"{self._prefix}_table{len(self._tables)}")

    def _structures(self) -> list[str]:
        if not self._program.parameters:
            return []
        p, style = self._prefix, self._style
        fields, values = [], []
        for q in self._program.parameters:
            kind = self._types["vector" if q.size == 3 else "float"]
            fields.append(f"    {style.public}{kind} {q.name};  // {q.low:g} to {q.high:g}")
            numbers = ", ".join(map(number, self._program.defaults[q.name]))
            values.append(f"    p.{q.name} = {f'{kind}({numbers})' if q.size == 3 else numbers};")
        n = (len(self._program.prepared) + 3) // 4
        constants = [number(v) for v in self._program.prepare()]
        constants += ["0.0"] * (4 * n - len(constants))
        packed = self._types["packed"]
        entries = [f"    m.k[{k}] = {packed}({', '.join(constants[4 * k : 4 * k + 4])});" for k in range(n)]
        return [
            f"{style.public}struct {p}_Parameters{style.struct}  // what may be edited; it counts as within its range",
            *("{", *fields, "};", ""),
            f"{style.public}struct {p}_Material{style.struct}  // what the functions need of the parameters",
            *("{", f"    {style.public}{packed} k[{n}];", "};", ""),
            f"{style.public}{p}_Parameters {p}_defaults()",
            *("{", f"    {p}_Parameters p;", *values, "    return p;", "}", ""),
            f"{style.public}{p}_Material {p}_material()",
            *("{", f"    {p}_Material m;", *entries, "    return m;", "}", ""),
        ]

    def _prepare(self) -> list[str]:
        p, prepared = self._prefix, self._program.prepared
        if not self._program.parameters:
            return []
        values = self._program.values_of_parameters()
        lines, texts = self._statements(values, prepared, {})
        texts += ["0.0"] * (-len(texts) % 4)
        for k in range(0, len(texts), 4):
            lines += wrapped(f"m.k[{k // 4}] = {self._types['packed']}({', '.join(texts[k : k + 4])});")
        return [
            f"{self._style.attribute}{self._style.public}{p}_Material {p}_prepare({p}_Parameters p)",
            *("{", f"    {p}_Material m;", *lines, "    return m;", "}", ""),
        ]

    def _function(self, name: str) -> list[str]:
        function = self._program.functions[name]
        given = {v.number: f"m.k[{k // 4}].{'xyzw'[k % 4]}" for k, v in enumerate(self._program.prepared)}
        lines, texts = self._statements(self._program.values(name), function.outputs, given)
        vector = self._types["vector"]
        result = vector if len(texts) == 3 else "float"
        listed = ", ".join([*filter(None, [self._material_argument]), *(f"{vector} {a}" for a in function.inputs)])
        returned = f"{vector}({', '.join(texts)})" if len(texts) == 3 else texts[0]
        return [
            f"{self._style.attribute}{self._style.public}{result} {self._prefix}_{name}({listed})",
            *("{", *lines, *wrapped(f"return {returned};"), "}", ""),
        ]

    def _statements(
        self, values: Sequence[Value], outputs: Sequence[Value], given: dict[int, str]
    ) -> tuple[list[str], list[str]]:
        operands = [a for v in [*values, *outputs] for a in [v, *v.args] if isinstance(a, Value)]
        inputs = {a.number: f"{'' if a.varying else 'p.'}{a.args[0]}" for a in operands if a.op == "input"}
        taken = {"m", "p", "wi", "wo", "u"}
        body = Statements(self._style.language, inputs | given, self._program.labels, self._table_name, taken)
        texts = body.write(values, outputs)
        return body.lines, texts
