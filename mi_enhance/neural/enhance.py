"""Put modules into the slots of a model."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import mitsuba as mi
import numpy as np

from ..analytic import geometry, models, parameters
from ..analytic.graph import Node
from ..analytic.models.model import Model
from . import mlp
from .enhanced_brdf import EnhancedBRDF
from .inputs import COLOURLESS, INPUTS, InputKind, names_of_directions
from .parameter_inputs import n_of_parameters, names_of_parameters, of_parameters
from .trunk import Trunk

FIRST_ASYMMETRY = 0.3  # of a trunk


def enhance(
    model: Model | str,
    replace: Iterable[str] | Mapping[str, Sequence[int]] = ("F", "F*G", "G", "1/E"),
    *,
    n_latent: int = 27,
    hidden: Sequence[int] = mlp.HIDDEN,
    inputs: InputKind = "symmetric",
    modulated: bool = False,
    seed: int = 0,
) -> EnhancedBRDF:
    """Replace slots of an analytic model by modules with Xavier weights.

    Parameters
    ----------
    model : Model or str
        An analytic model or its name.
    replace : iterable of str, or dict of str to sequence of int
        Slots to replace, all by modules of the sizes `hidden` or each by one of its own; the default is the paper's
        final state.
    n_latent : int
        Neural parameters per material.
    hidden : sequence of int
        Hidden layer sizes, 1 to 8 layers of 1 to 1024 units.
    inputs : {"symmetric", "shape", "reciprocal", "own", "directions"}
        See :class:`EnhancedBRDF`.
    modulated : bool
        Let the last layer of the modules of terms belong to the material, see :class:`mi_enhance.neural.mlp.MLP`.
    seed : int
        Of the initial weights.

    Returns
    -------
    EnhancedBRDF

    Raises
    ------
    KeyError
        If `replace` names a slot the model does not have; the message lists the slots.
    ValueError
        For unknown `inputs`, for hidden sizes out of range, or if the modules would read parameters that the model does
        not have.

    Examples
    --------
    >>> brdf = enhance("ggx")
    >>> print(brdf, brdf.n_weights)
    M + S * D * [F] [*] [G] * [1/E] 6612
    """
    model = models.get(model) if isinstance(model, str) else model
    if inputs not in INPUTS:
        raise ValueError(f'enhance(): inputs="{inputs}" is unknown. Choose one of: {", ".join(INPUTS)}.')
    replace = dict(replace) if isinstance(replace, Mapping) else dict.fromkeys(replace, hidden)
    for name in sorted(replace):
        model.graph.find(name)
        mlp.check_sizes(replace[name], f"enhance(): the module of {name}")
    own, read = {p.name for p in model.parameters}, set(names_of_parameters(model, inputs))
    if replace and read - own:
        raise ValueError(
            f'enhance(): modules read {", ".join(sorted(read - own))}, which model "{model.name}" does not have. '
            'Use inputs="shape", or the model as it is, replace=().'
        )
    extra = own - read - set(parameters.FRAME)
    if extra and inputs not in COLOURLESS and not all(model.graph.find(name).args for name in replace):
        raise ValueError(
            f'enhance(): inputs="{inputs}" has no place for {", ".join(sorted(extra))} of model "{model.name}". '
            'Use inputs="shape".'
        )
    rng = np.random.default_rng(seed)
    n_params = n_of_parameters(model, inputs) + n_latent
    modules = {}
    for node in model.graph.walk():
        if node.name in replace:
            folded, varying, out = _sizes(node, model, n_params, len(names_of_directions(model, inputs, node)))
            modules[node.name] = mlp.xavier(
                (folded + varying, *replace[node.name], out), folded, rng, modulated and folded > 0
            )
    return EnhancedBRDF(model, modules, n_latent, inputs)


def _sizes(node: Node, model: Model, n_params: int, n_directional: int) -> tuple[int, int, int]:
    """Return the numbers of constant inputs, varying inputs and outputs of the module of a slot (paper, Fig. 3)."""
    if node.args:
        return 0, 2, 1
    directional = node.reads(geometry.QUANTITIES)
    # A term that reads a colour has a colour as value (M, S), any other a scalar (D, F, G, 1/E).
    colour = node.reads(parameters.colours(model.parameters))
    return n_params, n_directional if directional else 0, 3 if colour else 1


def with_trunk(
    model: Model | str,
    slots: Iterable[str] = ("B", "G", "G2"),
    *,
    n_latent: int = 8,
    hidden: Sequence[int] = (32, 32, 64),
    channels: int = 3,
    rank: int = 0,
    seed: int = 0,
) -> EnhancedBRDF:
    """Give slots of an analytic model one trunk with Xavier weights, which materials read out by their own.

    Parameters
    ----------
    model : Model or str
        An analytic model or its name.
    slots : iterable of str
        Terms whose factors are read out, one of each summand of the BRDF.
    n_latent : int
        Numbers of a material that the trunk sees.
    hidden : sequence of int
        Hidden layer sizes; the last is the number K of units that are read out.
    channels : {3, 1}
        Factors in RGB, or the same for all channels.
    rank : int
        Numbers of a code for each slot, 1 to 1024; 0: read-outs are free.
    seed : int
        Of the initial weights.

    Returns
    -------
    EnhancedBRDF

    Raises
    ------
    KeyError
        If `slots` names one that the model does not have.
    ValueError
        For an operator among the slots, other channels than 1 or 3, a rank or hidden sizes out of range.

    Examples
    --------
    >>> brdf = with_trunk("ggx2")
    >>> print(brdf, brdf.n_parameters)
    M * [B] + S * D * F * [G] * 1/E + S2 * D2 * F2 * [G2] * 1/E2 611
    """
    model = models.get(model) if isinstance(model, str) else model
    slots = tuple(slots)
    operators = [name for name in slots if model.graph.find(name).args]
    if operators or not slots:
        raise ValueError(f"with_trunk(): {', '.join(operators) or 'no slot'}: a read-out stands in the slots of terms.")
    if channels not in (1, 3):
        raise ValueError(f"with_trunk(): channels must be 3 (RGB) or 1; got {channels}.")
    mlp.check_sizes(hidden, "with_trunk(): the trunk")
    if not isinstance(rank, (int, np.integer)) or not 0 <= rank <= mlp.MAX_UNITS:
        raise ValueError(f"with_trunk(): rank {rank!r} is out of range: 0 to {mlp.MAX_UNITS}.")
    n_in = n_latent + len(names_of_directions(model, "shape", model.graph.find(slots[0])))
    rng = np.random.default_rng(seed)
    shared = mlp.xavier((n_in, *hidden), n_latent, rng)
    basis = mlp.xavier((hidden[-1], len(slots) * rank * channels), 0, rng) if rank else None
    return EnhancedBRDF(model, {}, n_latent, "shape", Trunk(slots, shared, channels, basis))


def first_latent(brdf: EnhancedBRDF, values: np.ndarray) -> np.ndarray:
    """Return the ``latent`` numbers that a trunk starts from, (M, n_latent), for parameters (M, P) of materials.

    The shape of the lobes comes first, as modules see it, then zeros. From there they are free numbers of the material:
    an edit of a roughness does not move them.

    Examples
    --------
    >>> brdf = with_trunk("ggx2", n_latent=6)
    >>> first_latent(brdf, parameters.flatten(brdf.parameters, parameters.initial(brdf.parameters))[None]).round(2)
    array([[-0.4 , -0.4 ,  0.2 , -0.23, -0.23,  0.  ]])
    """
    n = parameters.count(brdf.model.parameters)
    columns = [mi.Float(column.tolist()) for column in values[:, :n].T]
    shape = of_parameters(parameters.unflatten(brdf.model.parameters, columns), brdf.inputs, brdf.model)
    result = np.zeros((len(values), brdf.n_latent))
    for k, v in enumerate(shape[: brdf.n_latent]):
        result[:, k] = np.array(v)
    return result


def trunk_start(brdf: EnhancedBRDF, values: np.ndarray) -> np.ndarray:
    """Return parameters (P,) or (M, P) from which fits with a trunk start: those of `values`, and the networks' own.

    At 0 the features of the difference of viewer and light would have no effect, and so no gradient: ``asymmetry``
    starts a little away.
    """
    names = np.array([p.name for p in brdf.parameters for _ in range(p.size)])
    values = values.copy()
    values[..., names == "latent"] = first_latent(brdf, np.atleast_2d(values)).reshape(*values.shape[:-1], -1)
    values[..., names == "asymmetry"] = FIRST_ASYMMETRY
    return values
