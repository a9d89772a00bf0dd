"""What the samples of each texel tell about its parameters, and what they leave open."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ..analytic import parameter_space, parameters
from ..material.material import Material
from ..material.material_maps import MaterialMaps
from ..output.figure import sheet
from ..system.progress import Callback, Progress, silent
from . import library_prior, multistart
from .texel_batches import TexelSamples, check
from .uncertainty import posterior

_SAME = 1e3  # residuals far below it all have one weight: what is left of the normal equations is J^T J
_COLUMNS = 6  # of a picture


def uncertainty_of_texels(
    maps: MaterialMaps,
    wi: np.ndarray,
    wo: np.ndarray,
    f: np.ndarray,
    *,
    counts: np.ndarray | None = None,
    network: Material | None = None,
    progress: Callback = silent,
) -> dict[str, np.ndarray]:
    """Return the standard deviation of every number of every texel, as a share of that without samples.

    Residuals are taken for independent, with a Laplace distribution of the size they have in the texel; see
    :func:`mi_enhance.fitting.uncertainty.determined`. Take the numbers for lower bounds, and for a ranking.

    Parameters
    ----------
    maps : MaterialMaps
        As :func:`mi_enhance.fitting.fit_texels.fit_texels` found them.
    wi, wo, f : array
        The samples they were fitted to, f of shape (H, W, S, 3).
    counts : array (H, W, S) of bool, optional
        Samples that are measured, of :func:`mi_enhance.data.photometric_samples.photometric_texels`: the others repeat
        some of these. All if left out.
    network : Material, optional
        With its training materials, which say what is known without samples; else only the range of each number does.
    progress : callable, optional
        ``progress(Progress)`` after every batch of texels.

    Returns
    -------
    dict of str to array (H, W, C)
        By parameter: near 0 a number is known, at 1 nothing is told. What fits do not move is left out.

    Raises
    ------
    ValueError
        For samples of other shapes than the maps.

    Examples
    --------
    >>> from mi_enhance.data.directions import sample_pairs
    >>> m = Material.analytic("ggx").edit(rho_s=0)
    >>> maps = MaterialMaps(m, {"F0": np.full((1, 2, 1), 0.04)})
    >>> wi, wo = sample_pairs(50)
    >>> told = uncertainty_of_texels(maps, wi, wo, np.tile(m.evaluate(wi, wo), (1, 2, 1, 1)))
    >>> told["F0"].round(3).ravel(), bool(told["rho_d"].max() < 0.01)
    (array([1., 1.]), True)
    """
    where = "uncertainty_of_texels()"
    shape = check(where, wi, wo, f)
    if shape != maps.shape:
        raise ValueError(f"{where}: f is for {shape} texels, the maps have {maps.shape}.")
    if counts is not None and counts.shape != f.shape[:-1]:
        raise ValueError(f"{where}: counts has shape {counts.shape}; {f.shape[:-1]} is needed.")
    brdf = maps.material.brdf
    surface = TexelSamples(wi, wo, f, np.random.default_rng(0))
    measured = np.ones(len(surface.f)) if counts is None else counts.reshape(len(surface.f), -1).mean(1)
    space = parameter_space.Space(brdf.parameters)
    u = space.to_free(maps.as_vectors().reshape(len(surface.f), -1).astype(np.float64))
    spread = (space.high - space.low) / np.sqrt(12)  # of a number anywhere in its range
    free = np.flatnonzero(spread)
    before = np.diag(1 / spread[free] ** 2)
    if network is not None and network.library is not None:
        before += library_prior.from_library(network, 1.0).precision[np.ix_(free, free)]
    sigma = np.sqrt(np.diag(np.linalg.inv(before)))
    share = np.zeros((len(u), len(spread)))
    for part in multistart.batches(np.arange(len(u)), surface.n):
        problem = surface.problem(brdf, part)
        normal = problem.normal_equations(u[part], np.full(len(part), _SAME))[0] * (3 * surface.n * _SAME)
        normal = normal[:, free[:, None], free] * measured[part, None, None]
        covariance = posterior(normal, problem.loss(u[part]), before)
        share[part[:, None], free] = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2)) / sigma
        progress(Progress("what the samples tell", int(part[-1]) + 1, len(u)))
    found = parameters.unflatten(brdf.parameters, np.minimum(share, 1).T.reshape(-1, *shape))
    return {p.name: np.moveaxis(found[p.name], 0, 2) for p in brdf.parameters if not p.fixed}


def draw(shares: Mapping[str, np.ndarray], path: str | Path) -> None:
    """Write :func:`uncertainty_of_texels` as PNG, a map for each parameter; of several numbers their mean.

    Examples
    --------
    >>> draw(uncertainty_of_texels(maps, wi, wo, f), "uncertainty.png")  # doctest: +SKIP
    """
    rows = -(-len(shares) // _COLUMNS)
    with sheet(path, (2.2 * min(_COLUMNS, len(shares)) + 0.8, 2.4 * rows), 110) as figure:
        axes = np.ravel(figure.subplots(rows, min(_COLUMNS, len(shares)), squeeze=False))
        for ax in axes:
            ax.set_axis_off()
        for ax, (name, values) in zip(axes, shares.items(), strict=False):
            shown = ax.imshow(values.mean(2), cmap="viridis_r", vmin=0, vmax=1)
            ax.set_title(name if values.shape[2] == 1 else f"{name}, mean of {values.shape[2]}", fontsize=8)
        figure.colorbar(shown, ax=axes.tolist(), label="0: told by the samples, 1: left open")
