"""Neural enhancement of analytical BRDFs for Mitsuba 3.

Importing this package finds an LLVM that Dr.Jit can use (`_llvm.py`; import it before ``mitsuba`` or ``drjit``) and
registers the plugin ``{"type": "enhanced"}`` for every variant. Everything else is loaded when first used.

Examples
--------
>>> import mi_enhance as me
>>> import mitsuba as mi
>>> mi.set_variant("llvm_ad_rgb")
>>> material = me.load("gold.bsdf")  # doctest: +SKIP
"""

from __future__ import annotations

import importlib
import sys
from itertools import pairwise
from pathlib import Path
from types import ModuleType

from .system import llvm

__version__ = "0.1.0"

# public name: the module that holds it, or the module itself where the last part is the name
_PUBLIC = {
    "Material": "mi_enhance.material.material",
    "MaterialMaps": "mi_enhance.material.material_maps",
    "View": "mi_enhance.images.views",
    "check": "mi_enhance.evaluation.check",
    "compare": "mi_enhance.evaluation.compare",
    "enhance": "mi_enhance.neural.enhanced_brdf",
    "fit": "mi_enhance.fitting.fit",
    "fit_images": "mi_enhance.images.fit_images",
    "fit_texels": "mi_enhance.fitting.fit_texels",
    "load": "mi_enhance.material.material",
    "read_views": "mi_enhance.images.view_files",
    "render_views": "mi_enhance.images.views",
    "search": "mi_enhance.hypercube.search",
    "shader_ball": "mi_enhance.evaluation.scenes",
    "specialize": "mi_enhance.specialization.specialize",
    "train": "mi_enhance.training.train",
    "write_views": "mi_enhance.images.view_files",
}
_MODULES = {
    "data": "mi_enhance.data",
    "geometry": "mi_enhance.analytic.geometry",
    "graph": "mi_enhance.analytic.graph",
    "losses": "mi_enhance.fitting.losses",
    "metrics": "mi_enhance.evaluation.image_metrics",
    "models": "mi_enhance.analytic.models",
    "sampling": "mi_enhance.sampling.importance",
    "terms": "mi_enhance.analytic.terms",
}
__all__ = ["__version__", *_MODULES, *_PUBLIC]


class _Package(ModuleType):
    """Keeps ``mi_enhance.fitting.fit`` the function.

    Whoever imports the module ``mi_enhance.fitting.fit`` makes Python store that module as attribute ``fit`` of the package,
    which would hide the function of the same name from then on.
    """

    def __setattr__(self, name, value):
        if not (name in _PUBLIC and isinstance(value, ModuleType)):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package


def __getattr__(name: str):
    if name in _MODULES:
        return importlib.import_module(_MODULES[name])
    if name == "load":
        return importlib.import_module(_PUBLIC[name]).Material.load
    if name in _PUBLIC:
        return getattr(importlib.import_module(_PUBLIC[name]), name)
    raise AttributeError(f'mi_enhance has no "{name}". Public names: {", ".join(__all__)}.')


def __dir__() -> list[str]:
    return sorted(__all__)


def _is_command_line() -> bool:
    """Tell whether this process is `mi-enhance`: it reports a missing LLVM itself, and its doctor must still run."""
    return "mi-enhance" in (Path(a).stem for a in sys.argv[:1]) or ("-m", __name__) in pairwise(sys.orig_argv)


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
