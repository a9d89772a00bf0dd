"""Other ways to enhance GGX, each trained with the same materials, samples, seed and steps (paper, section 7.2)."""

from __future__ import annotations

import dataclasses
import functools
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from ..analytic import models
from ..material.material import Material
from ..neural.enhance import enhance
from ..neural.enhanced_brdf import EnhancedBRDF
from ..system.cache import cached
from ..system.progress import Callback, Progress, silent
from ..system.run_folder import keep_settings
from ..training.analytic_start import analytic_start, validate
from ..training.imitation import imitate
from ..training.settings import TrainingSettings
from ..training.sources import build, sources_of
from ..training.trainer import Trainer
from ..training.training_set import TrainingSet
from .residual_model import LARGE, SMALL, with_residual

SIZES = ((8, 16, 8), (16, 16, 16), (16, 32, 16), (32, 32, 32))  # the paper's Fig. 9
LATENTS = (8, 27, 48)
_PACKAGE = Path(__file__).resolve().parents[1]
_MODEL = "ggx"
_NODES_AND_OPERATORS = ("F", "F*G", "G", "1/E")  # what the paper's search finds
_HIDDEN, _N_LATENT = (16, 32, 16), 27
_SAVES = 4  # checkpoints of a training


def _modules(
    replace: Sequence[str] = _NODES_AND_OPERATORS, hidden: tuple[int, ...] = _HIDDEN, n_latent: int = _N_LATENT
) -> EnhancedBRDF:
    return enhance(_MODEL, replace, hidden=hidden, n_latent=n_latent, inputs="shape", modulated=True)


def size_label(hidden: tuple[int, ...]) -> str:
    """Return the name of the variant with modules of these hidden sizes.

    Examples
    --------
    >>> size_label((8, 16, 8))
    'modules 8-16-8'
    """
    return f"modules {'-'.join(map(str, hidden))}"


def latent_label(n: int) -> str:
    """Return the name of the variant with `n` latent numbers."""
    return ENHANCED if n == _N_LATENT else f"{n} latent numbers"


ENHANCED, NODES, ALL = size_label(_HIDDEN), "nodes only", "all slots neural"
RESIDUALS = {"residual network": SMALL, "residual network, large": LARGE}
_BUILD: dict[str, Callable[[], EnhancedBRDF]] = {
    **{size_label(hidden): functools.partial(_modules, hidden=hidden) for hidden in SIZES},
    **{latent_label(n): functools.partial(_modules, n_latent=n) for n in LATENTS},
    NODES: functools.partial(_modules, ("F", "G", "1/E")),
    ALL: lambda: _modules(models.get(_MODEL).graph.slots),
    **{k: functools.partial(with_residual, _MODEL, v, n_latent=_N_LATENT) for k, v in RESIDUALS.items()},
}
VARIANTS = tuple(_BUILD)


@dataclasses.dataclass(frozen=True)
class Variant:
    """A variant after its training.

    Parameters
    ----------
    label : str
        One of `VARIANTS`.
    material : Material
        To fit with.
    validation : float
        Eq. 1, mean over materials that were not trained on.
    """

    label: str
    material: Material
    validation: float


def trained(
    label: str, folder: Path, *, steps: int = 4000, scale: float = 1.0, seed: int = 0, progress: Callback = silent
) -> Variant:
    """Train a variant, or go on where an earlier run in `folder` stopped.

    Parameters
    ----------
    label : str
        One of `VARIANTS`.
    folder : Path
        Of all variants: it keeps the samples, which they share, and the checkpoint of each.
    steps : int
        Of the training: 32 samples of each material. The imitation before it takes 1,000, or as many if that is less.
    scale : float
        Of the number of made-up materials; 1 is ``networks/materials.json``, 448 materials.
    seed : int
    progress : callable

    Returns
    -------
    Variant

    Raises
    ------
    ValueError
        If `folder` holds runs with other settings.
    """
    keep_settings(folder / "settings.json", {"steps": steps, "scale": scale, "seed": seed}, "variants.trained()")
    samples, unseen = (_samples(name, folder, scale, seed, progress) for name in ("materials", "unseen"))
    settings = TrainingSettings(n_samples=samples.n_samples, batch=32, steps=steps, lr=4e-3, seed=seed)
    own = folder / label.replace(" ", "_").replace(",", "")
    own.mkdir(parents=True, exist_ok=True)
    checkpoint = own / "checkpoint.npz"
    brdf = _BUILD[label]()
    if not checkpoint.exists() and label not in RESIDUALS:  # which are 0 at first
        brdf = imitate(brdf, steps=min(1000, steps), seed=seed, progress=progress)
    trainer = Trainer(brdf, samples, settings, analytic_start(brdf, samples, folder / "analytic.npz"))
    if checkpoint.exists():
        trainer.resume(checkpoint)
    while trainer.step < steps:
        loss = float(trainer.advance().mean())
        if trainer.step % max(1, steps // _SAVES) == 0 or trainer.step == steps:
            trainer.save(checkpoint)
        progress(Progress(f"train {label}", trainer.step, steps, {"loss": loss}))

    def judge() -> dict[str, Any]:
        brdf = trainer.result()
        losses = validate(brdf, unseen, analytic_start(brdf, unseen, folder / "analytic_unseen.npz"))
        return {"validation": float(losses.mean())}

    result = cached(own / "result.json", judge, _read, _write)
    return Variant(label, trainer.material(), result["validation"])


def _samples(name: str, folder: Path, scale: float, seed: int, progress: Callback) -> TrainingSet:
    sources = [{**s, "path": str(_PACKAGE.parent / s["path"])} if "path" in s else s for s in _sources(name)]
    sources = [{**s, "count": max(1, round(s["count"] * scale))} if "count" in s else s for s in sources]
    return build(sources, n_samples=4096, seed=seed, cache=folder / "cache", progress=progress)


def _sources(name: str) -> list[dict]:
    return sources_of(_PACKAGE / "networks" / f"{name}.json")


def _read(path: Path) -> dict:
    return json.loads(path.read_text())


def _write(path: Path, content: dict) -> None:
    path.write_text(json.dumps(content) + "\n")
