"""Which parameters of a scene a fit to images moves, and in which space.

An unknown is a key of ``mi.traverse(scene)`` with a range: a parameter of an enhanced BSDF, of any BSDF of Mitsuba, a
number, a colour or all texels of a texture.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import mitsuba as mi
import numpy as np

from ..analytic.parameters import Parameter
from .scene_materials import HELD, find, get

# By how much of its range a sigmoid overshoots both ends: an albedo of exactly 0 or 1 can be reached, and left again.
_OVERSHOOT = 1e-3
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
    >>> u.to_physical(u.to_free(np.array([0.1])))
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
        low, high = self.to_free(np.array([self.parameter.low, self.parameter.high]))
        return float(low), float(high)

    def to_free(self, value: np.ndarray) -> np.ndarray:
        """Physical values to those that move."""
        value = np.clip(value, self.parameter.low, self.parameter.high)
        if self.parameter.log:
            return np.log(value)
        if self._is_sigmoid:
            share = (value / self.parameter.high + _OVERSHOOT) / (1 + 2 * _OVERSHOOT)
            return np.log(share / (1 - share))
        return np.asarray(value, np.float64)

    def to_physical(self, moved: np.ndarray) -> np.ndarray:
        """The inverse of :meth:`to_free`; what moved out of its bounds is taken as on them."""
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
            "own. Give a number, a colour or a bitmap."
        )
    return list(sought.values())


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
