"""What a scene says of the plugin's material as a whole: the file or the arrays it comes from, how it is evaluated."""

# Where types are ignored, the name is missing in Mitsuba's stubs, or of another type there.

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import drjit as dr
import mitsuba as mi

from mi_enhance.analytic import parameters
from mi_enhance.material.material import Material
from mi_enhance.neural import baked, cooperative


def material_of(props: Any) -> Material:
    """Return the material of a file, or of the arrays of ``Material.to_dict()``."""
    return _reshaped(_given(props), props)


def _reshaped(material: Material, props: Any) -> Material:
    """Return the material with the roughnesses and F0 that a scene gives, as :meth:`Material.edit` sets them."""
    if not material.factors_in_rgb:
        return material
    given = {}
    for p in material.brdf.model.parameters:
        if not p.is_colour and p.name not in parameters.FRAME and p.name in props:
            value = props[p.name]
            if isinstance(value, (int, float)) and p.low <= value <= p.high:  # what is wrong is told where it is read
                given[p.name] = value
    return material.edit(**given)


def _given(props: Any) -> Material:
    if "filename" in props:
        if "weights" in props:
            raise ValueError('bsdf "enhanced": give filename or weights, not both.')
        return Material.load(str(mi.file_resolver().resolve(props["filename"])))  # type: ignore[operator]
    if "description" not in props:
        raise ValueError('bsdf "enhanced": the parameter "filename" is missing. Name a file made by mi-enhance fit.')
    return Material.from_arrays(props["description"], props["params"], props["weights"])


def evaluators_of(props: Any) -> type:
    """Return the class that evaluates the networks: asked for, or the faster one of the backend."""
    kinds = {"baked": baked.Baked, "cooperative": cooperative.Cooperative}
    default = "cooperative" if dr.backend_v(mi.Float) == dr.JitBackend.CUDA else "baked"
    return kinds[choice(props, "evaluators", default, kinds)]


def choice(props: Any, key: str, default: str, choices: Collection[str]) -> str:
    """Return the property `key`, one of `choices`."""
    name = props.get(key, default)
    if name not in choices:
        raise ValueError(f'bsdf "enhanced": {key} "{name}" is unknown. Choose one of: {", ".join(choices)}.')
    return name
