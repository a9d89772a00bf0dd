"""The inputs of the modules, in five kinds, and the table of those that vary with the directions.

Their number, names and places come from it; the others are listed in :mod:`mi_enhance.neural.parameter_inputs`.

``"shape"``
    Features of half vector and difference angle in the material's frame; of the parameters only those that shape lobes,
    never a colour or the frame, so an edit of a colour changes nothing else. ``asymmetry`` lets modules follow files
    that are not reciprocal.
``"reciprocal"``
    The same, but viewer and light may be exchanged: of the difference of their cosines networks see the size. Networks
    learned with ``"shape"`` serve as they are.
``"own"``
    The same parameters, but of the directions only those features that the replaced term sees: F the difference angle,
    D the half vector, G and 1/E each direction by itself. No term can make good the weakness of another.
``"symmetric"``
    Six features of half vector and difference angle, and all analytic parameters.
``"directions"``
    The paper's: raw directions and parameters.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from typing import Any, Literal, get_args

import drjit as dr

from ..analytic import lobes
from ..analytic.graph import Node
from ..analytic.lobes import Lobe
from ..analytic.models.model import Model

InputKind = Literal["shape", "reciprocal", "own", "symmetric", "directions"]
INPUTS: tuple[str, ...] = get_args(InputKind)
COLOURLESS = ("shape", "reciprocal", "own")  # whose modules see no colour, and read ``asymmetry``

_ALL = (*COLOURLESS, "symmetric")

Seen = Literal["half", "difference", "each", "slopes", "raw"]
# The quantities of which a term reads one, so that it sees features of the half vector, or of each direction.
_HALF, _EACH = {"h", "cos_theta_h"}, {"cos_theta_i", "cos_theta_o", "wi", "wo"}
_EVEN = 0.05  # differences of cosines that count as none, so that the features are smooth at 0


def _sin2_h(q: Mapping) -> list:
    return [dr.square(q["h"].x) + dr.square(q["h"].y)]


def _in_lobe(q: Mapping, lobe: Lobe) -> list:
    a_x, a_y = q[lobe.alpha_x], q[lobe.alpha_y]
    u, v = dr.square(q["h"].x / a_x), dr.square(q["h"].y / a_y)
    return [
        dr.log(1 + u + v) / 5,  # theta_h relative to the width of the lobe; /5: alpha = 1e-3 gives 2.8
        (u - v) / (1 + u + v) * (a_y - a_x) / (a_x + a_y),  # azimuth of h, vanishing with the anisotropy
    ]


def _cosines(q: Mapping) -> list:
    product = q["cos_theta_i"] * q["cos_theta_o"]
    return [product, dr.log(product + 1e-4) / 5]  # 1e-4: log has a finite slope at the horizon


def _sin_d(q: Mapping) -> list:
    """Retro-reflection is a cusp at theta_d = 0, where the cosine is flat; 1e-4: a finite slope there."""
    return [dr.sqrt(1 - dr.square(q["cos_theta_d"]) + 1e-4)]


def _asymmetric(q: Mapping) -> list:
    """Tell viewer from light, as much as the material asks for: asymmetry = 0 is exactly reciprocal."""
    return [q["asymmetry"] * v for v, _ in _differences(q)]


def _differences(q: Mapping) -> list:
    """Return difference and logarithm of the ratio of the cosines, each with its scale."""
    cos_i, cos_o = q["cos_theta_i"], q["cos_theta_o"]
    return [(cos_i - cos_o, 1.0), (dr.log((cos_i + 0.01) / (cos_o + 0.01)) / 5, 1 / 5)]


def _even(q: Mapping) -> list:
    """Return the sizes of both, which do not tell viewer from light; without a kink where the highlight is."""
    return [q["asymmetry"] * dr.sqrt(dr.square(v) + dr.square(scale * _EVEN)) for v, scale in _differences(q)]


def _slopes(q: Mapping, lobe: Lobe) -> list:
    """The slope of each direction relative to the roughness, of which Smith's shadowing is made."""
    a_x, a_y = q[lobe.alpha_x], q[lobe.alpha_y]
    # 1e-4: a finite slope at the horizon
    t_i, t_o = ((dr.square(a_x * w.x) + dr.square(a_y * w.y)) / (dr.square(w.z) + 1e-4) for w in (q["wi"], q["wo"]))
    return [dr.log(1 + t_i) + dr.log(1 + t_o), dr.log(1 + t_i) * dr.log(1 + t_o)]


@dataclasses.dataclass(frozen=True)
class Features:
    """Features of a pair of directions that come from one function.

    Parameters
    ----------
    names : tuple of str
        One for each feature.
    function : callable
        ``function(record) -> list`` of the features.
    seen : {"half", "difference", "each", "slopes", "raw"}
        The part of the directions that they describe.
    inputs : tuple of str
        The kinds of inputs that have them.
    lobe : Lobe, optional
        The lobe whose roughness they read.
    asymmetric : bool
        True if they read ``asymmetry``: where it is 0, so are they.
    """

    names: tuple[str, ...]
    function: Callable[[Mapping], list]
    seen: Seen
    inputs: tuple[str, ...]
    lobe: Lobe | None = None
    asymmetric: bool = False

    def known(self, names: Collection[str]) -> bool:
        """Tell whether the parameters `names` are enough for them."""
        return (self.lobe is None or self.lobe.alpha_x in names) and (not self.asymmetric or "asymmetry" in names)

    def seen_by(self, node: Node) -> bool:
        """Tell whether the term of a slot sees this part of the directions, and reads the roughness of this lobe."""
        read = set(node.inputs)
        seen = {
            "half": bool(read & _HALF),
            "difference": "cos_theta_d" in read,
            "each": bool(read & _EACH),
            "slopes": {"wi", "wo"} <= read,
        }
        return seen.get(self.seen, False) and (self.lobe is None or self.lobe in lobes.rough(read)[:1])


def _of_lobe(lobe: Lobe) -> Features:
    inputs = _ALL if lobe is lobes.FIRST else COLOURLESS
    names = (lobe.own("lobe"), lobe.own("azimuth"))
    return Features(names, functools.partial(_in_lobe, lobe=lobe), "half", inputs, lobe)


# In the order of the weights of a module; "own" takes the parts of the directions one after the other. For alpha_x =
# alpha_y no feature of "shape" and "symmetric" depends on the azimuth of h: such a material is exactly isotropic.
_FEATURES = (
    Features(("sin2_h",), _sin2_h, "half", _ALL),
    *(_of_lobe(lobe) for lobe in lobes.LOBES),
    Features(("cos_d",), lambda q: [q["cos_theta_d"]], "difference", _ALL),
    Features(("sum",), lambda q: [q["cos_theta_i"] + q["cos_theta_o"]], "each", ("own",)),
    Features(("product", "log_product"), _cosines, "each", _ALL),
    Features(("sin_d",), _sin_d, "difference", COLOURLESS),
    Features(("difference", "log_ratio"), _asymmetric, "each", ("shape", "own"), asymmetric=True),
    Features(("even_difference", "even_log_ratio"), _even, "each", ("reciprocal",), asymmetric=True),
    *(
        Features(
            (lobe.own("slope_sum"), lobe.own("slope_product")),
            functools.partial(_slopes, lobe=lobe),
            "slopes",
            ("own",),
            lobe,
        )
        for lobe in lobes.LOBES
    ),
    Features(tuple(f"{w}.{axis}" for w in ("wi", "wo") for axis in "xyz"), lambda q: q["raw"], "raw", ("directions",)),
)
_ORDER = get_args(Seen)

# Keys of named(): the features of "shape" and "reciprocal", for models with up to two lobes.
NAMES = tuple(name for f in _FEATURES if {"shape", "reciprocal"} & set(f.inputs) for name in f.names)
ASYMMETRIC = tuple(name for f in _FEATURES if f.asymmetric for name in f.names)


def _features(inputs: str, known: Collection[str], node: Node | None = None) -> list[Features]:
    """Return the features that a module sees, for the parameters `known`; `node` is the slot of an ``"own"`` one."""
    found = [f for f in _FEATURES if inputs in f.inputs and f.known(known)]
    if inputs != "own" or node is None:
        return found
    return sorted((f for f in found if f.seen_by(node)), key=lambda f: _ORDER.index(f.seen))


def names_of_directions(model: Model, inputs: str, node: Node) -> list[str]:
    """Return the names of the features that the module of a slot sees, in the order of :func:`of_directions`.

    Examples
    --------
    >>> from mi_enhance import models
    >>> names_of_directions(models.get("ggx"), "own", models.get("ggx").graph.find("F"))
    ['cos_d', 'sin_d']
    """
    known = {p.name for p in model.parameters} | {"asymmetry"}
    return [name for f in _features(inputs, known, node) for name in f.names]


def of_directions(q: Mapping, inputs: str, wi: Any, wo: Any, nodes: Iterable[Node]) -> dict[str, list]:
    """Compute the inputs that vary with the directions.

    Parameters
    ----------
    q : dict
        Quantities of :func:`mi_enhance.analytic.geometry.quantities`, in the material's frame, and parameters. Without
        ``asymmetry``, which :mod:`mi_enhance.neural.simplify` may have left out, its two features are left out, too.
    inputs : {"shape", "reciprocal", "own", "symmetric", "directions"}
    wi, wo : mi.Vector3f
        Directions in the frame of the surface.
    nodes : iterable of Node
        The slots.

    Returns
    -------
    dict of str to list of mi.Float
        By slot.
    """
    nodes = list(nodes)
    if inputs == "own":
        return {node.name: _values(_features(inputs, q, node), q) for node in nodes}
    record = {**q, "raw": [*wi, *wo]} if inputs == "directions" else q
    return dict.fromkeys((node.name for node in nodes), _values(_features(inputs, q), record))


def _values(features: Sequence[Features], q: Mapping) -> list:
    return [v for f in features for v in f.function(q)]


def named(q: Mapping) -> dict[str, Any]:
    """Compute the features of ``"shape"`` and ``"reciprocal"`` by name, as far as `q` has their parameters.

    Examples
    --------
    >>> from mi_enhance.analytic.geometry import quantities
    >>> list(named(quantities(mi.Vector3f(0, 0, 1), mi.Vector3f(0, 0, 1))))
    ['sin2_h', 'cos_d', 'product', 'log_product', 'sin_d']
    """
    found = dict.fromkeys([*_features("shape", q), *_features("reciprocal", q)])
    return {name: v for f in found for name, v in zip(f.names, f.function(q), strict=True)}


def names_of(inputs: str) -> tuple[str, ...]:
    """Return the names of the features of a kind that a small network of a material's own may see.

    Examples
    --------
    >>> names_of("reciprocal")[-2:], names_of("shape")[-2:]
    (('even_difference', 'even_log_ratio'), ('difference', 'log_ratio'))
    """
    kind = "reciprocal" if inputs == "reciprocal" else "shape"
    return tuple(name for f in _FEATURES if kind in f.inputs for name in f.names)
