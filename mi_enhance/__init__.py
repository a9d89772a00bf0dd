"""Neural enhancement of analytical BRDFs for Mitsuba 3.

Importing this package finds an LLVM that Dr.Jit can use (`system/llvm.py`; import it before ``mitsuba`` or ``drjit``)
and registers the plugin ``{"type": "enhanced"}`` for every variant. Everything else is loaded when first used.

Examples
--------
>>> import mi_enhance as me
>>> import mitsuba as mi
>>> mi.set_variant("llvm_ad_rgb")
>>> material = me.load_material("gold.bsdf")  # doctest: +SKIP
"""

from __future__ import annotations

import importlib
import sys
from itertools import pairwise
from pathlib import Path

from . import _moved
from .system import llvm

__version__ = "0.1.0"

# Where the public names are; each module is imported when one of its names is first asked for.
_PUBLIC = {
    "Material": "material.material",
    "MaterialMaps": "material.material_maps",
    "View": "images.views",
    "check": "evaluation.check",
    "compare": "evaluation.compare",
    "enhance": "neural.enhance",
    "export_material": "export.registry",
    "fit": "fitting.fit",
    "fit_files": "specialization.fit_files",
    "fit_images": "images.fit_images",
    "fit_texels": "fitting.fit_texels",
    "load_material": "material.material",
    "plot": "evaluation.plot",
    "fit_best": "specialization.fit_best",
    "read_views": "images.view_files",
    "render_views": "images.cameras",
    "search": "hypercube.search",
    "shader_ball": "evaluation.scenes",
    "specialize": "specialization.specialize",
    "train": "training.train",
    "view": "export.viewer",
    "write_views": "images.view_files",
}
_MODULES = {
    "data": "data",
    "geometry": "analytic.geometry",
    "graph": "analytic.graph",
    "losses": "fitting.losses",
    "metrics": "evaluation.image_metrics",
    "models": "analytic.models",
    "sampling": "sampling",
    "terms": "analytic.terms",
}
__all__ = ["__version__", *_MODULES, *_PUBLIC]
# Folders that the documentation names: `mi_enhance.evaluation.scenes.load` works after `import mi_enhance`.
_ROOMS = ("analytic", "benchmark", "evaluation", "fitting", "hypercube", "images", "neural", "output", "training")


def __getattr__(name: str):
    if name in _MODULES:
        return importlib.import_module(f"{__name__}.{_MODULES[name]}")
    if name in _PUBLIC:
        return getattr(importlib.import_module(f"{__name__}.{_PUBLIC[name]}"), name)
    if name in _moved.NAMES:
        return _moved.lookup("", name)  # with a warning
    if name in _ROOMS:
        return importlib.import_module(f"{__name__}.{name}")
    raise AttributeError(f'mi_enhance has no "{name}". Public names: {", ".join(__all__)}.')


def __dir__() -> list[str]:
    return sorted(__all__)


def _is_command_line() -> bool:
    """Tell whether this process is `mi-enhance`: it reports a missing LLVM itself, and its doctor must still run."""
    return "mi-enhance" in (Path(a).stem for a in sys.argv[:1]) or ("-m", __name__) in pairwise(sys.orig_argv)


_moved.install()
try:
    llvm.found = llvm.prepare()
except ImportError as error:
    if not _is_command_line():
        raise
    llvm.problem = str(error)

import mitsuba as _mi  # noqa: E402  (after the LLVM is chosen)

from . import bsdfs as _bsdfs  # noqa: E402

_bsdfs.register()
_mi.detail.add_variant_callback(_bsdfs.register)
