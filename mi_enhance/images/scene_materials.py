"""Enhanced BSDFs in a scene, and values into and out of its parameters."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Mapping
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from ..material.material import Material

# They turn the normal, and with it the horizon: `prb` does not follow edges that move.
HELD = ("n_x", "n_y")


@dataclasses.dataclass(frozen=True)
class SceneMaterial:
    """An enhanced BSDF in a scene: its material, and the key of each of its parameters."""

    material: Material
    keys: Mapping[str, str]

    def assignment(self, material: Material) -> dict[str, np.ndarray]:
        """Values by key that make it the given material of the same model; what is textured stays."""
        return {key: material.params[name] for name, key in self.keys.items() if key.endswith(f".{name}")}

    @property
    def is_textured(self) -> bool:
        """True if a parameter varies over the surface."""
        return len(self.keys) < len(self.material.brdf.parameters) or any(
            not key.endswith(f".{name}") for name, key in self.keys.items()
        )

    def moving(self) -> list[str]:
        """Return the names of the parameters that a fit may change by default."""
        return [p.name for p in self.material.brdf.parameters if not p.fixed and p.name not in HELD]

    def read(self, params: mi.SceneParameters) -> Material:
        """The material with the values that the scene has now; of a texture its mean."""
        values = {}
        for p in self.material.brdf.parameters:
            if p.name in self.keys:
                stored, value = params[self.keys[p.name]], get(params, self.keys[p.name])
                channels = stored.shape[-1] if dr.is_tensor_v(stored) else value.size
                value = value.reshape(-1, channels).mean(0)
                if value.size != p.size:  # a grey for a colour, a colour for a number
                    value = np.full(p.size, value.mean())
                values[p.name] = np.clip(value, p.low, p.high)
        # not an edit, which holds what factors in RGB reflect
        return dataclasses.replace(self.material, params={**self.material.params, **values})


def find(params: mi.SceneParameters, given: Mapping[str, Material] | None = None) -> dict[str, SceneMaterial]:
    """Enhanced BSDFs of a scene, by id; by the beginning of its keys where it has none, or shares it with another.

    Parameters
    ----------
    params : mi.SceneParameters
        Of the scene.
    given : dict of str to Material, optional
        Materials as they were loaded, for BSDFs that came from memory: only these have a library of starts.

    Raises
    ------
    ValueError
        If a material is specialized, or one that is given is of no BSDF in the scene or has another model than that.
    """
    result = {}
    nodes: list[Any] = [node for node in params.hierarchy if isinstance(node, mi.BSDF) and hasattr(node, "material")]
    ids = Counter(node.id() for node in nodes)  # in a dictionary it is the name of the entry, "bsdf" for all
    for node in nodes:
        if node.material.brdf.distilled:
            raise ValueError(
                f'fit_images(): "{node.id()}" is a specialized material, which holds for its own parameters only. '
                "Use the exact one: mi-enhance specialize FAST.bsdf --undo -o MAT.bsdf"
            )
        first = next(key for key, (_, _, owner, _) in params.properties.items() if owner is node)
        prefix = first.rpartition(".")[0]
        keys: dict[str, str] = {}
        for p in node.material.brdf.parameters:
            for key in (f"{prefix}.{p.name}", f"{prefix}.{p.name}.data", f"{prefix}.{p.name}.value"):
                # a bitmap of 8 bits is kept as integers, which have no gradients
                if key in params and dr.is_float_v(params[key]):
                    keys[p.name] = key
        # one texture under two names, which Mitsuba makes of two equal ones, is one unknown
        of_texture = {id(t): keys[name] for name, t in node.textures.items() if name in keys}
        keys.update({name: of_texture[id(t)] for name, t in node.textures.items() if id(t) in of_texture})
        result[node.id() if node.id() and ids[node.id()] == 1 else prefix] = SceneMaterial(node.material, keys)
    for name, material in (given or {}).items():
        if name not in result:
            raise ValueError(
                f'fit_images(): materials names "{name}", but the enhanced BSDFs of the scene are '
                f"{', '.join(result) or 'none'}. Give the BSDF that id."
            )
        loaded = result[name].material
        if str(material.brdf) != str(loaded.brdf) or len(material.as_vector()) != len(loaded.as_vector()):
            raise ValueError(
                f'fit_images(): "{name}" is {loaded.brdf} in the scene, but {material.brdf} in materials. '
                "Load the scene with the same material."
            )
        result[name] = dataclasses.replace(result[name], material=material)
    return result


def get(params: mi.SceneParameters, key: str) -> np.ndarray:
    """A scene parameter as a flat float64 vector."""
    return np.array(params[key], np.float64).ravel()


def put(params: mi.SceneParameters, key: str, value: np.ndarray) -> None:
    """Replace a scene parameter by a flat vector; ``params.update()`` is the caller's."""
    old, flat = params[key], np.ascontiguousarray(np.ravel(value), np.float32)
    if dr.is_tensor_v(old):  # a bitmap may be of half precision
        params[key] = type(old)(dr.array_t(old)(_own(flat)), old.shape)
    elif isinstance(old, (mi.Color3f, mi.Vector3f)):
        params[key] = type(old)(*(_own(np.full(1, v)) for v in np.broadcast_to(flat, 3)))
    else:
        params[key] = _own(flat)


def _own(values: np.ndarray) -> mi.Float:
    """Evaluated, in memory of its own: literals and NumPy's memory, aligned by chance, make `dr.freeze` record anew."""
    result = mi.Float(values.astype(np.float32)) * dr.opaque(mi.Float, 1)
    dr.eval(result)
    return result
