"""The parameter vector of a material: names, order, ranges, starting values (paper, sections 3 and 4.3)."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any, Literal

import mitsuba as mi
import numpy as np

from ..system.messages import shortened

Kind = Literal["scalar", "colour", "latent"]
# From the least roughness of Mitsuba's own microfacet distribution to the widest lobe that makes sense.
ROUGHNESS = (1e-4, 1.0)
# Largest logarithm, of either sign, of what a module stands for: a factor from 2e-9 to 5e8.
MAX_LOG = 20.0


@dataclasses.dataclass(frozen=True)
class Parameter:
    """One parameter of a model.

    Parameters
    ----------
    name : str
        Key in files, scenes and dictionaries.
    size : int
        How many numbers it has.
    low, high : float
        Allowed range, inclusive; fits stay inside.
    initial : float
        Starting value.
    log : bool
        Optimize the logarithm. Roughness needs it: dD/d(alpha) is -9e8 at alpha = 0.001.
    fixed : bool
        Fits and training leave it at its initial value.
    kind : {"scalar", "colour", "latent"}
        One number, a linear RGB colour of size 3, or the neural parameters of a material, of any size.
    """

    name: str
    size: int
    low: float
    high: float
    initial: float
    log: bool = False
    fixed: bool = False
    kind: Kind = "scalar"

    @property
    def is_colour(self) -> bool:
        """True for a linear RGB colour; three latent numbers are none."""
        return self.kind == "colour"

    @property
    def is_neural(self) -> bool:
        """True for ``latent``, ``read_out``, ``code`` and ``asymmetry``, which only networks read."""
        return self.kind == "latent" or self.name == ASYMMETRY.name


# 12 analytic parameters of GGX, in the paper's order (section 7). Ranges: OpenSVBRDF statistics as published, but
# for the roughness; n tilts by 45 degrees at most (0.5**2 * 2 < 1).
N_X = Parameter("n_x", 1, -0.5, 0.5, 0.0)
N_Y = Parameter("n_y", 1, -0.5, 0.5, 0.0)
T_THETA = Parameter("t_theta", 1, -math.pi, math.pi, 0.0)
FRAME = ("n_x", "n_y", "t_theta")  # those that turn the material's frame, by name
RHO_D = Parameter("rho_d", 3, 0.0, 1.0, 0.5, kind="colour")
RHO_S = Parameter("rho_s", 3, 0.0, 10.0, 1.0, kind="colour")
ALPHA_X = Parameter("alpha_x", 1, *ROUGHNESS, 0.2, log=True)
ALPHA_Y = Parameter("alpha_y", 1, *ROUGHNESS, 0.2, log=True)
F0 = Parameter("F0", 1, 0.0, 1.0, 0.04)
# The second lobe of `ggx2`: absent at first, twice as wide.
RHO_S2 = Parameter("rho_s2", 3, 0.0, 10.0, 0.0, kind="colour")
ALPHA_X2 = Parameter("alpha_x2", 1, *ROUGHNESS, 0.4, log=True)
ALPHA_Y2 = Parameter("alpha_y2", 1, *ROUGHNESS, 0.4, log=True)

# Parameters of the ABC model. Ranges: the published fits of the 100 MERL materials (A 0.078 to 5,710, B 11 to 8.1e6,
# C 0.024 to 2.7, index of refraction 1.04 to 100), with room on either side.
ABC_A = Parameter("A", 3, 1e-3, 1e5, 1.0, log=True, kind="colour")
ABC_B = Parameter("B", 1, 1.0, 1e8, 100.0, log=True)
ABC_C = Parameter("C", 1, 0.01, 10.0, 1.0, log=True)
IOR = Parameter("ior", 1, 1.0, 100.0, 1.5, log=True)

# Phong exponents along t and b; 1e6 is a roughness of 0.0014.
N_U = Parameter("n_u", 1, 1.0, 1e6, 100.0, log=True)
N_V = Parameter("n_v", 1, 1.0, 1e6, 100.0, log=True)

# Tails of distributions; GGX and Beckmann lie within.
BECKMANN_GAMMA = Parameter("beckmann_gamma", 1, 0.2, 4.0, 1.0, log=True)
CAUCHY_Q = Parameter("cauchy_q", 1, 1.5, 10.0, 2.0, log=True)
STUDENT_GAMMA = Parameter("student_gamma", 1, 1.5, 40.0, 2.0, log=True)
DIFFUSE_ROUGHNESS = Parameter("diffuse_roughness", 1, 0.0, 1.0, 0.0)

# The difference that modules may make between viewer and light. At 0 the BRDF is exactly reciprocal; measured files
# are not.
ASYMMETRY = Parameter("asymmetry", 1, -2.0, 2.0, 0.0)


def latent(n: int) -> Parameter:
    """Return the neural parameters: `n` numbers that only modules read, 0.5 at the start (section 4.3).

    The range only keeps a fit from running away along a direction the data says nothing about.
    """
    return Parameter("latent", n, -16.0, 16.0, 0.5, kind="latent")


def read_out(n: int) -> Parameter:
    """Return the weights of the material's own by which it reads out a shared trunk: `n` numbers, 0 at the start.

    The range only keeps a fit from running away along a direction the data says nothing about.
    """
    return Parameter("read_out", n, -MAX_LOG, MAX_LOG, 0.0, kind="latent")


def code(n: int) -> Parameter:
    """Return the few numbers that stand for a read-out: times a matrix that all materials share; 0 at the start.

    In the training materials their mean square is 1. The range only keeps a fit from running away.
    """
    return Parameter("code", n, -16.0, 16.0, 0.0, kind="latent")


def norm(slot: str, channels: int = 1) -> Parameter:
    """Return what is added to the logarithm of the factor in `slot`: one number, or one for each channel.

    :mod:`mi_enhance.material.colour_normalization` sets it.
    """
    kind: Kind = "scalar" if channels == 1 else "latent"
    return Parameter(f"norm_{slot}", channels, -MAX_LOG, MAX_LOG, 0.0, fixed=True, kind=kind)


def count(parameters: Sequence[Parameter]) -> int:
    """Return the total number of floats.

    Examples
    --------
    >>> count([RHO_D, F0])
    4
    """
    return sum(p.size for p in parameters)


def colours(parameters: Sequence[Parameter]) -> set[str]:
    """Return the names of the colours.

    Examples
    --------
    >>> colours([RHO_D, F0])
    {'rho_d'}
    """
    return {p.name for p in parameters if p.is_colour}


def components(p: Parameter) -> list[str]:
    """Return a name for each number of a parameter; the channels of maps have these names.

    Examples
    --------
    >>> components(RHO_D), components(latent(2)), components(F0)
    (['rho_d.R', 'rho_d.G', 'rho_d.B'], ['latent.00', 'latent.01'], ['F0'])
    """
    if p.is_colour:
        return [f"{p.name}.{c}" for c in "RGB"]
    return [f"{p.name}.{k:02d}" for k in range(p.size)] if p.kind == "latent" else [p.name]


def initial(parameters: Sequence[Parameter]) -> dict[str, np.ndarray]:
    """Return the starting values: name -> float64 array of length `size`."""
    return {p.name: np.full(p.size, p.initial) for p in parameters}


def flatten(parameters: Sequence[Parameter], values: Mapping[str, Any]) -> np.ndarray:
    """Return the values as one float64 vector in the order of `parameters`."""
    return np.concatenate([np.broadcast_to(np.asarray(values[p.name], np.float64), p.size) for p in parameters])


def unflatten(parameters: Sequence[Parameter], vector: Sequence | np.ndarray) -> dict[str, Any]:
    """Undo :func:`flatten`, for a NumPy vector or any sequence of per-lane Dr.Jit arrays.

    From Dr.Jit arrays colours become ``mi.Color3f``, and scalars single entries; from a NumPy vector every parameter is
    a slice of it.
    """
    if len(vector) != count(parameters):
        raise ValueError(f"parameters: {len(vector)} numbers given, {count(parameters)} expected.")
    result, start = {}, 0
    for p in parameters:
        part: Any = vector[start : start + p.size]
        start += p.size
        if not isinstance(vector, np.ndarray):
            part = mi.Color3f(*part) if p.is_colour else list(part) if p.kind == "latent" else part[0]
        result[p.name] = part
    return result


def check(parameters: Sequence[Parameter], values: Mapping[str, Any], where: str) -> dict[str, np.ndarray]:
    """Return `values` as float64 arrays of the right size; fill in no defaults.

    Raises
    ------
    ValueError
        For a missing parameter, an unknown name, a wrong length, a value that is not finite or out of range.
    """
    names = [p.name for p in parameters]
    for name in values:
        if name not in names:
            raise ValueError(f'{where}: unknown parameter "{name}". Choose from: {", ".join(names)}.')
    result = {}
    for p in parameters:
        if p.name not in values:
            raise ValueError(f'{where}: parameter "{p.name}" is missing. Needed: {", ".join(names)}.')
        try:
            v = np.atleast_1d(np.asarray(values[p.name], np.float64)).ravel()
        except (TypeError, ValueError):
            got = shortened(values[p.name])
            raise ValueError(f"{where}: {p.name} takes {p.size} number(s); got {got}.") from None
        if v.size not in (1, p.size):
            raise ValueError(f"{where}: {p.name} takes {p.size} number(s); got {v.size}.")
        v = np.broadcast_to(v, p.size)
        # float32 files round the bounds: a relative 1e-6 is their resolution, not a violation
        slack = 1e-6 * max(abs(p.low), abs(p.high))
        if not np.isfinite(v).all() or v.min() < p.low - slack or v.max() > p.high + slack:
            raise ValueError(f"{where}: {p.name} must lie in [{p.low:g}, {p.high:g}]; got {v.tolist()}.")
        result[p.name] = np.clip(v, p.low, p.high)
    return result
