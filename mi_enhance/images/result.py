"""The result of a fit to images: materials, re-renders, and a report of their errors."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Mapping, Sequence

import numpy as np

from ..analytic.parameters import components
from ..evaluation.image_metrics import psnr
from ..fitting.losses import log_l1
from ..material.colour_normalization import normalize
from ..material.material import Material
from ..sampling import albedo
from . import targets
from .descent import Descent
from .scene_materials import SceneMaterial
from .views import View

_FINAL_SPP = 128
RECENT = 5  # iterations whose mean is the loss: one alone is a matter of chance


@dataclasses.dataclass(frozen=True, eq=False)
class ImageFit:
    """The result of a fit to images.

    Parameters
    ----------
    materials : dict of str to Material
        By id of the BSDF, or what its keys in ``mi.traverse(scene)`` begin with; only where no parameter is textured.
    values : dict of str to array
        Every unknown by its key in ``mi.traverse(scene)``, flat.
    report : dict
        ``loss``, ``seconds``, ``iterations``, ``light_scale``, ``nonfinite_gradients`` (components that were set to 0),
        ``nonfinite_pixels`` (values of renders that were left out), ``undetermined`` (keys of unknowns that may change
        by half of their range without a pixel that shows it),
        ``views`` (name, split, ``mean_abs_log`` and ``psnr`` of each re-render over the pixels that count),
        ``mean_abs_log`` (``train`` and ``test``), and the settings. JSON types only.
    curve : list of dict
        ``step``, ``seconds``, ``loss`` of every iteration; another stage sees other pixels and another noise.
    renders : list of array (H, W, 3)
        Re-renders of all views, in their order.
    """

    materials: dict[str, Material]
    values: dict[str, np.ndarray]
    report: dict
    curve: list[dict]
    renders: list[np.ndarray]


def result(
    descent: Descent,
    placed: Mapping[str, SceneMaterial],
    views: Sequence[View],
    undetermined: Sequence[str],
    settings: dict,
    start: float,
) -> ImageFit:
    """Re-render all views, and report how far they are from the photographs.

    Parameters
    ----------
    descent : Descent
        At its end.
    placed : dict of str to SceneMaterial
    views : sequence of View
    undetermined : sequence of str
        Keys of unknowns that no photograph shows.
    settings : dict
    start : float
        When the fit began, of ``time.perf_counter()``.
    """
    renders: dict[str, np.ndarray] = {}
    for target in targets.targets(views):
        images = targets.split(descent.render(target, _FINAL_SPP, settings["seed"]), target)
        renders |= dict(zip((v.name for v in target.views), images, strict=True))
    rows = [{"name": v.name, "split": v.split, **errors(v, renders[v.name])} for v in views]
    report = {
        "mean_abs_log": {s: _mean(r["mean_abs_log"] for r in rows if r["split"] == s) for s in ("train", "test")},
        "loss": float(np.mean([row["loss"] for row in descent.curve[-RECENT:]])),
        "seconds": time.perf_counter() - start,
        "iterations": len(descent.curve),
        "n_unknowns": sum(v.size for v in descent.values().values()),
        "light_scale": float(descent.values()["light_scale"][0]) if descent.light else 1.0,
        "nonfinite_gradients": descent.nonfinite,
        "nonfinite_pixels": descent.nonfinite_pixels,
        "undetermined": list(undetermined),
        "views": rows,
        "settings": settings,
    }
    materials = {}
    for name, one in placed.items():
        if not one.is_textured:
            found = normalize(
                dataclasses.replace(one.read(descent.params), report=_of_material(report, one), library=None)
            )
            materials[name] = dataclasses.replace(found, lobe_albedo=albedo.lobe_albedo(found.brdf, found.as_drjit()))
    return ImageFit(materials, descent.values(), report, descent.curve, [renders[v.name] for v in views])


def _of_material(report: dict, one: SceneMaterial) -> dict:
    """Return the report that the file of a material keeps."""
    kept = ("loss", "seconds", "iterations", "n_unknowns", "light_scale", "nonfinite_gradients", "settings")
    means = {f"mean_abs_log_{s}": v for s, v in report["mean_abs_log"].items() if v is not None}
    hidden = [p for p in one.material.brdf.parameters if one.keys.get(p.name) in report["undetermined"]]
    names = [name for p in hidden for name in components(p)]
    return {"method": "images", **{key: report[key] for key in kept}, "undetermined": names, **means}


def errors(view: View, image: np.ndarray) -> dict[str, float | None]:
    """Return mean absolute log difference and PSNR (None: equal) of a re-render over the pixels that count."""
    truth = np.maximum(view.image[view.mask], 0)
    found = np.where(view.saturated[view.mask], np.minimum(image[view.mask], truth), image[view.mask])
    decibel = psnr(found[:, None], truth[:, None])
    return {"mean_abs_log": log_l1(found, truth, 1.0), "psnr": decibel if np.isfinite(decibel) else None}


def _mean(values) -> float | None:
    values = list(values)
    return float(np.mean(values)) if values else None
