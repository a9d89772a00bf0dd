"""Which parameters of a scene a fit to images moves, and in which space.

An unknown is a key of ``mi.traverse(scene)`` with a range: a parameter of an enhanced BSDF, of any BSDF of Mitsuba, a
number, a colour or all texels of a texture.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import drjit as dr
import mitsuba as mi
import numpy as np

from . import parameters
from .material import Material
from .parameters import Parameter

# By how much of its range a sigmoid overshoots both ends: an albedo of exactly 0 or 1 can be reached, and left again.
_OVERSHOOT = 1e-3
# They turn the normal, and with it the horizon: `prb` does not follow edges that move.
HELD = ("n_x", "n_y")
# Joined when the analytic parameters have found their place.
LATE = ("latent", "asymmetry")


@dataclasses.dataclass(frozen=True)
class Unknown:
    """A scene parameter that is sought.

    Where the model asks for it its logarithm moves; what starts at 0 (albedos, F0, shares) is a sigmoid of what moves;
    the rest is moved as it is, inside its range.

    Parameters
    ----------
    key : str
        Of ``mi.traverse(scene)``.
    parameter : Parameter
        Range and logarithm; its size is not used, a texture has as many as it has texels.

    Examples
    --------
    >>> u = Unknown("ball.bsdf.alpha", Parameter("alpha", 1, 1e-3, 1.0, 0.2, log=True))
    >>> u.back(u.to(np.array([0.1])))
    array([0.1])
    """

    key: str
    parameter: Parameter

    @property
    def is_late(self) -> bool:
        """Whether it stays put at first."""
        return self.parameter.name in LATE

    @property
    def _is_sigmoid(self) -> bool:
        return not self.parameter.log and self.parameter.low == 0

    @property
    def bounds(self) -> tuple[float, float]:
        """Range of what moves."""
        low, high = self.to(np.array([self.parameter.low, self.parameter.high]))
        return float(low), float(high)

    def to(self, value: np.ndarray) -> np.ndarray:
        """Physical values to those that move."""
        value = np.clip(value, self.parameter.low, self.parameter.high)
        if self.parameter.log:
            return np.log(value)
        if self._is_sigmoid:
            share = (value / self.parameter.high + _OVERSHOOT) / (1 + 2 * _OVERSHOOT)
            return np.log(share / (1 - share))
        return np.asarray(value, np.float64)

    def back(self, moved: np.ndarray) -> np.ndarray:
        """The inverse of :meth:`to`; what moved out of its bounds is taken as on them."""
        moved = np.clip(moved, *self.bounds)
        if self.parameter.log:
            moved = np.exp(moved)
        elif self._is_sigmoid:
            share = 1 / (1 + np.exp(-moved))
            moved = (share * (1 + 2 * _OVERSHOOT) - _OVERSHOOT) * self.parameter.high
        return np.clip(moved, self.parameter.low, self.parameter.high)

    def slope(self, moved: np.ndarray) -> np.ndarray:
        """Derivatives of the physical values with respect to those that move."""
        if self.parameter.log:
            return np.exp(moved)
        if self._is_sigmoid:
            share = 1 / (1 + np.exp(-moved))
            return share * (1 - share) * (1 + 2 * _OVERSHOOT) * self.parameter.high
        return np.ones_like(moved)


@dataclasses.dataclass(frozen=True)
class Placed:
    """An enhanced BSDF in a scene: its material, and the key of each of its parameters."""

    material: Material
    keys: Mapping[str, str]

    def assignment(self, material: Material) -> dict[str, np.ndarray]:
        """Values by key that make it the given material of the same model; what is textured stays."""
        return {key: material.params[name] for name, key in self.keys.items() if key.endswith(f".{name}")}

    @property
    def is_textured(self) -> bool:
        """Whether a parameter varies over the surface."""
        return len(self.keys) < len(self.material.brdf.parameters) or any(
            not key.endswith(f".{name}") for name, key in self.keys.items()
        )

    def moving(self) -> list[str]:
        """Names of parameters that a fit of all of them moves."""
        return [p.name for p in self.material.brdf.parameters if not p.fixed and p.name not in HELD]

    def read(self, params: mi.SceneParameters) -> Material:
        """The material with the values that the scene has now; of a texture its mean."""
        values = {}
        for p in self.material.brdf.parameters:
            if p.name in self.keys:
                value = get(params, self.keys[p.name])
                value = value.reshape(-1, p.size).mean(0) if self.keys[p.name].endswith((".data", ".value")) else value
                values[p.name] = np.clip(value, p.low, p.high)
        return self.material.edit(**values)


def placed(params: mi.SceneParameters, given: Mapping[str, Material] | None = None) -> dict[str, Placed]:
    """Enhanced BSDFs of a scene, by id.

    Parameters
    ----------
    params : mi.SceneParameters
        Of the scene.
    given : dict of str to Material, optional
        Materials as they were loaded, for BSDFs that came from memory: only these have a library of starts.

    Raises
    ------
    ValueError
        If a material is specialised, or one that is given is of no BSDF in the scene or has another model than that.
    """
    result = {}
    for node in params.hierarchy:
        if type(node).__name__ == "Enhanced":
            if node.m_material.brdf.compact:
                raise ValueError(
                    f'fit_images(): "{node.id()}" is a specialised material, which holds for its own parameters only. '
                    "Use the exact one: mi-enhance specialize FAST.bsdf --undo -o MAT.bsdf"
                )
            keys = {}
            first = next(key for key, (_, _, owner, _) in params.properties.items() if owner is node)
            prefix = first.rpartition(".")[0]
            for p in node.m_material.brdf.parameters:
                for key in (f"{prefix}.{p.name}", f"{prefix}.{p.name}.data", f"{prefix}.{p.name}.value"):
                    if key in params:
                        keys[p.name] = key
            result[node.id() or prefix] = Placed(node.m_material, keys)
    for name, material in (given or {}).items():
        if name not in result:
            raise ValueError(
                f'fit_images(): materials names "{name}", but the enhanced BSDFs of the scene are '
                f"{', '.join(result) or 'none'}. Give the BSDF that id."
            )
        loaded = result[name].material
        if str(material.brdf) != str(loaded.brdf) or len(material.vector()) != len(loaded.vector()):
            raise ValueError(
                f'fit_images(): "{name}" is {loaded.brdf} in the scene, but {material.brdf} in materials. '
                "Load the scene with the same material."
            )
        result[name] = dataclasses.replace(result[name], material=material)
    return result


def enhanced(scene: mi.Scene, names: Sequence[str] | None = None) -> list[Unknown]:
    """Parameters of the enhanced BSDFs of a scene.

    Parameters
    ----------
    scene : mi.Scene
    names : sequence of str, optional
        Names such as ``rho_d``; all but the tilt of the normal if left out.

    Returns
    -------
    list of Unknown

    Raises
    ------
    ValueError
        If the scene has no enhanced BSDF, or none with a parameter of such a name.

    Examples
    --------
    >>> from mi_enhance import scene
    >>> ball = scene.load("sphere_envmap", Material.analytic("ggx").bsdf(), resolution=16, spp=1)
    >>> [u.key for u in enhanced(ball, ["rho_d", "F0"])]
    ['ball.bsdf.rho_d', 'ball.bsdf.F0']
    """
    params = mi.traverse(scene)
    found = placed(params)
    if not found:
        raise ValueError(
            'fit_images(): the scene has no BSDF of type "enhanced". Give the object that is to be fitted '
            '<bsdf type="enhanced" id="material"><string name="filename" value="$material"/></bsdf>, or say which '
            "parameters are unknown."
        )
    known = {p.name for one in found.values() for p in one.material.brdf.parameters if not p.fixed}
    wrong = sorted(set(names or ()) - known)
    if wrong:
        raise ValueError(f'fit_images(): no material has a parameter "{wrong[0]}". Choose from: {", ".join(known)}.')
    return [
        Unknown(one.keys[p.name], p)
        for one in found.values()
        for p in one.material.brdf.parameters
        if p.name in one.keys and not p.fixed and (p.name in names if names else p.name not in HELD)
    ]


def of_plugin(prefix: str, ranges: Mapping[str, tuple[float, float]], log: Sequence[str] = ()) -> list[Unknown]:
    """Parameters of any BSDF, by the name of each below its prefix: for Mitsuba's own plugins.

    Parameters
    ----------
    prefix : str
        What the keys of ``mi.traverse(scene)`` begin with.
    ranges : dict of str to (low, high)
    log : sequence of str
        Names of those whose logarithm is to move, such as a roughness.

    Examples
    --------
    >>> of_plugin("ball.bsdf", {"roughness.value": (0.03, 1)}, log=["roughness.value"])[0].bounds
    (-3.506..., 0.0)
    """
    return [
        Unknown(f"{prefix}.{name}", Parameter(name, 1, low, high, low, log=name in log))
        for name, (low, high) in ranges.items()
    ]


def check(scene: mi.Scene, unknowns: Sequence[Unknown]) -> None:
    """Raise ValueError for an unknown that is no differentiable parameter of the scene."""
    params = mi.traverse(scene)
    for u in unknowns:
        if u.key not in params:
            near = [k for k in params.keys() if k.split(".")[-1] == u.key.split(".")[-1]] or list(params.keys())
            raise ValueError(f'fit_images(): the scene has no parameter "{u.key}". There are: {", ".join(near[:12])}.')
        value = get(params, u.key)
        if not np.isfinite(value).all():
            raise ValueError(f'fit_images(): "{u.key}" holds NaN or infinity. Give it a start inside its range.')


def get(params: mi.SceneParameters, key: str) -> np.ndarray:
    """A scene parameter as a flat float64 vector."""
    return np.array(params[key], np.float64).ravel()


def put(params: mi.SceneParameters, key: str, value: np.ndarray) -> None:
    """Replace a scene parameter by a flat vector; ``params.update()`` is the caller's."""
    old, flat = params[key], np.ascontiguousarray(np.ravel(value), np.float32)
    if isinstance(old, mi.TensorXf):
        params[key] = mi.TensorXf(_own(flat), old.shape)
    elif isinstance(old, (mi.Color3f, mi.Vector3f)):
        params[key] = type(old)(*(_own(np.full(1, v)) for v in np.broadcast_to(flat, 3)))
    else:
        params[key] = _own(flat)


def _own(values: np.ndarray) -> mi.Float:
    """Evaluated, in memory of its own: literals and NumPy's memory, aligned by chance, make `dr.freeze` record anew."""
    result = mi.Float(values.astype(np.float32)) * dr.opaque(mi.Float, 1)
    dr.eval(result)
    return result


def linear_colours(material: Material) -> list[Parameter]:
    """Colours in which the BRDF is linear: each the only colour of its terms, and read by no network."""
    from .features import COLOURLESS

    brdf = material.brdf
    if brdf.networks and brdf.inputs not in COLOURLESS:
        return []
    colours = parameters.colours(brdf.model.parameters)
    factors = [node for node in brdf.model.graph.walk() if not node.args and set(node.inputs) & colours]
    alone = {node.inputs[0] for node in factors if len(node.inputs) == 1}
    shared = {name for node in factors if len(node.inputs) > 1 for name in node.inputs}
    return [p for p in brdf.model.parameters if p.name in alone - shared]
