"""A material as straight-line functions: what is worked out once for its parameters, and eval, pdf and sample."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..analytic.graph import Node
from ..analytic.parameters import Parameter
from ..material.material import Material
from ..neural.simplify import simplify
from ..sampling import energy_bound, importance, lobe_mixture
from ..system.variants import require_variant
from .identities import NUMBERS
from .recorder import Recorder, Table, Value, constant, in_order
from .stand_ins import FUNCTIONS, recording
from .vectors import Colour, Point2, Vector


@dataclasses.dataclass(frozen=True)
class Function:
    """One straight-line function.

    Parameters
    ----------
    inputs : dict of str to tuple of Value
        Its vectors by name, component by component.
    outputs : tuple of Value
        The components of its result.
    """

    inputs: Mapping[str, tuple[Value, ...]]
    outputs: tuple[Value, ...]


@dataclasses.dataclass(frozen=True)
class Program:
    """All that is written of a material, in no language yet.

    Parameters
    ----------
    equation : str
    parameters : tuple of Parameter
        Those that may be edited; all others are constants.
    inputs : dict of str to tuple of Value
        The parameters as values, component by component.
    defaults : dict of str to array
        Their values.
    prepared : tuple of Value
        What the functions need of the parameters, in the order in which it is handed to them.
    functions : dict of str to Function
        ``eval`` (f_r, three numbers), ``pdf``, ``sample``.
    labels : dict of Value to str
        Names of values that the equation names.
    """

    equation: str
    parameters: tuple[Parameter, ...]
    inputs: Mapping[str, tuple[Value, ...]]
    defaults: Mapping[str, np.ndarray]
    prepared: tuple[Value, ...]
    functions: Mapping[str, Function]
    labels: Mapping[Value, str]

    @property
    def multiply_adds(self) -> int:
        """Multiply-adds of the networks in one evaluation of f_r, for parameters that are prepared."""
        return sum(v.op == "fma" for v in self.values("eval"))

    def values(self, name: str) -> list[Value]:
        """Return the values that a function computes, each after its operands; what is prepared is given."""
        given = {v.number for v in self.prepared}
        order = in_order(self.functions[name].outputs, lambda v: v.number in given)
        return [v for v in order if v.number not in given and v.op not in ("constant", "input")]

    def prepare(self, edits: Mapping[str, Sequence[float]] | None = None) -> np.ndarray:
        """Return the numbers of :attr:`prepared`, float32, for the default parameters but for `edits`.

        Examples
        --------
        >>> program = record(Material.analytic("ggx"))
        >>> int((program.prepare() != program.prepare({"rho_d": (0.2, 0.1, 0)})).sum())
        5
        """
        given: dict[str, Sequence[float] | np.ndarray] = {**self.defaults, **(edits or {})}
        numbers: dict[int, Any] = {}
        for v in in_order(self.prepared):
            if v.op == "input":
                name, _, axis = v.args[0].partition(".")
                numbers[v.number] = np.float32(given[name]["xyz".index(axis) if axis else 0])
            elif v.op == "constant":
                numbers[v.number] = v.args[0]
            elif v.op == "gather":
                numbers[v.number] = np.float32(v.args[0][int(numbers[v.args[1].number])])
            else:
                numbers[v.number] = NUMBERS[v.op](*(numbers[a.number] for a in v.args))
        return np.array([numbers[v.number] for v in self.prepared], np.float32)

    def values_of_parameters(self) -> list[Value]:
        """Return the values that are computed once, each after its operands."""
        return [v for v in in_order(self.prepared) if v.op not in ("constant", "input")]


def record(material: Material, *, editable: bool = True) -> Program:
    """Record the functions of a material.

    Parameters
    ----------
    material : Material
    editable : bool
        Keep the parameters of the analytic model open. Otherwise all are constants, and what is 0 is left out.

    Returns
    -------
    Program

    Examples
    --------
    >>> program = record(Material.analytic("ggx"))
    >>> print(program.equation, [p.name for p in program.parameters][:4], len(program.functions["eval"].outputs))
    M + S * D * F * G * 1/E ['n_x', 'n_y', 't_theta', 'rho_d'] 3
    """
    require_variant("export", rgb=True, jit=True)
    material = material.free  # of one material, a read-out is cheaper than a basis
    bound = _energy_table(material)
    mixture = material.sampled_by
    open_parameters = tuple(p for p in material.brdf.model.parameters if editable)
    names = {p.name for p in open_parameters}
    closed = {name: v for name, v in material.params.items() if name not in names}
    brdf, left_out = simplify(material.brdf, closed)
    with recording() as recorder:
        inputs = {p.name: _inputs(p, recorder) for p in open_parameters}
        params = {p.name: _parameter(p, material, inputs.get(p.name)) for p in brdf.parameters}
        params = {name: v for name, v in params.items() if name not in left_out}
        for name, v in params.items():
            recorder.label(v, name)
        wi, wo, u = (_vector(name, recorder) for name in ("wi", "wo", "u"))
        model = brdf.model
        albedos: Any = Table(np.ravel(mixture.albedos))
        shares = lobe_mixture.shares_at(wi.z, params, albedos, model)
        if material.mixture:
            model = lobe_mixture.scaled(model, list(enumerate(mixture.scales)))
        graph, values, above = brdf.prepare(wi, wo, params)
        for name, v in values.items():
            if name not in params:
                recorder.label(v, name)
        f = Colour(_labelled(graph, recorder)(values))
        if bound is not None:
            f = energy_bound.bounded(f, bound, wi, wo, params)
        select = FUNCTIONS["select"]
        density: Any = importance.pdf(wi, wo, params, shares, model)
        point: Any = Point2(u.y, u.z)
        drawn: Any = importance.sample(wi, params, shares, u.x, point, model)
        functions = {
            "eval": Function({"wi": tuple(wi), "wo": tuple(wo)}, tuple(select(above, f, 0))),
            "pdf": Function({"wi": tuple(wi), "wo": tuple(wo)}, (density,)),
            "sample": Function({"wi": tuple(wi), "u": tuple(u)}, tuple(drawn)),
        }
    outputs = [v for function in functions.values() for v in function.outputs]
    defaults = {p.name: material.params[p.name] for p in open_parameters}
    return Program(
        str(material.brdf), open_parameters, inputs, defaults, _prepared(outputs), functions, recorder.labels
    )


def _energy_table(material: Material) -> Any:
    if not material.bound_energy:
        return None
    table = energy_bound.table(material.brdf, material.as_drjit(), material.lobe_albedo)
    return Table(np.array(table))


def _vector(name: str, recorder: Recorder) -> Any:
    return Vector(*(recorder.input(f"{name}.{axis}", varying=True) for axis in "xyz"))


def _inputs(p: Parameter, recorder: Recorder) -> tuple[Value, ...]:
    axes = [f".{axis}" for axis in "xyz"[: p.size]] if p.size > 1 else [""]
    return tuple(recorder.input(f"{p.name}{axis}", varying=False) for axis in axes)


def _parameter(p: Parameter, material: Material, inputs: tuple[Value, ...] | None) -> Any:
    """Return a parameter: inputs held within their range, or constants."""
    if inputs:
        parts = [FUNCTIONS["clip"](v, p.low, p.high) for v in inputs]
    else:
        parts = [constant(v) for v in material.params[p.name]]
    return Colour(*parts) if p.is_colour else parts[0] if p.kind == "scalar" else parts


def _labelled(graph: Node, recorder: Recorder) -> Node:
    """Return a graph that gives the value of each term its name."""
    if graph.args:
        return dataclasses.replace(graph, args=tuple(_labelled(a, recorder) for a in graph.args))
    fn, name = graph.fn, re.sub(r"\W", "", graph.name.replace("1/", "inv_"))

    def labelled(*args, **keywords):
        try:
            result = fn(*args, **keywords)
        except NotImplementedError:
            raise
        except (RuntimeError, TypeError) as error:
            raise NotImplementedError(
                f'export: the term in slot "{graph.name}" cannot be translated ({error}). A term must find drjit and '
                "mitsuba under names of its module, and choose with dr.select()."
            ) from error
        recorder.label(result, name)
        return result

    return dataclasses.replace(graph, fn=labelled)


def _prepared(outputs: Sequence[Value]) -> tuple[Value, ...]:
    """Return what depends on the parameters alone and is read by what depends on directions, in order of making."""
    read = [v for v in in_order(outputs, lambda v: not v.varying) if not v.varying and v.op != "constant"]
    return tuple(sorted(read, key=lambda v: v.number))


def name_of(path: str | Path) -> str:
    """Return what the functions in a file are called after: its stem, as a name in a programming language.

    Examples
    --------
    >>> name_of("out/blue-metal 2.glsl"), name_of("3m.glsl")
    ('blue_metal_2', 'm_3m')
    """
    name = re.sub(r"[^A-Za-z0-9]+", "_", Path(path).stem).strip("_") or "material"
    return f"m_{name}" if name[0].isdigit() else name
