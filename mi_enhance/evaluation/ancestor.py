"""The analytic model that a material is held against: fitted by the same method to the same measurements."""

from __future__ import annotations

from pathlib import Path

from ..data.directions import sample_pairs
from ..data.loading import load
from ..data.measurements import Measurements
from ..fitting.fit import fit
from ..material.material import Material

_FITTED = 20_000  # samples that it is fitted to: a fit of 12 numbers needs no more


def fitted_ancestor(
    material: Material, measured: Measurements | str | Path | None = None, collected: str | None = None
) -> tuple[str, Material]:
    """Return the model of a material without its networks, fitted anew, and what to call it.

    Parameters
    ----------
    material : Material
    measured : Measurements, str or Path, optional
        What it is fitted to: the material itself if left out.
    collected : str, optional
        Name of the measured material, in a file that holds several.

    Examples
    --------
    >>> fitted_ancestor(Material.analytic("ward"))[0]
    'ward, fitted'
    """
    if measured is None:
        wi, wo = sample_pairs(_FITTED)
        samples = Measurements(wi, wo, material.evaluate(wi, wo))
    elif isinstance(measured, Measurements):
        samples = measured
    else:
        samples = load(measured, n_samples=_FITTED, material=collected)
    return f"{material.brdf.model.name}, fitted", fit(Material.analytic(material.brdf.model), samples)
