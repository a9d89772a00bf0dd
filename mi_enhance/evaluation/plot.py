"""Figures of a BRDF: lobes, curves, slices and albedos of a material, of its analytic ancestor, and of measurements."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from ..data.functions import Function, function_of
from ..data.loading import is_scattered
from ..data.measurements import Measurements
from ..data.scattered import interpolated
from ..material.material import Material
from ..system.files import material_name
from ..system.progress import Callback, Progress, silent
from . import plot_picture
from .ancestor import fitted_ancestor
from .lobe_curves import curves_of

if TYPE_CHECKING:
    from PIL.Image import Image


def plot(
    material: Material,
    *measurements: Measurements | str | Path,
    path: str | Path | None = None,
    collected: str | None = None,
    progress: Callback = silent,
) -> Image:
    """Draw a material beside its analytic ancestor and measurements.

    Polar lobes and curves in the plane of incidence, albedo over the angle of the view, slices over theta_h and theta_d
    and, with measurements, their errors. The ancestor is the model without modules, fitted to the first measurement, or
    else to the material.

    Parameters
    ----------
    material : Material
    *measurements : Measurements, str or Path
        Samples, between which values are interpolated, or files of any kind that
        :func:`mi_enhance.data.loading.load` reads.
    path : str or Path, optional
        PNG to be written.
    collected : str, optional
        Name of the material, in files that hold several.
    progress : callable, optional
        See :class:`mi_enhance.system.progress.Progress`.

    Returns
    -------
    PIL.Image.Image
        The picture; a notebook shows it.

    Raises
    ------
    FileNotFoundError, ValueError, RuntimeError
        If a file cannot be read, or no variant is active that evaluates the material.

    Examples
    --------
    >>> import mi_enhance as me
    >>> me.plot(me.load_material("gold.bsdf"), "gold.binary", path="gold.png")  # doctest: +SKIP
    """
    from PIL import Image

    found = [_measured(m, collected) for m in measurements]
    functions: dict[str, Function] = {}
    for name, f in found:
        functions[name if name not in functions else f"{name} ({len(functions) + 1})"] = f
    is_enhanced = bool(material.brdf.networks or material.brdf.distilled)
    functions["material" if is_enhanced else material.brdf.model.name] = material.evaluate
    if is_enhanced:
        progress(Progress("analytic ancestor", 0, len(functions) + 1))
        label, ancestor = fitted_ancestor(material, measurements[0] if measurements else None, collected)
        functions[label] = ancestor.evaluate
    curves = {}
    for k, (name, f) in enumerate(functions.items()):
        progress(Progress(f"curves of {name}", k, len(functions)))
        curves[name] = curves_of(f)
    title = f"{material.report.get('name', material.brdf.model.name)}:  {material.brdf}"
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "plot.png" if path is None else Path(path)
        plot_picture.draw(curves, len(found), file, title=title)
        with Image.open(file) as picture:
            return picture.copy()


def _measured(measured: Measurements | str | Path, collected: str | None) -> tuple[str, Function]:
    if isinstance(measured, Measurements):
        return measured.name, interpolated(measured)
    if is_scattered(measured):
        return material_name(measured), function_of(measured)
    return collected or material_name(measured), function_of(measured, material=collected)
