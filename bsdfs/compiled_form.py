"""The BRDF as the plugin evaluates it: without what is 0, constants folded into the modules."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Mapping
from typing import NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

from mi_enhance.neural import baked
from mi_enhance.neural.enhanced_brdf import EnhancedBRDF
from mi_enhance.neural.simplify import simplify


class Form(NamedTuple):
    """A BRDF from which something may be left out, and how it is evaluated."""

    brdf: EnhancedBRDF
    evaluators: dict
    left_out: frozenset[str]  # names of parameters, all 0, that it is evaluated without


@dataclasses.dataclass(eq=False)  # a dataclass: `dr.freeze` finds the arrays of its fields
class CompiledForm:
    """The form of a BRDF that fits the present values of its parameters; forms made before are kept.

    Parameters
    ----------
    brdf : EnhancedBRDF
    kind : type
        Of the evaluators, such as ``baked.Baked``.
    """

    brdf: EnhancedBRDF
    kind: type
    known: dict[str, np.ndarray] = dataclasses.field(default_factory=dict)  # values, of the last update
    folded: Mapping | None = None  # all that is folded, if none of it varies over the surface
    begun: Mapping | None = None  # else the part that does not vary
    apart: mi.Float | None = None  # all that is folded, once more, where gradients are to arrive at it

    def __post_init__(self):
        self._forms: dict[frozenset[str], Form] = {}
        self.form = self._full = self._form(self.brdf, frozenset())
        self._stored = self.brdf.evaluators(baked.Stored)

    def _form(self, brdf: EnhancedBRDF, left_out: frozenset[str]) -> Form:
        """Return the cached form for this set of omitted parameters."""
        if left_out not in self._forms:
            self._forms[left_out] = Form(brdf, brdf.evaluators(self.kind), left_out)
        return self._forms[left_out]

    def choose(self, values: Mapping, keys: Collection[str] = ()) -> None:
        """Choose the form that leaves out what is 0.

        Parameters
        ----------
        values : dict
            Parameters that are the same everywhere.
        keys : collection of str, optional
            Names of those that have changed; all may have if there are none.
        """
        self._know(values, keys)
        self.form = self._form(*simplify(self.brdf, self.known))

    def _know(self, values: Mapping, keys: Collection[str]) -> None:
        """Keep the values of the parameters that are the same everywhere and not being optimized."""
        if dr.flag(dr.JitFlag.FreezingScope):
            self.known = {}  # while a function is recorded no value can be looked at
            return
        self.known = {
            name: self.known[name] if keys and name in self.known and name not in keys else _numbers(value)
            for name, value in values.items()
            if not dr.grad_enabled(value)
        }

    def fold(self, constants: Mapping, textured: Collection[str]) -> None:
        """Fold the parameters that are constant over the surface; `textured` are the names of the others."""
        self.folded = self.begun = self.apart = None
        if not set(textured) & set(self.brdf.read_by_modules):
            self.folded = self.brdf.fold(constants, self._stored)
            dr.make_opaque(self.folded)
        else:
            known = {name: v for name, v in constants.items() if name not in textured}
            self.begun = self.brdf.begin_fold(self._parts(known), self._stored)
            dr.make_opaque(self.begun)

    def set_apart(self) -> mi.Float | None:
        """Return all that is folded as one array with gradients, see :meth:`Enhanced.set_folded_apart`."""
        if self.folded is None:
            return None
        flat = dr.concat([v for values in self.folded.values() for v in values] or [mi.Float(0)])
        dr.make_opaque(flat)
        dr.enable_grad(flat)
        self.apart = flat
        return flat

    def hand_on(self, constants: Mapping) -> None:
        """Hand the gradients of :meth:`set_apart` on to the parameters `constants`, attached, and forget about it."""
        if self.apart is None:
            return
        folded = self.brdf.fold(constants, self._stored)
        flat = [v for values in folded.values() for v in values]
        at = [k for k, v in enumerate(flat) if dr.grad_enabled(v)]
        if at:
            narrow = [flat[k] for k in at]
            dr.set_grad(narrow, [dr.gather(mi.Float, dr.grad(self.apart), k) for k in at])
            dr.enqueue(dr.ADMode.Backward, narrow)
            dr.traverse(dr.ADMode.Backward)
        self.apart = None

    def _parted(self) -> Mapping:
        """Return what is folded, out of the array that gradients arrive at."""
        begin, result = 0, {}
        for slot, values in (self.folded or {}).items():
            result[slot] = [dr.gather(mi.Float, self.apart, begin + k) for k in range(len(values))]
            begin += len(values)
        return result

    def at(self, params: Mapping, constant: Collection[str], textured: Collection[str]) -> tuple[Form, Mapping]:
        """Return the form to evaluate and what is folded, for the parameters at a hit point."""
        form = self.form
        if dr.grad_enabled([params[name] for name in form.left_out]):
            form = self._full  # optimized since the last update: nothing may be missing
        folded = self.folded
        if dr.grad_enabled([params[name] for name in form.brdf.read_by_modules if name in constant]):
            folded = self._parted() if self.apart is not None else form.brdf.fold(params, form.evaluators)
        elif folded is None:  # what is the same everywhere has been folded before
            varying = self._parts({name: params[name] for name in textured})
            folded = form.brdf.fold(varying, form.evaluators, self.begun)
        return form, folded

    def _parts(self, known: dict) -> dict:
        """Return all parameters, unknown but for those given, as :meth:`EnhancedBRDF.begin_fold` takes them."""
        unknown: dict = {p.name: None if p.kind == "scalar" else [None] * p.size for p in self.brdf.parameters}
        return unknown | known


def _numbers(value) -> np.ndarray:
    """Return a value as NumPy has it.

    As data first: Dr.Jit would write a literal into the code that copies it, and keep that code for every other value.
    """
    value = dr.detach(value)
    dr.make_opaque(value)
    return value.numpy()
