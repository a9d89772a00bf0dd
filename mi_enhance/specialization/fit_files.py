"""Fits of many measured files, each to a file of its own: here, in processes of this machine, or on a Dask cluster."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

import mitsuba as mi

from ..data import load
from ..data.photometric_file import FILE as PHOTOMETRIC
from ..fitting.fit import fit
from ..material import material_file
from ..material.material import Material
from ..system.files import digest, material_name, require_file
from ..system.progress import Callback, Progress, silent
from ..system.run_folder import keep_settings
from ..system.variants import require_rgb
from ..system.workers import alone, run_all
from .fit_best import fit_best

_KEPT = ".fit"  # folder beside the results: the settings of each, and the model that fits start from
# A file that cannot be fitted must not lose those that can.
_OF_A_FILE = (ValueError, KeyError, RuntimeError, OSError)


@dataclasses.dataclass(frozen=True)
class FileFit:
    """What became of one file.

    Parameters
    ----------
    file : str
        The measured file.
    output : str
        The material's file; there is none if `error` says something.
    report : dict
        Of the material.
    error : str
        Why there is no material; empty if there is one.
    """

    file: str
    output: str
    report: Mapping[str, Any]
    error: str = ""


def fit_files(
    material: Material,
    files: Sequence[str | Path],
    folder: str | Path,
    *,
    n_samples: int = 100_000,
    which: str | None = None,
    method: str = "lm",
    own: str = "auto",
    reciprocal: bool = False,
    bound_energy: bool = False,
    seed: int = 0,
    executor: Executor | None = None,
    progress: Callback = silent,
) -> list[FileFit]:
    """Fit a material to every file, and write each as soon as it is found.

    What is finished is kept, whatever happens to the rest: the same call again fits only files that have no material
    yet, or that have changed since.

    Parameters
    ----------
    material : Material
        What all fits start from.
    files : sequence of str or Path
        Measured files of any kind that :func:`mi_enhance.data.load` reads.
    folder : str or Path
        Gets ``NAME.bsdf`` for ``NAME_rgb.bsdf``, ``NAME.binary`` and so on.
    n_samples : int
        Pairs of directions of each file.
    which : str, optional
        Which material, in files that hold several.
    method : {"lm", "rmsprop"}
        As of :func:`mi_enhance.fitting.fit.fit`; ``rmsprop`` never gives a network of its own.
    own : {"auto", "always", "never"}
        As of :func:`mi_enhance.specialization.fit_best.fit_best`.
    reciprocal, bound_energy : bool
        As of ``fit``.
    seed : int
    executor : concurrent.futures.Executor, optional
        Who fits, each file on its own; its processes must see the files and `folder` under the same names. A Dask
        cluster does the work of a killed worker again. This process fits, one by one, if left out.
    progress : callable
        Hears of every finished file.

    Returns
    -------
    list of FileFit
        In the order of `files`.

    Raises
    ------
    ValueError
        If no file is given, two would be written to one name, or `folder` holds such a material that is of other
        settings, or of no fit.
    FileNotFoundError
        If a file is missing.
    RuntimeError
        If no RGB variant with gradients is active.

    Examples
    --------
    >>> fit_files(Material.pretrained(), ["a.binary", "b.binary"], "out/fits")  # doctest: +SKIP
    """
    require_rgb("fit_files()")
    folder = Path(folder).absolute()
    outputs = _outputs(files, folder)
    settings = {
        "model": digest(str(material.brdf).encode(), material_file.weights(material.brdf), material.as_vector()),
        "n_samples": n_samples,
        "which": which,
        "method": method,
        "own": own,
        "reciprocal": reciprocal,
        "bound_energy": bound_energy,
        "seed": seed,
    }
    for output in outputs:
        _check_own(output, settings)
    start = folder / _KEPT / "start.bsdf"
    material.save(start)
    del settings["model"]
    run = functools.partial(_fit_file, str(start), mi.variant() or "", settings)
    jobs = list(zip((str(Path(file).absolute()) for file in files), map(str, outputs), strict=True))
    results = run_all(run, jobs, executor, lambda done: progress(Progress("files", len(done), len(jobs))))
    return [dataclasses.replace(results[job], file=str(file)) for job, file in zip(jobs, files, strict=True)]


def _outputs(files: Sequence[str | Path], folder: Path) -> list[Path]:
    if not files:
        raise ValueError("fit_files(): no files. Give at least one.")
    outputs: dict[Path, str | Path] = {}
    for file in files:
        whole = require_file(file, f'fit_files(): "{file}"').absolute()
        name = whole.parent.name if whole.name == PHOTOMETRIC else material_name(whole)
        path = folder / f"{name}.bsdf"
        if path in outputs:
            raise ValueError(f'fit_files(): "{outputs[path]}" and "{file}" would both be "{path.name}". Rename one.')
        if path.exists() and path.samefile(file):
            raise ValueError(f'fit_files(): "{file}" would be written over. Choose another folder.')
        outputs[path] = file
    return list(outputs)


def _check_own(output: Path, settings: Mapping[str, Any]) -> None:
    """Keep the settings of a fit, and refuse a material that is there and was not made with them."""
    kept = output.parent / _KEPT / f"{output.stem}.json"
    if output.exists() and not kept.exists():
        raise ValueError(
            f'fit_files(): "{output}" is there already, and is no fit of this command. Choose another folder, '
            "or remove it."
        )
    keep_settings(kept, settings, "fit_files()", begun=output.exists())


def _fit_file(start: str, variant: str, how: Mapping[str, Any], job: tuple[str, str]) -> FileFit:
    """Fit one file, unless that has been done since it changed; in any process."""
    file, output = job
    try:
        with alone(variant):
            if not _is_newer(output, file):
                _fit(Material.load(start), file, dict(how)).save(output)
            return FileFit(file, output, Material.load(output).report)
    except _OF_A_FILE as error:
        return FileFit(file, output, {}, str(error.args[0]) if isinstance(error, KeyError) else str(error))


def _fit(material: Material, file: str, how: dict[str, Any]) -> Material:
    n_samples, which, method, own = (how.pop(key) for key in ("n_samples", "which", "method", "own"))
    measurements = load(file, n_samples=n_samples, seed=how["seed"], material=which)
    if method == "lm":
        return fit_best(material, measurements, own=own, **how)
    return fit(material, measurements, method=method, **how)


def _is_newer(output: str, file: str) -> bool:
    path, read = Path(output), Path(file)
    # the photographs that it names, too
    files = [read, *read.parent.rglob("*")] if read.name == PHOTOMETRIC else [read]
    return path.exists() and path.stat().st_mtime >= max(f.stat().st_mtime for f in files)
