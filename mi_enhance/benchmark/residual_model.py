"""The obvious alternative: an analytic model with a residual network at its output (the paper's Fig. 8).

``f = max(analytic + R, 0)``: R has three linear outputs and the same inputs, latent numbers included, as our modules.
It is one network for all materials; :mod:`mi_enhance.benchmark.residual_network` trains one for each.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from ..analytic import models, parameters
from ..analytic.graph import Node
from ..neural.enhanced_brdf import EnhancedBRDF
from ..neural.inputs import InputKind, names_of_directions
from ..neural.mlp import MLP, xavier
from ..neural.parameter_inputs import n_of_parameters

SMALL, LARGE = (32, 64, 64, 16), (32, 64, 128, 128, 64)  # the paper's: as large as its modules, and five times


@dataclasses.dataclass(frozen=True)
class Residual(EnhancedBRDF):
    """A BRDF whose slot R is a signed network, not the exponential of one."""

    def _function(self, slot: str, x: Any, evaluator: Any, bias: Any, limit: float) -> Callable:
        return lambda record: mi.Color3f(*evaluator(x, bias))


def with_residual(
    name: str, hidden: Sequence[int], *, n_latent: int, inputs: InputKind = "shape", seed: int = 0
) -> Residual:
    """Return the model `name` plus a residual network that is 0 at first.

    Examples
    --------
    >>> print(with_residual("ggx", SMALL, n_latent=27))
    M + S * D * F * G * 1/E + [R]
    """
    model = models.get(name)
    colours = sorted(parameters.colours(model.parameters))
    names = ("cos_theta_i", "cos_theta_o", *colours)  # a term that reads a colour may return one
    r = Node("R", lambda **_: 0.0, inputs=names)
    graph = Node("f+R", lambda a, b: dr.maximum(a + b, 0), (model.graph, r), "+")
    model = dataclasses.replace(model, name=f"{name} + residual", graph=graph)
    n_params = n_of_parameters(model, inputs) + n_latent
    n_directions = len(names_of_directions(model, inputs, r))
    mlp = xavier((n_params + n_directions, *hidden, 3), n_params, np.random.default_rng(seed))
    *layers, (w, b) = mlp.layers
    return Residual(model, {"R": MLP((*layers, (0 * w, b)), n_params)}, n_latent, inputs)
