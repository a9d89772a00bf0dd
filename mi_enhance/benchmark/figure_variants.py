"""Other ways to enhance GGX, trained alike and held against each other (the paper's Figs. 8, 9 and 11)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi

from ..data.loading import load
from ..data.measurements import Measurements
from ..fitting.fit import fit
from ..material.material import Material
from ..neural import baked
from ..neural.cooperative import Cooperative
from ..output.figure import sheet
from ..system.files import material_name
from ..system.progress import Callback, Progress, silent
from . import variants
from .contenders import REFERENCE, contenders
from .errors import TRUTH, rendered_errors
from .figure_renders import NAMES, UNSEEN, shown_file, stack

LABELS = {
    8: (variants.ENHANCED, *variants.RESIDUALS, variants.ALL),
    11: (variants.ENHANCED, variants.NODES),
}
_MOST_BAKED = 10_000  # multiply-adds that are compiled as literals; 35,000 take longer than all else together
_SHOWN = {variants.ENHANCED: "nodes and operators"}


def fitted_variants(
    number: int,
    paths: Sequence[str | Path],
    folder: Path,
    *,
    steps: int = 4000,
    scale: float = 1.0,
    n_samples: int = 100_000,
    resolution: int = 256,
    spp: int = 256,
    seed: int = 0,
    progress: Callback = silent,
) -> list[dict]:
    """Train the variants of a figure, fit each to measured files, and draw the renders beside the truth.

    Parameters
    ----------
    number : {8, 11}
        8: modules, two residual networks, modules in all slots. 11: modules for nodes and operators, or for nodes only.
    paths, folder, n_samples, resolution, spp, seed, progress
        As for :func:`mi_enhance.benchmark.figure_renders.renders`.
    steps, scale
        Of the training, see :func:`mi_enhance.benchmark.variants.trained`.

    Returns
    -------
    list of dict
        One row for each file and variant: ``material``, ``label``, ``ssim``, ``delta_E_ITP_1000``, ``log_l1``,
        ``validation``.
    """
    trained = _trained(LABELS[number], folder, steps, scale, seed, progress)
    rows: list[dict] = []
    for path in paths:
        truth, name = shown_file(path, number), material_name(path)
        measured = load(path, n_samples=n_samples, seed=seed)
        unseen = load(path, n_samples=UNSEEN, seed=seed + 1)
        shown = {_SHOWN.get(v.label, v.label): v for v in trained}

        def bsdfs(truth: dict = truth, measured: Measurements = measured, shown: dict = shown) -> dict[str, mi.BSDF]:
            own = folder / "fits" / measured.name
            ggx = contenders(truth, measured, own, only=(REFERENCE, TRUTH), seed=seed, progress=progress)
            lobe = Material.load(ggx[REFERENCE].spec["filename"])
            result = {NAMES[REFERENCE]: lobe.bsdf()}
            for k, (label, variant) in enumerate(shown.items()):
                progress(Progress(f"fit {label} to {measured.name}", k, len(shown)))
                result[label] = _bsdf(fit(variant.material, measured, seed=seed), lobe)
            return {**result, TRUTH: ggx[TRUTH].bsdf()}

        errors = rendered_errors(
            [NAMES[REFERENCE], *shown, TRUTH],
            bsdfs,
            unseen,
            folder / f"renders_{number}" / name,
            resolution=resolution,
            spp=spp,
            seed=seed,
            progress=progress,
        )
        for label in (NAMES[REFERENCE], *shown):
            row: dict[str, Any] = {"material": name, "label": label, **errors[label]}
            rows.append(row | ({"validation": shown[label].validation} if label in shown else {}))
    pictures = [folder / f"renders_{number}" / material_name(path) / "comparison.png" for path in paths]
    stack(pictures, folder / f"figure_{number}.png")
    return rows


def _bsdf(m: Material, lobe: Material) -> mi.BSDF:
    """Return the BSDF; one with a residual network is no material that a file could hold, and is sampled as GGX."""
    if "R" not in m.brdf.modules:
        return m.bsdf()
    from ..bsdfs.function import function_bsdf

    kind = baked.Baked if m.brdf.multiply_adds < _MOST_BAKED else Cooperative
    params, evaluators = m.as_drjit(), m.brdf.evaluators(kind)
    folded = m.brdf.fold(params, evaluators)
    dr.make_opaque(folded)
    return function_bsdf(lambda wi, wo: m.brdf(wi, wo, params, evaluators, folded), lobe)


def sizes(folder: Path, *, steps: int = 4000, scale: float = 1.0, seed: int = 0, progress: Callback = silent) -> list:
    """Train modules of all sizes and with all numbers of latent numbers, and draw their errors: ``figure_9.png``.

    Arguments as of :func:`fitted_variants`.

    Returns
    -------
    list of dict
        One row for each variant: ``label``, ``validation`` (eq. 1 on materials that were not trained on),
        ``n_weights``, ``multiply_adds``.
    """
    by_size = [variants.size_label(hidden) for hidden in variants.SIZES]
    by_latent = [variants.latent_label(n) for n in variants.LATENTS]
    trained = {v.label: v for v in _trained(dict.fromkeys(by_size + by_latent), folder, steps, scale, seed, progress)}
    with sheet(folder / "figure_9.png", (10, 4), 110) as figure:
        left, right = figure.subplots(1, 2, sharey=True)
        left.plot([label.removeprefix("modules ") for label in by_size], [trained[k].validation for k in by_size], "o-")
        left.set(xlabel="hidden sizes of a module", ylabel="log-L1, unseen materials")
        right.plot(
            list(map(str, variants.LATENTS)), [trained[k].validation for k in by_latent], "o-", color="tab:orange"
        )
        right.set(xlabel=f"latent numbers, {variants.ENHANCED}")
        for axes in (left, right):
            axes.grid(alpha=0.3)
    return [
        {
            "label": v.label,
            "validation": v.validation,
            "n_weights": v.material.brdf.n_weights,
            "multiply_adds": v.material.brdf.multiply_adds,
        }
        for v in trained.values()
    ]


def _trained(
    labels: Sequence[str] | dict, folder: Path, steps: int, scale: float, seed: int, progress: Callback
) -> list[variants.Variant]:
    own = folder / "variants"
    return [variants.trained(k, own, steps=steps, scale=scale, seed=seed, progress=progress) for k in labels]
