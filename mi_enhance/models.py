"""Analytic reflectance models as graphs with named parameters: what an enhancement starts from (paper, section 3)."""

from __future__ import annotations

import dataclasses
import difflib
import inspect
from collections.abc import Callable, Mapping
from pathlib import Path

import drjit as dr

from . import model_file, terms
from . import parameters as p
from .graph import Node
from .system.files import require_file


def lobes_of_alpha(params: Mapping) -> list[tuple]:
    """The GGX lobes of a model that has roughness and specular albedo: (rho_s, alpha_x, alpha_y) of each."""
    return [
        tuple(params[f"{k}{n}"] for k in ("rho_s", "alpha_x", "alpha_y")) for n in ("", "2") if f"rho_s{n}" in params
    ]


def lobes_of_abc(params: Mapping) -> list[tuple]:
    """A GGX lobe for the ABC lobe: as high, and as wide as the mean of two widths.

    Its peak is narrow and its tail wide; the geometric mean of the alpha with the same half width at half maximum and
    of the alpha with half of the weight inside the same angle halves the noise of the former where tails are wide.
    """
    alpha = alpha_of_abc(params["B"], params["C"])
    return [(params["A"] * (4 * alpha * alpha), alpha, alpha)]  # rho_s / (4 pi alpha^2) = A / pi


def alpha_of_abc(B, C):
    """Roughness of the GGX lobe that covers the ABC distribution, see :func:`lobes_of_abc`."""
    # x = 1 - cos(theta_h). Half the maximum: (1 + B x)^-C = 1/2; of GGX: sin^2 (1 - alpha^2) = alpha^2 (sqrt(2) - 1).
    x = dr.minimum((dr.exp2(dr.rcp(C)) - 1) / B, 1)
    sin2 = x * (2 - x)
    peak2 = sin2 / (sin2 + (2**0.5 - 1))
    # Half the weight: (1 + B x)^(1 - C) halfway between its values at x = 0 and 1; 0 / 0 at C = 1, but not beside it.
    length = dr.log(1 + B)
    k = (1 - C) * length
    k = dr.select(dr.abs(k) < 1e-2, 1e-2, k)
    x = dr.minimum((dr.exp(dr.log(0.5 * (1 + dr.exp(k))) / k * length) - 1) / B, 1)
    half2 = x * (2 - x)
    # 1e-4: where Mitsuba's own microfacet distribution ends
    return dr.maximum(dr.sqrt(dr.sqrt(peak2 * half2)), 1e-4)


def lobes_of_ashikhmin_shirley(params: Mapping) -> list[tuple]:
    """A GGX lobe for cos^n of the roughness alpha^2 = 2 / (n + 2), with which Beckmann's lobe is closest to it."""
    alpha = (dr.sqrt(2 / (params[n] + 2)) for n in ("n_u", "n_v"))
    return [(params["rho_s"], *alpha)] if "rho_s" in params else []


# The loss has a local minimum for each lobe width it can explain: one start for each.
_ROUGHNESSES = tuple({"alpha_x": alpha, "alpha_y": alpha} for alpha in (0.02, 0.06, 0.15, 0.3, 0.5, 0.8))


# Two roughnesses each, at half the initial strength: narrow over wide, and both wide.
_PAIRS = tuple(
    {"alpha_x": a, "alpha_y": a, "alpha_x2": b, "alpha_y2": b, "rho_s": 0.5, "rho_s2": 0.5}
    for a, b in ((0.02, 0.1), (0.02, 0.5), (0.06, 0.2), (0.06, 0.6), (0.15, 0.4), (0.3, 0.8), (0.5, 0.15), (0.8, 0.4))
)

# Darker and with more Fresnel than the initial values: on MERL a third of the excess over the best of many starts.
_COOK_TORRANCE_STARTS = tuple(
    {"alpha_x": alpha, "alpha_y": alpha, "rho_d": 0.1, "rho_s": rho_s, "F0": f0}
    for alpha, rho_s, f0 in (
        (0.02, 0.3, 0.2),
        (0.06, 0.3, 0.2),
        (0.15, 0.3, 0.2),
        (0.3, 0.3, 0.2),
        (0.5, 0.3, 0.2),
        (0.8, 0.3, 0.2),
        (0.2, 0.2, 0.7),
        (0.5, 0.2, 0.7),
    )
)

# Matte, satin, glossy, polished, metal, wide tails, cloth: what the published fits of MERL look like.
_ABC_STARTS = tuple(
    {"A": a, "B": b, "C": c, "ior": n}
    for a, b, c, n in (
        (1.0, 30.0, 1.7, 1.5),
        (5.0, 300.0, 1.2, 1.5),
        (50.0, 5e3, 1.2, 1.7),
        (500.0, 7e4, 1.2, 1.5),
        (1000.0, 2e5, 1.1, 5.0),
        (100.0, 1e6, 0.6, 5.0),
        (0.5, 2e6, 0.12, 2.5),
    )
)

# Roughnesses of 0.02 to 0.8, alpha^2 = 2 / (n + 2).
_EXPONENTS = tuple({"n_u": n, "n_v": n} for n in (5000.0, 550.0, 87.0, 20.0, 6.0, 1.1))


@dataclasses.dataclass(frozen=True)
class Model:
    """A graph, the parameters it reads, and where it comes from. Prints as its equation.

    Parameters
    ----------
    name : str
        In files and in :func:`get`.
    graph : Node
    parameters : tuple of Parameter
    source : str
        Literature.
    starts : tuple of dict
        Where an analytic fit starts from, each what differs from the initial values; by default six roughnesses.
    lobes : callable
        ``lobes(params) -> [(rho_s, alpha_x, alpha_y), ...]``: GGX lobes that cover the model's own, for sampling.
    v_cavity : bool
        True if the model masks with V-cavities: visible normals are then drawn with theirs instead of Smith's.
    terms : dict of str to str
        Slots that hold another analytic term than the model's own, see :mod:`mi_enhance.alternatives`.
    extra : tuple of str
        Names of the parameters that those terms brought; networks do not read them.
    text : str
        What a model of :func:`from_expression` was read from; files keep it.

    Examples
    --------
    >>> print(ggx())
    M + S * D * F * G * 1/E
    >>> len(ggx().graph.slots)
    11
    """

    name: str
    graph: Node
    parameters: tuple[p.Parameter, ...]
    source: str
    starts: tuple[dict[str, float], ...] = _ROUGHNESSES
    lobes: Callable[[Mapping], list[tuple]] = lobes_of_alpha
    v_cavity: bool = False
    terms: Mapping[str, str] = dataclasses.field(default_factory=dict)
    extra: tuple[str, ...] = ()
    text: str = dataclasses.field(default="", repr=False)

    def __str__(self) -> str:
        return str(self.graph)


def ggx() -> Model:
    """Anisotropic Cook-Torrance with the GGX distribution: 12 parameters, 6 terms, 5 operators.

    The product associates to the right, ``M + S * (D * (F * (G * 1/E)))``: D, which reaches 1e6, stays outside of every
    operator module, and everything right of S is a scalar.

    Returns
    -------
    Model

    References
    ----------
    Walter et al. 2007, eq. (20); the paper's input model, section 7.
    """
    m, s = Node("M", terms.M_lambert), Node("S", terms.S_constant)
    d, f, g = Node("D", terms.D_ggx), Node("F", terms.F_schlick), Node("G", terms.G_smith_ggx)
    return Model(
        name="ggx",
        graph=m + s * (d * (f * (g * Node("1/E", terms.inv_E)))),
        parameters=(p.N_X, p.N_Y, p.T_THETA, p.RHO_D, p.RHO_S, p.ALPHA_X, p.ALPHA_Y, p.F0),
        source="Walter et al. 2007",
    )


def cook_torrance() -> Model:
    r"""Cook and Torrance's model: Beckmann's distribution, V-cavities and the exact Fresnel reflectance; 12 parameters.

    .. math::
        f = \frac{\rho_d}{\pi} + \rho_s \frac{D F G}{\pi \cos\theta_i \cos\theta_o}

    The 1/pi is the original's, kept so that published values of rho_s can be used. With D normalised as it is here the
    lobe reflects up to 4 rho_s / pi: rho_s = pi / 4 is what rho_s = 1 is to ``ggx``. Anisotropy is the usual extension
    of D (the original is isotropic).

    Returns
    -------
    Model

    References
    ----------
    Cook and Torrance 1982, *A Reflectance Model for Computer Graphics*.

    Examples
    --------
    >>> print(cook_torrance())
    M + S * D * F * G * 1/E
    """
    m, s, d = Node("M", terms.M_lambert), Node("S", terms.S_constant), Node("D", terms.D_beckmann)
    f, g = Node("F", terms.F_cook_torrance), Node("G", terms.G_v_cavity)
    return Model(
        name="cook_torrance",
        graph=m + s * (d * (f * (g * Node("1/E", terms.inv_E_pi)))),
        parameters=(p.N_X, p.N_Y, p.T_THETA, p.RHO_D, p.RHO_S, p.ALPHA_X, p.ALPHA_Y, p.F0),
        source="Cook and Torrance 1982",
        starts=_COOK_TORRANCE_STARTS,
        v_cavity=True,
    )


def ward() -> Model:
    r"""Ward's anisotropic model, neither Fresnel nor shadowing; 11 parameters.

    .. math::
        f = \frac{\rho_d}{\pi} + \rho_s \frac{1}{\sqrt{\cos\theta_i \cos\theta_o}}
            \frac{\exp(-(h_x^2/\alpha_x^2 + h_y^2/\alpha_y^2) / h_z^2)}{4 \pi \alpha_x \alpha_y}

    The original normalisation; the albedo of its lobe grows without bound towards grazing angles, as
    1 / sqrt(cos_theta_i).

    Returns
    -------
    Model

    References
    ----------
    Ward 1992, *Measuring and Modeling Anisotropic Reflection*, eq. (5a).

    Examples
    --------
    >>> print(ward())
    M + S * D * 1/E
    """
    m, s, d = Node("M", terms.M_lambert), Node("S", terms.S_constant), Node("D", terms.D_ward)
    return Model(
        name="ward",
        graph=m + s * (d * Node("1/E", terms.inv_E_ward)),
        parameters=(p.N_X, p.N_Y, p.T_THETA, p.RHO_D, p.RHO_S, p.ALPHA_X, p.ALPHA_Y),
        source="Ward 1992",
    )


def abc() -> Model:
    r"""The microfacet ABC model: isotropic, for glossy surfaces with wide tails; 9 parameters.

    .. math::
        f = \frac{\rho_d}{\pi} + A \frac{F G}{\pi \cos\theta_i \cos\theta_o (1 + B (1 - \cos\theta_h))^C}

    A stands in a slot of its own, S, so that what is right of it is a scalar. It is the height of the peak, not an
    albedo: the energy of the lobe changes with B and C. Published values of rho_d, A, B, C and ior can be used as they
    are.

    Returns
    -------
    Model

    References
    ----------
    Low, Kronander, Ynnerman and Unger 2012, *BRDF Models for Accurate and Efficient Rendering of Glossy Surfaces*.

    Examples
    --------
    >>> print(abc(), p.count(abc().parameters))
    M + S * D * F * G * 1/E 9
    """
    m, s, d = Node("M", terms.M_lambert), Node("S", terms.S_abc), Node("D", terms.D_abc)
    f, g = Node("F", terms.F_dielectric), Node("G", terms.G_v_cavity)
    return Model(
        name="abc",
        graph=m + s * (d * (f * (g * Node("1/E", terms.inv_E_pi)))),
        parameters=(p.RHO_D, p.ABC_A, p.ABC_B, p.ABC_C, p.IOR),
        source="Low et al. 2012",
        starts=_ABC_STARTS,
        lobes=lobes_of_abc,
        v_cavity=True,
    )


def ashikhmin_shirley() -> Model:
    r"""Ashikhmin and Shirley's anisotropic Phong model over a diffuse term that leaves room for it; 12 parameters.

    .. math::
        f = \frac{\rho_d}{\pi} B + \rho_s \frac{D F}{4 \cos\theta_d \max(\cos\theta_i, \cos\theta_o)}

    The original has one specular colour R_s, in Schlick's term and, as 1 - R_s, in the diffuse one. Here F0 stands in
    both places and rho_s scales the specular term alone, so that f is linear in the colours: with a grey R_s the
    original is F0 = R_s and rho_s = 1. With another rho_s the two terms together may reflect more or less than 1.
    rho_d is not quite the albedo of the diffuse term, which falls towards grazing angles.

    Returns
    -------
    Model

    References
    ----------
    Ashikhmin and Shirley 2000, *An Anisotropic Phong BRDF Model*.

    Examples
    --------
    >>> print(ashikhmin_shirley())
    M * B + S * D * F * 1/E
    """
    m, b = Node("M", terms.M_lambert), Node("B", terms.B_ashikhmin_shirley)
    s, d, f = Node("S", terms.S_constant), Node("D", terms.D_ashikhmin_shirley), Node("F", terms.F_schlick)
    return Model(
        name="ashikhmin_shirley",
        graph=m * b + s * (d * (f * Node("1/E", terms.inv_E_ashikhmin_shirley))),
        parameters=(p.N_X, p.N_Y, p.T_THETA, p.RHO_D, p.RHO_S, p.N_U, p.N_V, p.F0),
        source="Ashikhmin and Shirley 2000",
        starts=_EXPONENTS,
        lobes=lobes_of_ashikhmin_shirley,
        v_cavity=True,  # towards grazing angles this lobe, too, grows as 1 / cos_theta_i
    )


def ggx2() -> Model:
    """Two GGX lobes over a directional diffuse term: 17 parameters, 12 terms, 11 operators.

    What measured materials show beside one GGX is given nodes of its own: a factor B of the diffuse term (bright edges
    or retro-reflection; 1 for Lambert) and a second lobe with its own colour and roughness (a coat over paint, flakes,
    the wide tail of metals, the white of grazing angles). Three colours with three scalar factors span all of RGB.

    Returns
    -------
    Model

    References
    ----------
    Walter et al. 2007, eq. (20), twice; two lobes: Cook and Torrance 1982, section 2 (weighted sum of distributions).
    """
    m, b = Node("M", terms.M_lambert), Node("B", terms.B_lambert)
    s, d, f, g = (
        Node("S", terms.S_constant),
        Node("D", terms.D_ggx),
        Node("F", terms.F_schlick),
        Node("G", terms.G_smith_ggx),
    )
    s2, d2, f2, g2 = (
        _second("S2", terms.S_constant),
        _second("D2", terms.D_ggx),
        _second("F2", terms.F_schlick),
        _second("G2", terms.G_smith_ggx),
    )
    first = s * (d * (f * (g * Node("1/E", terms.inv_E))))
    second = s2 * (d2 * (f2 * (g2 * _second("1/E2", terms.inv_E))))
    return Model(
        name="ggx2",
        graph=m * b + first + second,
        parameters=(
            *(p.N_X, p.N_Y, p.T_THETA, p.RHO_D, p.RHO_S, p.ALPHA_X, p.ALPHA_Y, p.F0),
            *(p.RHO_S2, p.ALPHA_X2, p.ALPHA_Y2),
        ),
        source="Walter et al. 2007, two lobes",
        starts=_PAIRS,
    )


def _second(name: str, term: Callable) -> Node:
    """A node of the second lobe: `term` with rho_s2, alpha_x2, alpha_y2 in place of the first lobe's parameters."""
    own = {n: f"{n}2" if n in ("rho_s", "alpha_x", "alpha_y") else n for n in inspect.signature(term).parameters}
    return renamed(name, term, own)


def renamed(name: str, term: Callable, own: Mapping[str, str], label: str = "") -> Node:
    """A node whose `term` reads other quantities than its arguments are called after: argument -> quantity."""
    return Node(name, lambda **q: term(**{n: q[o] for n, o in own.items()}), inputs=tuple(own.values()), label=label)


MODELS = {
    "ggx": ggx,
    "ggx2": ggx2,
    "cook_torrance": cook_torrance,
    "ward": ward,
    "abc": abc,
    "ashikhmin_shirley": ashikhmin_shirley,
}


def get(name: str) -> Model:
    """Return the model called `name`, or the one in a file of :func:`from_expression`.

    Parameters
    ----------
    name : str
        ``"ggx"``, or a path that ends in ``.toml``.

    Raises
    ------
    KeyError
        If there is none; the message lists the choices.
    FileNotFoundError, ValueError
        If there is no such file, or it is not a model.

    Examples
    --------
    >>> get("ggx").name
    'ggx'
    """
    return from_expression(Path(name)) if str(name).endswith(".toml") else registered(name)


def registered(name: str) -> Model:
    """Return one of the package's own models by name, as :func:`get`; never a file."""
    if name not in MODELS:
        hint = difflib.get_close_matches(name, MODELS, 1)
        raise KeyError(
            f'models.get(): unknown model "{name}". Choose one of: {", ".join(sorted(MODELS))}, or give a .toml file.'
            + (f' Did you mean "{hint[0]}"?' if hint else "")
        )
    return MODELS[name]()


def from_expression(text: str | Path) -> Model:
    """Make a model from a text in which every term is an expression; see docs/files.md for the format.

    Parameters
    ----------
    text : str or Path
        The text itself, or a ``Path`` to a file that holds it. A text is never taken for a path: texts come out of
        material files, which must not make the package read others.

    Returns
    -------
    Model
        With `text`, so that a material of it can be saved and loaded where the file is not.

    Raises
    ------
    FileNotFoundError, ValueError
        If there is no such file, or the text is not a model; the message says what is wrong and what is allowed.

    Examples
    --------
    >>> blinn_phong = from_expression('''
    ... name = "blinn_phong"
    ... formula = "M + S * D"
    ... [terms]
    ... M = "rho_d / pi"
    ... S = "rho_s"
    ... D = "(n + 2) / (2 * pi) * cos_theta_h ** n"
    ... [parameters]
    ... rho_d = true
    ... rho_s = true
    ... n = { low = 1, high = 1e5, initial = 100, log = true }
    ... [[lobes]]
    ... rho_s = "rho_s"
    ... alpha_x = "sqrt(2 / (n + 2))"
    ... alpha_y = "sqrt(2 / (n + 2))"
    ... ''')
    >>> print(blinn_phong, blinn_phong.graph.slots)
    M + S * D ('M', 'M+S', 'S', 'S*D', 'D')
    """
    where = "from_expression()"
    if isinstance(text, Path):
        where = f'models.get("{text}")'
        try:
            text = require_file(text, where).read_text(encoding="utf-8")
        except UnicodeDecodeError as error:
            raise ValueError(f"{where}: this is not text in UTF-8 ({error}). Save it as one.") from None
    elif str(text).endswith(".toml") and "\n" not in str(text):
        raise ValueError(f'{where}: "{text}" is a path, not a model. Use models.get("{text}"), or give a Path.')
    return Model(**model_file.parse(text, where), text=text)
