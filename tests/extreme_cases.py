"""Materials and pairs of directions at the edge of what is allowed, and how far the float32 kernels are from the twin.

A case draws directions and parameters on the device, so that millions cost as little as thousands; what the twin is
asked are the same float32 numbers.
"""

from __future__ import annotations

import dataclasses
import math

import drjit as dr
import lanes
import mitsuba as mi
import numpy as np
import twin
import twin_networks

from mi_enhance import models
from mi_enhance.analytic import geometry, parameters
from mi_enhance.material.material import Material
from mi_enhance.neural.enhance import enhance
from mi_enhance.neural.mlp import flatten, unflatten
from mi_enhance.system.bundled_files import network_file

DARK = 1e-6  # 1/sr: errors count relative to f, or to this where f is darker
FLAT = 1e-5  # the same for derivatives of the loss: that of a network in front of a black colour is next to nothing
ULP = 2.0**-24  # half a unit in the last place of numbers in [0.5, 1]: what float32 directions are known to

# Name of a parameter -> its range in a case; everything else is drawn from all that is allowed.
_WIDE = {f"alpha_{k}": (0.05, 1) for k in ("x", "y", "x2", "y2")} | {"n_u": (1, 500), "n_v": (1, 500), "B": (1, 1e3)}
_SHARP = {f"alpha_{k}": (1e-4, 1e-2) for k in ("x", "y", "x2", "y2")} | {"n_u": (1e4, 1e6), "n_v": (1e4, 1e6)}
_TURNED = {"n_x": (0, 0), "n_y": (0, 0)}
_USUAL_LATENT = {"latent": (0, 1), "norm": (-1, 1), "read": (-0.1, 0.1)}


@dataclasses.dataclass(frozen=True)
class Case:
    """Directions by name of a function below, ranges of parameters, and those that take their bounds only."""

    directions: str
    ranges: dict
    corners: tuple[str, ...] = ()


CASES = {
    "usual": Case("anywhere", _WIDE | _USUAL_LATENT),
    "near mirror": Case("lobe", _SHARP | _TURNED | _USUAL_LATENT),
    "near mirror, tilted": Case("lobe", _SHARP | _USUAL_LATENT),
    "alpha 1e-4 against 1": Case(
        "lobe", _TURNED | _USUAL_LATENT | {"alpha_x": (1e-4, 1e-4), "alpha_y": (1, 1), "n_u": (1e6, 1e6), "n_v": (1, 1)}
    ),
    "cosines 1e-6 to 1e-2": Case("grazing", _WIDE | _TURNED | _USUAL_LATENT),
    "wi = wo": Case("equal", _USUAL_LATENT),
    "wi = -wo": Case("opposite", _USUAL_LATENT),
    "h on the horizon": Case("side by side", _TURNED | _USUAL_LATENT),
    "F0 and albedos 0 and 1": Case("anywhere", _WIDE | _USUAL_LATENT, ("F0", "rho_d", "rho_s", "rho_s2", "ior", "A")),
    "albedos 1e-30 and 10": Case("lobe", _TURNED | _USUAL_LATENT | {"rho_d": (1e-30, 1e-30), "rho_s": (10, 10)}),
    "normal at its bound": Case("anywhere", _WIDE | _USUAL_LATENT, ("n_x", "n_y")),
    "latent far outside": Case("anywhere", _WIDE | {"norm": (-20, 20), "read": (-0.1, 0.1)}, ("latent",)),
    "all at their bounds": Case("lobe", {}, ("all",)),
}


class Random:
    """Independent numbers in [0, 1) for n lanes, one array after the other."""

    def __init__(self, n: int, seed: int):
        self._generator = mi.PCG32(n, seed)

    def __call__(self) -> mi.Float:
        return self._generator.next_float32()


def draw_parameters(case: Case, brdf, random: Random) -> dict:
    """One material per lane, as an EnhancedBRDF takes them."""
    result = []
    for q in brdf.parameters:
        low, high = case.ranges.get(q.name, case.ranges.get(q.name.split("_")[0], (q.low, q.high)))
        bounds_only = q.name in case.corners or "all" in case.corners
        for _ in range(q.size):
            u = random()
            u = dr.select(u < 0.5, mi.Float(0), mi.Float(1)) if bounds_only else u
            if low == high:
                v = mi.Float(low) + 0 * u
            elif q.log:
                v = dr.clip(dr.exp(math.log(low) + u * math.log(high / low)), low, high)
            else:
                v = low + u * (high - low)
            result.append(v)
    return parameters.unflatten(brdf.parameters, result)


def draw_directions(case: Case, brdf, params: dict, random: Random) -> tuple[mi.Vector3f, mi.Vector3f]:
    """wi, wo in the frame of the surface."""

    def at(cos, phi):
        sin = dr.safe_sqrt(1 - cos * cos)
        return mi.Vector3f(sin * dr.cos(phi), sin * dr.sin(phi), cos)

    phi = dr.two_pi * random()
    wi = at(1 - random(), phi)
    if case.directions == "anywhere":
        return wi, at(1 - random(), dr.two_pi * random())
    if case.directions == "grazing":
        cos = [dr.exp(math.log(1e-6) + random() * math.log(1e4)) for _ in "io"]
        return at(cos[0], phi), at(cos[1], dr.two_pi * random())
    if case.directions == "equal":
        return wi, mi.Vector3f(wi)
    if case.directions == "opposite":  # as opposite as two directions above the horizon can be; every 16th exactly
        wi = at(dr.exp(math.log(1e-7) + random() * math.log(1e6)), phi)
        return wi, dr.select(random() < 1 / 16, -wi, mi.Vector3f(-wi.x, -wi.y, wi.z))
    if case.directions == "side by side":
        cos = [dr.exp(math.log(1e-7) + random() * math.log(1e4)) for _ in "io"]
        return at(cos[0], phi), at(cos[1], phi + 1e-3 * (random() - 0.5))
    # half vectors of the (last) lobe, mirrored in the material's frame
    _, a_x, a_y = brdf.model.lobes(params)[-1]
    u = random()
    r, angle = dr.sqrt(u / (1 - dr.minimum(u, 1 - 1e-6))), dr.two_pi * random()
    h = dr.normalize(mi.Vector3f(a_x * r * dr.cos(angle), a_y * r * dr.sin(angle), 1))
    frame = geometry.frame_of(params)
    return frame.to_world(wi), frame.to_world(dr.normalize(2 * dr.dot(wi, h) * h - wi))


def draw(case: Case, brdf, n: int, seed: int) -> tuple:
    """wi, wo and parameters of n lanes."""
    random = Random(n, seed)
    params = draw_parameters(case, brdf, random)
    return (*draw_directions(case, brdf, params, random), params)


# --- materials --------------------------------------------------------------------------------------------------------


def materials() -> dict[str, Material]:
    """Every analytic model, every network of the package, one of random weights whose networks see only what their term
    sees, and one whose five factors all reach their limits.
    """
    result = {name: Material.analytic(name) for name in sorted(models.MODELS)}
    result |= {f"[{path.stem}]": Material.load(path) for path in sorted(network_file("ggx").parent.glob("*.bsdf"))}
    own = enhance("ggx2", ("B", "D", "F", "G", "G2"), inputs="own", modulated=True, n_latent=6, seed=2)
    result["own features, random"] = Material(own, {})
    brdf = enhance("ggx", ("S", "D", "F", "G", "1/E"), inputs="shape", seed=1)
    steep = unflatten(brdf.modules, 30 * flatten(brdf.modules))
    return result | {"[S] [D] [F] [G] [1/E] saturated": Material(dataclasses.replace(brdf, modules=steep), {})}


# --- kernels ----------------------------------------------------------------------------------------------------------


def gradients(brdf, evaluators, wi, wo, params) -> tuple[mi.Color3f, dict]:
    """f, and the derivatives of sum_c (c + 1) log(1 + f_c cos_theta_o), the measure of the loss."""
    dr.enable_grad(params)
    f = brdf(wi, wo, params, evaluators)
    cos = dr.maximum(wo.z, 0)
    dr.backward(sum((k + 1) * dr.log(1 + c * cos) for k, c in enumerate(f)))
    result = {name: dr.grad(v) for name, v in params.items()}
    dr.disable_grad(params)
    return dr.detach(f), result


def n_bad(f: mi.Color3f, gradients: dict) -> mi.UInt32:
    """Lanes in which f is negative, or f or a derivative not finite."""
    bad = mi.Mask(False)
    for c in f:
        bad |= ~dr.isfinite(c) | (c < 0)
    for v in gradients.values():
        for c in [v] if isinstance(v, mi.Float) else v:
            bad |= ~dr.isfinite(c)
    return dr.count(bad)


# --- the twin ---------------------------------------------------------------------------------------------------------


def twin_of(material: Material):
    """``f(wi, wo, params)`` in float64 of a material's BRDF."""
    brdf = material.brdf
    if not brdf.networks:
        return lambda wi, wo, p: twin.analytic(brdf.model.name, wi, wo, p)
    if brdf.inputs in ("shape", "reciprocal", "own"):
        return lambda wi, wo, p: twin_networks.brdf(brdf.model.name, wi, wo, p, brdf.modules, brdf.inputs, brdf.trunk)
    layers = {slot: mlp.layers for slot, mlp in brdf.modules.items()}
    return lambda wi, wo, p: twin.brdf(wi, wo, p, layers, brdf.inputs)


def columns(params: dict, n: int) -> dict:
    """Lanes as float64 arrays (n, size)."""
    return {
        name: np.stack([np.resize(np.array(c, np.float64), n) for c in ([v] if isinstance(v, mi.Float) else v)], -1)
        for name, v in params.items()
    }


def sensitivity(f, wi, wo, p, expected, brdf, rng, tries=4) -> np.ndarray:
    """Relative change of f, (n,), when directions and parameters are off by half a unit in the last place."""
    worst = np.zeros(len(wi))
    for _ in range(tries):
        nudged = [w + rng.choice([-ULP, ULP], w.shape) for w in (wi, wo)]
        q = {}
        for parameter in brdf.parameters:
            v = p[parameter.name]
            q[parameter.name] = np.clip(v * (1 + rng.choice([-ULP, ULP], v.shape)), parameter.low, parameter.high)
        change = np.abs(f(*nudged, q) - expected) / np.maximum(np.abs(expected), DARK)
        worst = np.maximum(worst, change.max(1))
    return worst


def twin_gradients(f, wi, wo, p, brdf) -> tuple[dict, np.ndarray]:
    """Derivatives as of :func:`gradients` by central differences, and the lanes where two steps agree on all of them.

    Where they do not, the step crosses a kink of a leaky ReLU, the edge of G or a horizon.
    """
    cos = np.maximum(wo[:, 2:], 0)
    loss = lambda q: np.log1p(f(wi, wo, q) * cos) @ [1.0, 2.0, 3.0]  # noqa: E731
    # a turn of the frame by a share of the roughness moves a lobe by that share of its width
    width = np.min([v[:, 0] for k, v in p.items() if k.startswith("alpha")] or [np.full(len(wi), 0.01)], axis=0)
    # and must not tilt a direction that grazes below the horizon, nor near it: a thousandth of its cosine is little
    width = np.minimum(width, 30 * np.minimum(np.abs(wi[:, 2]), np.abs(wo[:, 2])))
    result, smooth = {}, np.ones(len(wi), bool)
    for q in brdf.parameters:
        scale = width if q.name in parameters.FRAME else np.maximum(np.abs(p[q.name]).max(1), 1e-3)
        columns = []
        for k in range(q.size):
            slopes = []
            for step in (3e-5 * scale, 1e-5 * scale):
                sides = []
                for sign in (1, -1):
                    moved = p[q.name].copy()  # one-sided at a bound
                    moved[:, k] = np.clip(moved[:, k] + sign * step, np.float32(q.low), np.float32(q.high))
                    sides.append((loss({**p, q.name: moved}), moved[:, k]))
                slopes.append((sides[0][0] - sides[1][0]) / (sides[0][1] - sides[1][1]))
            smooth &= np.abs(slopes[0] - slopes[1]) <= 1e-4 * np.abs(slopes[0]) + 1e-7 / scale
            columns.append(slopes[0])
        result[q.name] = np.stack(columns, -1)
    return result, smooth


@dataclasses.dataclass(frozen=True)
class Errors:
    """Relative errors of a kernel, lane by lane."""

    value: np.ndarray  # of f, the largest of its channels
    rounding: np.ndarray  # what half a unit in the last place of directions and parameters changes, as `value`
    gradient: np.ndarray  # of every derivative, relative to itself or its mean; lanes that are smooth only


def errors(material: Material, case: Case, n: int, n_gradients: int, seed: int) -> Errors:
    """Compare n values, and the derivatives of the first `n_gradients` of them, with the twin."""
    brdf, f, evaluators = material.brdf, twin_of(material), lanes.fused(material.brdf.networks)
    wi, wo, params = draw(case, brdf, n, seed)
    dr.eval(wi, wo, params)
    got, slopes = gradients(brdf, evaluators, wi, wo, params)
    dr.eval(got, slopes)
    wi, wo, p, slopes = np.array(wi, np.float64).T, np.array(wo, np.float64).T, columns(params, n), columns(slopes, n)
    with np.errstate(all="ignore"):
        expected = f(wi, wo, p)
        size = np.maximum(np.abs(expected).max(1), DARK)
        value = np.abs(np.array(got, np.float64).T - expected).max(1) / size
        rounding = sensitivity(f, wi, wo, p, expected, brdf, np.random.default_rng(seed))
        few = slice(n_gradients)
        exact, smooth = twin_gradients(f, wi[few], wo[few], {name: v[few] for name, v in p.items()}, brdf)
    gradient = []
    for name, v in exact.items():
        size = np.abs(v) + np.abs(v[smooth]).mean(0)
        gradient.append((np.abs(slopes[name][few] - v) / (size + FLAT))[smooth].max(1))
    return Errors(value, rounding, np.max(gradient, 0))
