"""Measured files: a material, or what another measured file holds, as RGL `.bsdf`, MERL `.binary` or a table.

Each states its error: what the file gives, read by this package's own readers, against what it was made of.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from ..data import functions
from ..data.directions import sample_pairs
from ..data.functions import Function
from ..data.loading import is_scattered, load, save_table
from ..data.measurements import Measurements, split
from ..data.merl import write_merl
from ..data.rgl_table import write_rgl
from ..data.scattered import interpolated
from ..fitting.losses import log_l1
from ..material.material import Material
from ..system.checks import positive_int
from ..system.files import material_name
from .registry import exporter

_PAIRS = 50_000  # that errors are measured on
_STEEP = np.cos(np.deg2rad(80))  # beyond, measurements are extrapolated; errors are stated without it, too
_SAMPLES = 100_000  # rows of a table where nobody says how many
_FEWEST = 5  # rows of a table that is interpolated: four for a first simplex, one to judge it by
_ASIDE = 10  # one of so many rows of a table tells how well the others say it


@exporter(".bsdf", about="RGL's measured file: Mitsuba's `measured` renders it without this package", measured=True)
def write_bsdf(
    source: Material | str | Path, path: str | Path, *, material: str = "", spectral: bool = False
) -> dict[str, Any]:
    """Write an RGL file.

    Parameters
    ----------
    source : Material, str or Path
        A material, or a measured file of any kind.
    path : str or Path
        ``.bsdf``, replaced as a whole or not at all.
    material : str
        Which one, in a measured file that holds several.
    spectral : bool
        Write spectra instead of RGB, for pbrt-v4; the errors are those of the same tables in RGB.

    Returns
    -------
    dict
        ``bytes``; ``log_l1``: the error of the tabulation, mean over random pairs, and ``log_l1_below_80`` over those
        with both directions within 80 degrees of the normal; ``symmetry`` as of
        :func:`mi_enhance.data.rgl_table.symmetry_of`; of a table of samples also ``log_l1_between_samples``, see
        `write_binary`.

    Examples
    --------
    >>> import mitsuba as mi
    >>> mi.set_variant("llvm_ad_rgb")
    >>> write_bsdf(Material.analytic("ggx"), "out.bsdf")["symmetry"]  # doctest: +SKIP
    'isotropic'
    """
    f, name, facts = opened(source, material)
    symmetry = write_rgl(path, f, description=name, spectral=spectral)
    facts["symmetry"] = symmetry
    if not spectral:
        return _facts(path, f, facts)
    with tempfile.TemporaryDirectory() as folder:
        twin = Path(folder) / "rgb.bsdf"
        write_rgl(twin, f)
        return _facts(twin, f, facts) | {"bytes": Path(path).stat().st_size}


@exporter(".binary", about="MERL's measured file; isotropic and reciprocal, what is not is averaged", measured=True)
def write_binary(source: Material | str | Path, path: str | Path, *, material: str = "") -> dict[str, Any]:
    """Write a MERL file: the mean over azimuths and over both orders of the directions.

    Parameters
    ----------
    source, path, material
        As for `write_bsdf`; the path ends in ``.binary``.

    Returns
    -------
    dict
        ``bytes``, ``log_l1`` and ``log_l1_below_80`` as of `write_bsdf`; ``log_l1_of_average``, the part of ``log_l1``
        that any such file has: what the source and its mean differ; of a table of samples also
        ``log_l1_between_samples``: the error at a tenth of its rows when only the others are known.

    Examples
    --------
    >>> write_binary("gold.csv", "gold.binary")["log_l1"]  # doctest: +SKIP
    0.0021
    """
    f, _, facts = opened(source, material)
    mean = functions.reciprocal(functions.isotropic(f))
    write_merl(path, mean)
    return _facts(path, f, facts | {"log_l1_of_average": functions.difference(f, mean)})


@exporter(".csv", about="table of samples at random pairs of directions", measured=True)
def write_csv(
    source: Material | str | Path, path: str | Path, *, material: str = "", samples: int | None = None, seed: int = 0
) -> dict[str, Any]:
    """Write a table of samples: those of a table as they are, of another source uniform in Rusinkiewicz angles.

    Parameters
    ----------
    source, material
        As for `write_bsdf`.
    path : str or Path
        ``.csv`` or ``.npz``.
    samples : int, optional
        Number of rows; of a table at most so many. All rows of a table, 100,000 of another source, if left out.
    seed : int
        What chooses them.

    Returns
    -------
    dict
        ``bytes``, ``n_samples`` and, of a measured file, ``name``, ``source`` (what the reader noted) and
        ``clamped_fraction``.

    Examples
    --------
    >>> write_csv(Material.analytic("ggx"), "grey.csv", samples=1000)["n_samples"]  # doctest: +SKIP
    1000
    """
    if samples is None:
        is_table = not isinstance(source, Material) and is_scattered(source)
        samples = sys.maxsize if is_table else _SAMPLES
    samples = positive_int(samples, "samples", f'export("{path}")')
    if isinstance(source, Material):
        wi, wo = sample_pairs(samples, seed=seed)
        m = Measurements(wi, wo, source.evaluate(wi, wo), _name(source), "a material of mi_enhance")
    else:
        m = load(source, n_samples=samples, seed=seed, material=material or None)
    save_table(m, path)
    return {
        "bytes": Path(path).stat().st_size,
        "name": m.name,
        "source": m.source,
        "n_samples": len(m.f),
        "clamped_fraction": m.clamped_fraction,
    }


exporter(".npz", about="the same table as NumPy arrays", measured=True)(write_csv)


def opened(source: Material | str | Path, material: str) -> tuple[Function, str, dict[str, Any]]:
    """Return the reflectance of a source, its name, and what is to be said of it."""
    if isinstance(source, Material):
        return source.evaluate, _name(source), {}
    name = material or material_name(source)
    if not is_scattered(source):
        return functions.function_of(source, material=material or None), name, {}
    m = load(source, n_samples=1_000_000)
    if len(m.f) < _FEWEST:
        raise ValueError(
            f'export("{source}"): the table has {len(m.f)} rows above the horizon; at least {_FEWEST} are needed: a '
            "measured file says what lies between them. Measure more, or write a table (.csv, .npz)."
        )
    known, aside = split(m, len(m.f) // _ASIDE)
    error = _error(interpolated(known)(aside.wi, aside.wo), aside)
    return interpolated(m), name, {"log_l1_between_samples": error}


def _name(material: Material) -> str:
    return str(material.report.get("name") or material.brdf.model.name)


def _facts(path: str | Path, f: Function, facts: dict[str, Any]) -> dict[str, Any]:
    """Return the size of a file and its error against the function it was made of."""
    wi, wo = sample_pairs(_PAIRS, seed=1)
    truth = Measurements(wi, wo, np.maximum(f(wi, wo), 0))
    written = functions.function_of(path)(wi, wo)
    steep = np.minimum(wi[:, 2], wo[:, 2]) < _STEEP
    within = Measurements(wi[~steep], wo[~steep], truth.f[~steep])
    errors = {"log_l1": _error(written, truth), "log_l1_below_80": _error(written[~steep], within)}
    return {"bytes": Path(path).stat().st_size, **errors, **facts}


def _error(f: np.ndarray, truth: Measurements) -> float:
    return log_l1(np.asarray(f, np.float64), truth.f.astype(np.float64), truth.wo[:, 2].astype(np.float64))
