"""Materials nobody measured, to train on: kinds of surfaces that measured sets hardly hold, from published optics.

Each kind is a function that draws a `Material`. None has a Ward or Beckmann lobe, nor a Gaussian one under another name
(Ashikhmin and Shirley's power of the cosine): such lobes test how networks generalize, see
:mod:`mi_enhance.data.synthetic`.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from . import optics
from .directions import cosine_hemisphere, sample_pairs, with_peaks
from .lobe_material import BRDF, Lobe, Material, Reflectance
from .measurements import Measurements
from .random_terms import half_vectors

_ALBEDO_ANGLES = np.radians((10, 60))


def material(kind: str, seed: int) -> Material:
    """Draw a material of one of `KINDS`, scaled down where it would reflect more light than there is.

    Examples
    --------
    >>> bool(material("cloth", 1).albedo(0.2).max() <= 1)
    True
    """
    return _drawn(kind, np.random.default_rng(seed))


def measured(kind: str, seed: int, n_samples: int = 100_000, peaks: float = 0.0) -> Measurements:
    """Draw a material of one of `KINDS` and measure it.

    Parameters
    ----------
    kind : str
    seed : int
        Decides material and directions.
    n_samples : int
    peaks : float
        Share of the samples in the sharpest highlight, see :func:`mi_enhance.data.directions.with_peaks`.

    Returns
    -------
    Measurements
        Reciprocal, without noise; albedo at 10 and 60 degrees at most 1. A peak of roughness 0.003 is above 1e4.

    Examples
    --------
    >>> measured("near-mirror", 1, n_samples=10).name
    'near-mirror_1'
    """
    rng = np.random.default_rng(seed)
    drawn = _drawn(kind, rng)
    wi, wo = sample_pairs(n_samples, seed=rng)
    if drawn.lobes:
        sharpest, _ = drawn.lobes[0]
        wi, wo = with_peaks(wi, wo, peaks, rng, alpha=(sharpest.alpha_x, sharpest.alpha_y), axes=sharpest.axes)
    else:
        wi, wo = with_peaks(wi, wo, peaks, rng)
    f = drawn(*(w.astype(np.float64) for w in (wi, wo)))
    return Measurements(wi, wo, f, f"{kind}_{seed}", "synthetic")


def _drawn(kind: str, rng: np.random.Generator) -> Material:
    drawn = KINDS[kind](rng)
    brightest = max(drawn.albedo(theta).max() for theta in _ALBEDO_ANGLES)
    share = rng.uniform(0.7, 1)
    return drawn if brightest <= 1 else Material(drawn.lobes, drawn.base, share / brightest)


# --- the kinds --------------------------------------------------------------------------------------------------------


def _thin_film(rng: np.random.Generator) -> Material:
    """Iridescent: an interference film on a metal or dielectric; half of them with flakes that have another film."""
    sharp = _isotropic(rng, 0.03, 0.5)
    lobes = [(sharp, _film(rng))]
    if rng.random() < 0.5:
        wide = _rougher(rng, sharp)
        lobes.append((wide, _times(rng.uniform(0.2, 1), _film(rng))))
    return Material(tuple(lobes), _diffuse(_colour(rng)))


def _coated(rng: np.random.Generator) -> Material:
    """A sharp clear coat over a coloured base, seen through it both ways, and often through a tint.

    Weidlich and Wilkie 2007, *Arbitrarily Layered Micro-Facet Surfaces*. The base gets 1 / eta^2 of the
    radiance, as solid angles shrink by refraction, which they leave out; a diffuse base also gets back what the coat
    reflects inside (Saunderson 1942, *Calculation of the Color of Pigmented Plastics*).
    """
    eta = rng.uniform(1.3, 1.8)
    colour, outer = _colour(rng), optics.dielectric(cosine_hemisphere(512)[:, 2], eta).mean()
    base: BRDF = _diffuse(colour / (1 - colour * (1 - (1 - outer) / eta**2)))
    if rng.random() < 0.5:
        base = Material(((_isotropic(rng, 0.08, 0.6), _metal(rng)),), _diffuse(0.2 * _colour(rng)))
    depth = -np.log(rng.uniform(0.2, 1, 3)) / 2 if rng.random() < 0.5 else np.zeros(3)

    def below(i: np.ndarray, o: np.ndarray) -> np.ndarray:
        passed, path, inside = np.full(len(i), 1 / eta**2), np.zeros(len(i)), []
        for w in (i, o):
            passed = passed * (1 - optics.dielectric(w[:, 2], eta))
            cos = np.sqrt(1 - (1 - np.minimum(w[:, 2], 1) ** 2) / eta**2)
            path = path + 1 / cos
            inside.append(np.stack([w[:, 0] / eta, w[:, 1] / eta, cos], 1))
        return base(*inside) * passed[:, None] * np.exp(-depth * path[:, None])

    return Material(((_isotropic(rng, 0.003, 0.1), _grey(lambda cos: optics.dielectric(cos, eta))),), below)


def _near_mirror(rng: np.random.Generator) -> Material:
    """A polished metal, often with some haze (a wider lobe) or a faint diffuse rest."""
    sharp = _isotropic(rng, 0.003, 0.03, _tail(rng))
    colour = _metal(rng)
    haze = rng.uniform(0.01, 0.25) if rng.random() < 0.6 else 0.0
    lobes = [(sharp, _times(1 - haze, colour))]
    if haze:
        lobes.append((_rougher(rng, sharp), _times(haze, colour)))
    faint = rng.uniform(0, 0.08) if rng.random() < 0.7 else 0.001
    return Material(tuple(lobes), _diffuse(faint * _colour(rng)))


def _cloth(rng: np.random.Generator) -> Material:
    """Fibres that stand up, over a diffuse base of another colour.

    Estevez and Kulla 2017, *Production Friendly Microfacet Sheen BRDF* ("Charlie"), or Ashikhmin and Premoze
    2007, *Distribution-based BRDFs*, inverted Gaussian for velvet; both over 4 (cos_i + cos_o - cos_i cos_o).
    """
    alpha, charlie = np.exp(rng.uniform(*np.log((0.1, 1)))), rng.random() < 0.5
    base, sheen = _colour(rng), _colour(rng) * rng.uniform(0.2, 2)

    def brdf(i: np.ndarray, o: np.ndarray) -> np.ndarray:
        h, _ = half_vectors(i, o)
        cos2 = np.minimum(h[:, 2] ** 2, 1)
        sin2 = np.maximum(1 - cos2, 1e-6)  # the inverted Gaussian is 0 there, but 0 / 0
        if charlie:
            D = (2 + 1 / alpha) * sin2 ** (0.5 / alpha) / (2 * np.pi)
        else:
            D = (1 + 4 * np.exp(-cos2 / sin2 / alpha**2) / sin2**2) / (np.pi * (1 + 4 * alpha**2))
        covered = 4 * (i[:, 2] + o[:, 2] - i[:, 2] * o[:, 2])
        return base / np.pi + sheen * (D / covered)[:, None]

    return Material((), brdf)


def _retro(rng: np.random.Generator) -> Material:
    """Light goes back where it came from, beside a highlight and a diffuse base."""
    highlight = _isotropic(rng, 0.03, 0.5)
    width = np.exp(rng.uniform(*np.log((0.05, 0.5))))
    back = Lobe(width, width, back=True, **_tail(rng))
    weight = np.exp(rng.uniform(*np.log((0.05, 0.8))))
    return Material(
        ((highlight, _metal(rng) if rng.random() < 0.3 else _varnish(rng)), (back, _times(weight, _metal(rng)))),
        _diffuse(_colour(rng)),
    )


def _anisotropic(rng: np.random.Generator) -> Material:
    """Brushed: one or two lobes, up to 20 times as rough along one axis, on one frame or on two."""
    turns = rng.uniform(0, np.pi, 2)
    if rng.random() < 0.6:
        turns[1] = turns[0]
    alpha = np.exp(rng.uniform(*np.log((0.02, 0.2))))
    lobes = []
    for k in range(rng.integers(1, 3)):
        ratio = np.sqrt(np.exp(rng.uniform(*np.log((1.5, 20)))))
        # 1: the roughest there is; 0.003: as a near-mirror
        lobe = Lobe(min(alpha * ratio, 1.0), max(alpha / ratio, 0.003), turns[k], **_tail(rng))
        lobes.append((lobe, _times(rng.uniform(0.3, 1), _metal(rng) if rng.random() < 0.7 else _varnish(rng))))
        alpha = min(alpha * rng.uniform(1.5, 6), 0.5)
    return Material(tuple(lobes), _diffuse(_colour(rng) * rng.uniform(0, 1)))


KINDS: dict[str, Callable[[np.random.Generator], Material]] = {
    "thin-film": _thin_film,
    "coated": _coated,
    "near-mirror": _near_mirror,
    "cloth": _cloth,
    "retro": _retro,
    "anisotropic": _anisotropic,
}


# --- what they are made of --------------------------------------------------------------------------------------------


def _isotropic(rng: np.random.Generator, low: float, high: float, tail: dict | None = None) -> Lobe:
    alpha = np.exp(rng.uniform(*np.log((low, high))))
    return Lobe(alpha, alpha, **(tail or {}))


def _rougher(rng: np.random.Generator, lobe: Lobe) -> Lobe:
    alpha = min(lobe.alpha_x * np.exp(rng.uniform(*np.log((2, 12)))), 0.8)
    return Lobe(alpha, alpha)


def _tail(rng: np.random.Generator) -> dict:
    """Return a distribution: GGX, GTR or Student's t, a third of each."""
    tail, kind = rng.uniform(1.4, 3.5), rng.integers(3)
    return {} if kind == 0 else {"tail": tail, "slopes": bool(kind == 1)}


def _colour(rng: np.random.Generator) -> np.ndarray:
    """Return an albedo (3,), dark ones and saturated ones among them."""
    return rng.uniform(0, 1, 3) ** rng.uniform(0.3, 2) * rng.uniform(0, 1)


def _diffuse(colour: np.ndarray) -> BRDF:
    return lambda i, o: np.broadcast_to(colour / np.pi, (len(i), 3))


def _metal(rng: np.random.Generator) -> Reflectance:
    """Return a coloured metal's reflectance: from an index, or by Schlick's formula with Lazanyi's term."""
    F0 = np.clip(rng.uniform(0.3, 0.99) * rng.uniform(0.3, 1, 3) ** rng.uniform(0, 1), 0.05, 0.98)
    edge = rng.uniform(0, 1, 3)
    if rng.random() < 0.5:
        index = optics.metal_index(F0, edge)
        return optics.tabulated(lambda cos: optics.conductor(cos[:, None], *index))
    return lambda cos: optics.lazanyi(cos[:, None], F0, 1 - 0.4 * edge)


def _varnish(rng: np.random.Generator) -> Reflectance:
    eta = rng.uniform(1.3, 1.8)
    return _grey(lambda cos: optics.dielectric(cos, eta))


def _film(rng: np.random.Generator) -> Reflectance:
    base: complex | np.ndarray = complex(rng.uniform(1.3, 2.6))
    if rng.random() < 0.6:
        eta, k = optics.metal_index(np.full(3, rng.uniform(0.3, 0.95)), np.full(3, rng.uniform(0, 1)))
        base = eta + 1j * k
    thickness, film = rng.uniform(100, 800), rng.uniform(1.2, 2.4)
    return optics.tabulated(lambda cos: optics.thin_film(cos, thickness, film, base))


def _grey(reflectance: Reflectance) -> Reflectance:
    return lambda cos: reflectance(cos)[:, None]


def _times(weight: float, reflectance: Reflectance) -> Reflectance:
    return lambda cos: weight * reflectance(cos)
