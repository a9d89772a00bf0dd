"""What photographs tell about each number of a fit, and what they leave open."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import drjit as dr
import numpy as np

from ..analytic.parameter_space import Space
from ..analytic.parameters import Parameter, components
from ..fitting.uncertainty import OPEN, posterior
from ..material.material import Material
from ..system.progress import Callback, Progress, silent
from .descent import Descent
from .material_prior import MaterialPrior
from .scene_materials import SceneMaterial
from .targets import Target

# Renders that are compared have the same random numbers; with a quarter of the paths what is told differs tenfold.
_SPP, _SEEDS = 64, 2
_MEANT = 8  # renders whose mean tells how far the fit is from the photographs: their noise is no part of that
_STEP, _LARGEST_STEP = 0.1, 0.1  # of a number: so much of its spread, and no more where its logarithm moves
_MOST = 128  # numbers of one unknown: more are the texels of a map
TOLD = 0.1  # of its spread without photographs: a number that is known better than that is told
_CELLS = 24  # of half and difference angle


@dataclasses.dataclass(frozen=True, eq=False)
class Uncertainty:
    """What photographs tell about the numbers that were fitted to them.

    Parameters
    ----------
    names : list of str
        ``"rho_d.R"``, ``"latent.07"``; with the material in front where there are several.
    std : array (P,)
        Standard deviations, in the unit of the parameter.
    share : array (P,)
        The same over those without photographs: near 0 a number is known, at 1 nothing is told.
    reflectance : dict of str to array (24, 24)
        By material: standard deviation of the logarithm of the reflectance over half angle (rows) and difference angle
        (columns), both from 0 to 90 degrees.
    """

    names: list[str]
    std: np.ndarray
    share: np.ndarray
    reflectance: dict[str, np.ndarray]

    def report(self) -> dict:
        """Return it as JSON types."""
        numbers = zip(self.names, self.std.tolist(), self.share.tolist(), strict=True)
        return {"words": self.words(), "numbers": {name: {"std": s, "share": r} for name, s, r in numbers}}

    def groups(self) -> dict[str, np.ndarray]:
        """Return the indices of the numbers of each parameter, by its name."""
        result: dict[str, list[int]] = {}
        for k, name in enumerate(self.names):
            head, _, tail = name.rpartition(".")
            result.setdefault(head if head and (tail in "RGB" or tail.isdigit()) else name, []).append(k)
        return {name: np.array(index) for name, index in result.items()}

    def words(self) -> str:
        """Return it as a sentence or three.

        Examples
        --------
        >>> share = np.array([0.01, 0.3, 0.9])
        >>> Uncertainty(["F0", "alpha_x", "rho_s2"], 0.1 * share, share, {}).words()
        'Told by the photographs: F0 (0.001). Roughly: alpha_x (0.03). Left open: rho_s2.'
        """
        said: dict[str, list[str]] = {"Told by the photographs": [], "Roughly": [], "Left open": []}
        limits = dict(zip(said, ((-1, TOLD), (TOLD, OPEN), (OPEN, np.inf)), strict=True))
        for name, index in self.groups().items():
            for key, (low, high) in limits.items():
                n = int(((self.share[index] > low) & (self.share[index] <= high)).sum())
                one = len(index) <= 3  # a number or a colour, which counts as its worst channel
                if one and low < self.share[index].max() <= high:
                    said[key].append(f"{name} ({self.std[index].max():.2g})" if high < np.inf else name)
                elif n and not one:
                    said[key].append(f"{n} of {len(index)} numbers of {name}")
        return " ".join(f"{key}: {', '.join(names)}." for key, names in said.items() if names)


@dataclasses.dataclass(frozen=True)
class _Number:
    key: str
    index: int  # in the unknown
    parameter: Parameter
    name: str

    @property
    def space(self) -> Space:
        """Where it moves: its logarithm if the parameter asks for that."""
        return Space([dataclasses.replace(self.parameter, size=1, fixed=False)])


def of_fit(
    descent: Descent,
    placed: Mapping[str, SceneMaterial],
    prior: MaterialPrior,
    target: Target,
    seed: int,
    progress: Callback = silent,
) -> Uncertainty | None:
    r"""Return what photographs tell about the numbers of a fit, as it is; None where maps are all that is sought.

    Each number is moved a little, and some pixels of all photographs are rendered again: :math:`J`. As for measurements
    (:mod:`mi_enhance.fitting.uncertainty`), residuals are taken for independent, with a Laplace distribution of the
    mean size b they have, and the inverse covariance of the prior is added to :math:`J^T J / b^2`. J of two sets of
    random numbers are multiplied, so that noise counts as no information. Errors of model, shape and light are not
    independent: take the numbers for lower bounds, and for a ranking.

    Parameters
    ----------
    descent : Descent
        At its end.
    placed : dict of str to SceneMaterial
    prior : MaterialPrior
        What is known without photographs, besides the range of each number.
    target : Target
        Some pixels of all photographs.
    seed : int
    progress : callable, optional
        Told of every number.
    """
    numbers = _numbers(descent, placed)
    if not numbers:
        return None
    values = descent.values()
    # a number anywhere in its range
    spread = np.array([float(n.space.high[0] - n.space.low[0]) for n in numbers]) / np.sqrt(12)
    before = np.diag(1 / spread**2) + prior.precision([n.key for n in numbers], [n.index for n in numbers])
    sigma = np.sqrt(np.diag(np.linalg.inv(before)))
    seeds = range(seed, seed + _SEEDS)
    scale = descent.measure.scale
    logs = lambda images: [np.log1p(np.maximum(image, 0) / scale) for image in images]  # noqa: E731
    images = descent.renders(target, _SPP, range(seed, seed + _MEANT))
    base, (mean, truth) = logs(images[:_SEEDS]), logs([np.mean(images, 0), target.image])
    counts = (target.weight > 0) & ~(target.saturated & (mean >= truth))
    moved = [_moved(n, values, s) for n, s in zip(numbers, sigma, strict=True)]
    slopes = np.empty((_SEEDS, len(numbers), int(counts.sum())), np.float32)
    for k, (number, (value, step)) in enumerate(zip(numbers, moved, strict=True)):
        seen = logs(descent.renders(target, _SPP, seeds, instead={number.key: value}))
        with np.errstate(invalid="ignore"):  # infinite in both
            parts = [np.nan_to_num((a - b)[counts] / step, posinf=0, neginf=0) for a, b in zip(seen, base, strict=True)]
        slopes[:, k] = parts
        progress(Progress("what the photographs tell", k + 1, len(numbers)))
    told = _told(slopes)
    residual = float(np.abs(mean - truth)[counts].mean()) if counts.any() else 0.0
    covariance = posterior(told, residual, before)
    std = np.sqrt(np.diag(covariance))
    slope = [n.space.slope(n.space.to_free(values[n.key][n.index : n.index + 1]))[0] for n in numbers]
    maps = {}
    for name, one in placed.items():
        mine = [k for k, n in enumerate(numbers) if n.key in one.keys.values()]
        if mine and not one.is_textured:
            part = covariance[np.ix_(mine, mine)]
            maps[name] = _of_reflectance(one, one.read(descent.params), [(numbers[k], *moved[k]) for k in mine], part)
    return Uncertainty([n.name for n in numbers], std * np.array(slope), np.minimum(std / sigma, 1), maps)


def _told(slopes: np.ndarray) -> np.ndarray:
    """Return J^T J, positive semidefinite, of two J (2, P, pixels) with noise of their own: where only noise is, 0.

    A number without effect has noise for a slope. Scaled by the size of that, not by what both J agree on, its products
    with others are as small as they should be, and take nothing from what those are told.

    Examples
    --------
    >>> _told(np.array([[[1, 2], [2e-3, -1e-3]], [[1, 2], [0, 0]]])).round(4)
    array([[5., 0.],
           [0., 0.]])
    """
    product = np.matmul(slopes[0], slopes[1].T, dtype=np.float64)
    size = np.sqrt(np.square(slopes, dtype=np.float64).sum(2).mean(0))
    size = np.where(size > 0, size, 1)
    values, vectors = np.linalg.eigh((product + product.T) / 2 / np.outer(size, size))
    return vectors * np.maximum(values, 0) @ vectors.T * np.outer(size, size)


def _numbers(descent: Descent, placed: Mapping[str, SceneMaterial]) -> list[_Number]:
    result = []
    for u in descent.unknowns:
        size = descent.values()[u.key].size
        if dr.is_tensor_v(descent.params[u.key]) or size > _MOST:
            continue
        owner = next((f"{name}." for name, one in placed.items() if u.key in one.keys.values()), "")
        p = dataclasses.replace(u.parameter, size=size)
        colour = p.is_colour or (size == 3 and p.kind != "latent")
        names = components(dataclasses.replace(p, kind="colour" if colour else p.kind))
        result += [_Number(u.key, k, p, f"{owner if len(placed) > 1 else ''}{n}") for k, n in enumerate(names)]
    return result


def _moved(number: _Number, values: Mapping[str, np.ndarray], sigma: float) -> tuple[np.ndarray, float]:
    """Return the values of its unknown with a number moved away from the nearer end of its range, and by how much."""
    space, value = number.space, values[number.key].copy()
    free = float(space.to_free(value[number.index : number.index + 1])[0])
    step = _STEP * sigma
    if number.parameter.log:
        step = min(step, _LARGEST_STEP)
    step *= 1 if free + step <= space.high[0] else -1
    value[number.index] = space.to_physical(np.array([free + step]))[0]
    return value, step


def _of_reflectance(one: SceneMaterial, material: Material, moved: list, covariance: np.ndarray) -> np.ndarray:
    """Return the standard deviation of the logarithm of the reflectance, (24, 24)."""
    angle = (np.arange(_CELLS) + 0.5) * np.pi / 2 / _CELLS
    theta_h, theta_d = (a.ravel() for a in np.meshgrid(angle, angle, indexing="ij"))
    # h in the plane of x and z, the difference across it: view and light are equally high, above the horizon
    h = np.stack([np.sin(theta_h), 0 * theta_h, np.cos(theta_h)], 1) * np.cos(theta_d)[:, None]
    across = np.stack([0 * theta_d, np.sin(theta_d), 0 * theta_d], 1)
    name_of = {key: name for name, key in one.keys.items()}

    def log(changed: Material) -> np.ndarray:
        return np.log(np.maximum(changed.evaluate(h + across, h - across).mean(1), 1e-6))  # 1e-6: black

    base = log(material)
    slopes = [(log(material.edit(**{name_of[n.key]: value})) - base) / step for n, value, step in moved]
    j = np.stack(slopes, 1)
    return np.sqrt(np.einsum("np,pq,nq->n", j, covariance, j)).reshape(_CELLS, _CELLS)
