"""The parameters of a scene that a fit to images moves.

An unknown is a key of ``mi.traverse(scene)`` with a range: a parameter of an enhanced BSDF, of any BSDF of Mitsuba, a
number, a colour or all texels of a texture.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import mitsuba as mi
import numpy as np

from ..analytic.parameter_space import BoundedSpace
from ..analytic.parameters import Parameter
from .scene_materials import HELD, find, get


@dataclasses.dataclass(frozen=True)
class Unknown:
    """A scene parameter that is sought; it moves in a :class:`mi_enhance.analytic.parameter_space.BoundedSpace`.

    Parameters
    ----------
    key : str
        Of ``mi.traverse(scene)``.
    parameter : Parameter
        Range and logarithm; its size is not used, a texture has as many as it has texels.

    Examples
    --------
    >>> u = Unknown("ball.bsdf.alpha", Parameter("alpha", 1, 1e-3, 1.0, 0.2, log=True))
    >>> u.space.to_physical(u.space.to_free(np.array([0.1])))
    array([0.1])
    """

    key: str
    parameter: Parameter

    @property
    def is_late(self) -> bool:
        """True if it joins when the analytic parameters have found their place."""
        return self.parameter.is_neural

    @property
    def space(self) -> BoundedSpace:
        """The space in which it moves."""
        return BoundedSpace(self.parameter)


def enhanced(scene: mi.Scene, names: Sequence[str] | None = None) -> list[Unknown]:
    """Return the parameters of the enhanced BSDFs of a scene.

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
    >>> from mi_enhance import Material
    >>> from mi_enhance.evaluation import scenes
    >>> ball = scenes.load("sphere_envmap", Material.analytic("ggx").bsdf(), resolution=16, spp=1)
    >>> [u.key for u in enhanced(ball, ["rho_d", "F0"])]
    ['ball.bsdf.rho_d', 'ball.bsdf.F0']
    """
    params = mi.traverse(scene)
    found = find(params)
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
    sought = {
        one.keys[p.name]: Unknown(one.keys[p.name], p)  # by key: two parameters may have one texture
        for one in found.values()
        for p in one.material.brdf.parameters
        if p.name in one.keys and not p.fixed and (p.name in names if names else p.name not in HELD)
    }
    if not sought:
        raise ValueError(
            f"fit_images(): {', '.join(names or known)}: none can be moved, each is a texture without numbers of its "
            'own, or a bitmap of 8 bits. Give a number, a colour, or a bitmap with <string name="format" '
            'value="variant"/>.'
        )
    return list(sought.values())


def of_plugin(prefix: str, ranges: Mapping[str, tuple[float, float]], log: Sequence[str] = ()) -> list[Unknown]:
    """Return parameters of any BSDF, by the name of each below its prefix: for Mitsuba's own plugins.

    Parameters
    ----------
    prefix : str
        The beginning of the keys of ``mi.traverse(scene)``.
    ranges : dict of str to (low, high)
    log : sequence of str
        Names of those whose logarithm is to move, such as a roughness.

    Examples
    --------
    >>> of_plugin("ball.bsdf", {"roughness.value": (0.03, 1)}, log=["roughness.value"])[0].space.bounds
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
