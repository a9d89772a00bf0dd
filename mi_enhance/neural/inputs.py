"""What the networks see: features of a pair of directions and of a material's parameters, in four kinds.

``"shape"``
    Features of half vector and difference angle in the material's frame; of the parameters only those that shape lobes,
    never a colour or the frame, so an edit of a colour changes nothing else. ``asymmetry`` lets networks follow files
    that are not reciprocal.
``"own"``
    The same parameters, but of the directions only what the replaced term sees: F the difference angle, D the half
    vector, G and 1/E each direction by itself. No term can make good the weakness of another.
``"symmetric"``
    Six features of half vector and difference angle, and all analytic parameters.
``"directions"``
    The paper's: raw directions and parameters.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import drjit as dr

from ..analytic import parameters
from ..analytic.graph import Node
from ..analytic.models.model import Model

INPUTS = ("shape", "own", "symmetric", "directions")
COLOURLESS = ("shape", "own")  # whose networks see no colour, and may tell viewer from light

# What makes a term see the half vector, and each direction by itself.
_HALF, _EACH = {"h", "cos_theta_h"}, {"cos_theta_i", "cos_theta_o", "wi", "wo"}


def _lobes(names: Iterable[str]) -> list[str]:
    """Suffixes of the lobes whose roughness is among `names`: "" for alpha_x, "2" for alpha_x2."""
    return [suffix for suffix in ("", "2") if f"alpha_x{suffix}" in names]


def _shape(model: Model) -> list[parameters.Parameter]:
    """The parameters that shape the lobes: neither colours nor the frame, nor what an alternative term brought."""
    return [p for p in model.parameters if not (p.is_colour or p.name in parameters.FRAME or p.name in model.extra)]


def of_parameters(p: Mapping, inputs: str, model: Model) -> list:
    """The inputs that are constant over a material: from the analytic parameters, then the latent ones.

    The paper's networks read the analytic parameters as they are. In the symmetric form the directions are given in the
    material's own frame, so n and t say nothing; their three places hold roughness and F0 on other scales.
    A value of `p` that is None, for colours and ``latent`` a list of them, gives None: it is not known yet.
    """
    plain = lambda v: v  # noqa: E731
    log, root = lambda v: dr.log(v) / 4, lambda v: dr.sqrt(v + 1e-4)  # 1e-4: sqrt has a finite slope at F0 = 0
    if inputs in COLOURLESS:  # what may be negative stays as it is
        analytic = [(log if q.log else root if q.low >= 0 else plain, p[q.name]) for q in _shape(model)]
    else:
        scales = [(plain, p[name]) for name in ("alpha_x", "alpha_y", "F0")]
        if inputs == "directions":
            frame = [p["n_x"], p["n_y"], p["t_theta"]]
            analytic = [*((plain, v) for v in (*frame, *p["rho_d"], *p["rho_s"])), *scales]
        else:
            first = [(log, p["alpha_x"]), (log, p["alpha_y"]), (root, p["F0"])]
            # log1p keeps rho_s, which spans 0 to 10, in the range of the others
            scaled = [(lambda v: dr.log(1 + v), c) for c in p["rho_s"]]
            analytic = [*first, *((plain, c) for c in p["rho_d"]), *scaled, *scales]
    return [*(None if v is None else f(v) for f, v in analytic), *p.get("latent", ())]


def names_of_parameters(model: Model, inputs: str) -> list[str]:
    """What :func:`of_parameters` reads, latent numbers aside."""
    return [p.name for p in (_shape(model) if inputs in COLOURLESS else model.parameters)]


def n_of_parameters(model: Model, inputs: str) -> int:
    """Length of the list that :func:`of_parameters` makes, latent numbers aside."""
    return len(_shape(model)) if inputs in COLOURLESS else parameters.count(model.parameters)


def n_of_directions(model: Model, inputs: str, node: Node) -> int:
    """Length of the list that :func:`of_directions` makes for a slot."""
    if inputs == "own":
        return _n_own(node)
    return 7 + 2 * len(_lobes([p.name for p in model.parameters])) if inputs == "shape" else 6


def of_directions(q: Mapping, inputs: str, wi, wo, nodes: Iterable[Node]) -> dict[str, list]:
    """The inputs that vary with the directions, by slot.

    Parameters
    ----------
    q : dict
        Quantities of :func:`mi_enhance.analytic.geometry.quantities`, in the material's frame, and parameters.
    inputs : str
    wi, wo : mi.Vector3f
        Directions in the frame of the surface.
    nodes : iterable of Node
        The slots.
    """
    if inputs == "own":
        return {node.name: _own(q, node) for node in nodes}
    shared = _shared(q, inputs, wi, wo)
    return dict.fromkeys((node.name for node in nodes), shared)


def _shared(q: Mapping, inputs: str, wi, wo) -> list:
    """Features of a pair of directions in the material's frame, symmetric in wi and wo: reciprocity for free.

    Measured files are not reciprocal themselves: two features of ``"shape"``, scaled by a parameter, follow them.
    For alpha_x = alpha_y none of them depends on the azimuth of h: such a material is exactly isotropic.
    """
    if inputs == "directions":
        return [*wi, *wo]
    lobes = _lobes(q) if inputs == "shape" else ("",)
    product = q["cos_theta_i"] * q["cos_theta_o"]
    # 1e-4: log has a finite slope at the horizon
    features = [*_half_features(q, lobes), q["cos_theta_d"], product, dr.log(product + 1e-4) / 5]
    return [*features, _sin_theta_d(q), *_asymmetric_features(q)] if inputs == "shape" else features


# Keys of named(): the features of "shape", for models with up to two lobes.
NAMES = (
    *("sin2_h", "lobe", "azimuth", "lobe2", "azimuth2", "cos_d", "product", "log_product", "sin_d"),
    *("difference", "log_ratio"),
)


def named(q: Mapping) -> dict:
    """The features of ``"shape"`` by name, as far as `q` has what they are made of; the last two need asymmetry.

    Examples
    --------
    >>> from mi_enhance.analytic.geometry import quantities
    >>> list(named(quantities(mi.Vector3f(0, 0, 1), mi.Vector3f(0, 0, 1))))
    ['sin2_h', 'cos_d', 'product', 'log_product', 'sin_d']
    """
    lobes = _lobes(q)
    left_out = {name + n for name in ("lobe", "azimuth") for n in ("", "2") if n not in lobes}
    if "asymmetry" not in q:
        left_out |= {"difference", "log_ratio"}
    names = [name for name in NAMES if name not in left_out]
    return dict(zip(names, _shared(q, "shape", None, None), strict=True))


def _half_features(q: Mapping, lobes: Iterable[str]) -> list:
    h = q["h"]
    features = [dr.square(h.x) + dr.square(h.y)]  # sin^2 theta_h
    for lobe in lobes:
        a_x, a_y = q[f"alpha_x{lobe}"], q[f"alpha_y{lobe}"]
        u, v = dr.square(h.x / a_x), dr.square(h.y / a_y)
        features += [
            dr.log(1 + u + v) / 5,  # theta_h relative to the width of the lobe; /5: alpha = 1e-3 gives 2.8
            (u - v) / (1 + u + v) * (a_y - a_x) / (a_x + a_y),  # azimuth of h, vanishing with the anisotropy
        ]
    return features


def _sin_theta_d(q: Mapping):
    """Retro-reflection is a cusp at theta_d = 0, where the cosine is flat; 1e-4: a finite slope there."""
    return dr.sqrt(1 - dr.square(q["cos_theta_d"]) + 1e-4)


def _asymmetric_features(q: Mapping) -> list:
    """What tells viewer from light, as much as the material asks for: asymmetry = 0 is exactly reciprocal.

    Left out where :mod:`mi_enhance.neural.simplify` has left out the parameter, and the networks' inputs with it.
    """
    if "asymmetry" not in q:
        return []
    cos_i, cos_o = q["cos_theta_i"], q["cos_theta_o"]
    return [q["asymmetry"] * (cos_i - cos_o), q["asymmetry"] * dr.log((cos_i + 0.01) / (cos_o + 0.01)) / 5]


def _own(q: Mapping, node: Node) -> list:
    """Of the features of ``"shape"`` those made of what the term of a slot sees, :func:`_n_own` many."""
    features, seen = [], set(node.inputs)
    lobe = _lobe_of(node)
    if seen & _HALF:
        features += _half_features(q, () if lobe is None else (lobe,))
    if "cos_theta_d" in seen:
        features += [q["cos_theta_d"], _sin_theta_d(q)]
    if seen & _EACH:
        cos_i, cos_o = q["cos_theta_i"], q["cos_theta_o"]
        features += [cos_i + cos_o, cos_i * cos_o, dr.log(cos_i * cos_o + 1e-4) / 5, *_asymmetric_features(q)]
    if {"wi", "wo"} <= seen and lobe is not None:
        # the slope of each direction relative to the roughness, which is what Smith's shadowing is made of
        a_x, a_y = q[f"alpha_x{lobe}"], q[f"alpha_y{lobe}"]
        t_i, t_o = ((dr.square(a_x * w.x) + dr.square(a_y * w.y)) / (dr.square(w.z) + 1e-4) for w in (q["wi"], q["wo"]))
        features += [dr.log(1 + t_i) + dr.log(1 + t_o), dr.log(1 + t_i) * dr.log(1 + t_o)]
    return features


def _n_own(node: Node) -> int:
    seen, n_lobes = set(node.inputs), 0 if _lobe_of(node) is None else 1
    slopes = 2 * n_lobes if {"wi", "wo"} <= seen else 0
    return bool(seen & _HALF) * (1 + 2 * n_lobes) + 2 * ("cos_theta_d" in seen) + 5 * bool(seen & _EACH) + slopes


def _lobe_of(node: Node) -> str | None:
    """Suffix of the lobe whose roughness a term reads: "" or "2"; None if it reads none."""
    return next((lobe for lobe in ("", "2") if f"alpha_x{lobe}" in node.inputs), None)
