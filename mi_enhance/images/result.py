"""The result of a fit to images: materials, re-renders, and a report of their errors."""

from __future__ import annotations

import dataclasses
import time
import warnings
from collections.abc import Collection, Mapping, Sequence

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
from .survey import Survey
from .uncertainty import Uncertainty
from .views import View

_FINAL_SPP, _LEAST_SPP = 128, 64
_CONTRADICTION = 1.3  # in brightness: fits of one material leave a few percent
_PATHS = 1 << 24  # that the re-renders at the end may have together


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
        by half of their range without a pixel that shows it), ``uncertainty`` (``words`` and ``numbers``, see below),
        ``views`` (name, split, ``mean_abs_log`` and ``psnr`` of each re-render over the pixels that count),
        ``mean_abs_log`` (``train`` and ``test``), ``judged_at`` (1 / size of the photographs in these), and the
        settings. ``exposure_factors`` by name of the view, where they were sought; that of a held-out view is the one
        that explains it best. JSON types only.
    curve : list of dict
        ``step``, ``seconds``, ``loss`` of every iteration; another stage sees other pixels and another noise.
    renders : list of array (H, W, 3)
        Re-renders of all views, in their order, made ``report["judged_at"]`` times smaller as the photographs are.
    uncertainty : Uncertainty or None
        What the photographs tell about each number; None where maps are all that is sought.
    """

    materials: dict[str, Material]
    values: dict[str, np.ndarray]
    report: dict
    curve: list[dict]
    renders: list[np.ndarray]
    uncertainty: Uncertainty | None = None


def result(
    descent: Descent,
    placed: Mapping[str, SceneMaterial],
    views: Sequence[View],
    book: Survey,
    undetermined: Sequence[str],
    blind: Collection[int],
    told: Uncertainty | None,
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
    book : Survey
    undetermined : sequence of str
        Keys of unknowns that no photograph shows.
    blind : collection of int
        Numbers of photographs that show no unknown.
    told : Uncertainty or None
    settings : dict
    start : float
        When the fit began, of ``time.perf_counter()``.
    """
    renders: dict[str, np.ndarray] = {}
    small = [v.smaller(book.factor) for v in views]
    spp = int(np.clip(_PATHS // sum(v.mask.size for v in small), _LEAST_SPP, _FINAL_SPP))
    factors = {}
    for target in targets.targets(small, 1, book.numbers):
        images = targets.split(descent.render(target, spp, settings["seed"]), target)
        renders |= dict(zip((v.name for v in target.views), images, strict=True))
    if descent.exposures:
        factors = {name: float(descent.values()["exposure_factors"][k]) for name, k in book.numbers.items()}
        for view in (v for v in small if v.split != "train"):
            factors[view.name] = _best_factor(view, renders[view.name])
            renders[view.name] = factors[view.name] * renders[view.name]
    else:
        seeing = [v for v in small if v.split == "train" and book.numbers[v.name] not in blind]
        _tell_contradictions({v.name: _best_factor(v, renders[v.name]) for v in seeing})
    rows = [{"name": v.name, "split": v.split, **errors(v, renders[v.name])} for v in small]
    report = {
        "mean_abs_log": {s: _mean(r["mean_abs_log"] for r in rows if r["split"] == s) for s in ("train", "test")},
        "loss": descent.loss(),
        "seconds": time.perf_counter() - start,
        "iterations": len(descent.curve),
        "n_unknowns": sum(v.size for v in descent.values().values()),
        "light_scale": float(descent.values()["light_scale"][0]) if descent.light else 1.0,
        "nonfinite_gradients": descent.nonfinite,
        "nonfinite_pixels": descent.nonfinite_pixels,
        "undetermined": list(undetermined),
        "uncertainty": told.report() if told else None,
        "judged_at": book.factor,
        **({"exposure_factors": factors} if factors else {}),
        "views": rows,
        "settings": settings,
    }
    materials = materials_of(descent, placed, report)
    return ImageFit(materials, descent.values(), report, descent.curve, [renders[v.name] for v in small], told)


def materials_of(descent: Descent, placed: Mapping[str, SceneMaterial], report: dict) -> dict[str, Material]:
    """Return the materials as the scene has them now, by id, those without textures."""
    materials = {}
    for name, one in placed.items():
        if not one.is_textured:
            found = normalize(
                dataclasses.replace(one.read(descent.params), report=_of_material(report, one), library=None)
            )
            materials[name] = dataclasses.replace(found, lobe_albedo=albedo.lobe_albedo(found.brdf, found.as_drjit()))
    return materials


def _tell_contradictions(brightness: Mapping[str, float]) -> None:
    """Warn of photographs that are brighter or darker than their re-renders, by another factor than the others."""
    middle = float(np.median(list(brightness.values())))
    off = {name: b / middle for name, b in brightness.items() if max(b / middle, middle / b) > _CONTRADICTION}
    if off:
        name, factor = max(off.items(), key=lambda pair: abs(np.log(pair[1])))
        warnings.warn(
            f"fit_images(): exposures contradict each other: {len(off)} of {len(brightness)} photographs are brighter "
            f'or darker than the others say, "{name}" {factor:.2g} times as bright. Correct light or exposure_factor, '
            "or let the fit seek the factors (exposures=True, --exposures).",
            stacklevel=4,
        )


def _best_factor(view: View, render: np.ndarray) -> float:
    """Return the median of photograph over render, where neither is dark or saturated."""
    used = view.mask & ~view.saturated.any(-1) & (view.image > 0).all(-1) & (render > 0).all(-1)
    return float(np.median(view.image[used] / render[used])) if used.any() else 1.0


def _of_material(report: dict, one: SceneMaterial) -> dict:
    """Return the report that the file of a material keeps; of a fit that has not ended there is none."""
    if not report:
        return {"method": "images"}
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
