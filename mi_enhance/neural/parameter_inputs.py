"""The inputs of the modules that are constant over a material: parameters, each on a scale."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import drjit as dr

from ..analytic import parameters
from ..analytic.models.model import Model
from .inputs import COLOURLESS


def _plain(v: Any) -> Any:
    return v


def _log(v: Any) -> Any:
    return dr.log(v) / 4


def _log1p(v: Any) -> Any:
    """Keep rho_s, which spans 0 to 10, in the range of the others."""
    return dr.log(1 + v)


def _root(v: Any) -> Any:
    return dr.sqrt(v + 1e-4)  # 1e-4: sqrt has a finite slope at F0 = 0


Scale = Callable[[Any], Any]
_SCALES = tuple((name, _plain) for name in ("alpha_x", "alpha_y", "F0"))
# The paper's modules read the analytic parameters as they are. In the symmetric form the directions are given in the
# material's own frame, so n and t say nothing; their three places hold roughness and F0 on other scales.
_CONSTANTS: dict[str, tuple[tuple[str, Scale], ...]] = {
    "directions": (*((name, _plain) for name in (*parameters.FRAME, "rho_d", "rho_s")), *_SCALES),
    "symmetric": (
        *(("alpha_x", _log), ("alpha_y", _log), ("F0", _root)),
        *(("rho_d", _plain), ("rho_s", _log1p)),
        *_SCALES,
    ),
}


def _constants(model: Model, inputs: str) -> tuple[tuple[str, Scale], ...]:
    """Return parameter and scale of the constant inputs, in the order of the weights."""
    if inputs not in COLOURLESS:
        return _CONSTANTS[inputs]
    # Parameters that shape the lobes: neither colours nor the frame, nor those of an alternative term. Numbers that may
    # be negative stay as they are.
    shape = (q for q in model.parameters if not (q.is_colour or q.name in parameters.FRAME or q.name in model.extra))
    return tuple((q.name, _log if q.log else _root if q.low >= 0 else _plain) for q in shape)


def names_of_parameters(model: Model, inputs: str) -> list[str]:
    """Return the names of the parameters that :func:`of_parameters` reads, except ``latent``."""
    return list(dict.fromkeys(name for name, _ in _constants(model, inputs)))


def n_of_parameters(model: Model, inputs: str) -> int:
    """Return the length of the list that :func:`of_parameters` makes, without the latent numbers."""
    sizes = {q.name: q.size for q in model.parameters}
    return sum(sizes.get(name, 1) for name, _ in _constants(model, inputs))


def of_parameters(p: Mapping, inputs: str, model: Model) -> list:
    """Compute the inputs that are constant over a material: from the analytic parameters, then the latent ones.

    Parameters
    ----------
    p : dict
        Parameter values. One that is None, for colours and ``latent`` a list of them, gives None: it is not known yet.
    inputs : {"shape", "reciprocal", "own", "symmetric", "directions"}
    model : Model

    Returns
    -------
    list of mi.Float or None
    """
    colours = parameters.colours(model.parameters)
    result = []
    for name, scale in _constants(model, inputs):
        result += [None if v is None else scale(v) for v in (p[name] if name in colours else [p[name]])]
    return [*result, *p.get("latent", ())]
