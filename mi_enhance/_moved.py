"""Names of version 0.1 for scripts that still use them: each works, with a DeprecationWarning that names the new place.

Python asks this file for a module only after it has found none, so it costs nothing else.
"""

from __future__ import annotations

import importlib
import importlib.abc
import importlib.machinery
import importlib.util
import sys
import types
import warnings
from collections.abc import Callable, Sequence
from typing import Any

_ROOT = "mi_enhance"

# old module: the new ones that hold its names, to be looked through in this order
MODULES = {
    "_files": "system.bundled_files",
    "_llvm": "system.llvm",
    "alternatives": "analytic.alternative_terms",
    "candidate": "hypercube.candidate hypercube.setup hypercube.inheritance hypercube.judging",
    "check": "evaluation.check",
    "check_picture": "evaluation.check_picture",
    "compact": "neural.distilled_network",
    "compare": "evaluation.compare",
    "contenders": "benchmark.contenders",
    "data._io": "system.files",
    "data._npz": "system.npz",
    "data.assorted": "data.random_terms training.augmentation",
    "data.sampling": "data.directions",
    "data.table": "data.table_file",
    "data.tensor_file": "system.tensor_file",
    "data.training": "training.sources training.training_set",
    "demo": "cli.demo",
    "density": "evaluation.chi_square",
    "determined": "fitting.uncertainty",
    "distil": "specialization.distillation",
    "doctor": "cli.doctor cli.doctor_table",
    "energy": "sampling.energy_bound",
    "enhance": "neural.enhance neural.enhanced_brdf",
    "expression": "analytic.text_model.expression",
    "features": "neural.inputs neural.parameter_inputs",
    "fit": "fitting.fit fitting.analytic_fit fitting.rmsprop system.variants",
    "geometry": "analytic.geometry",
    "graph": "analytic.graph",
    "image_descent": "images.descent",
    "image_fit": "images.result",
    "imitate": "training.imitation",
    "inverse": "images.fit_images",
    "inverse_picture": "images.pictures",
    "inverse_starts": "images.starts",
    "lean": "neural.simplify",
    "levenberg": "numerics.levenberg_marquardt",
    "losses": "fitting.losses",
    "maps": "material.material_maps",
    "material": "material.material material.material_file material.description",
    "metrics": "evaluation.image_metrics output.srgb",
    "mixture": "sampling.mixture_fit",
    "model_file": "analytic.text_model.toml_model",
    "models": "analytic.models analytic.models.model analytic.models.abc analytic.models.ashikhmin_shirley",
    "nn": "neural.mlp neural.baked neural.cooperative neural.trainable",
    "normalise": "material.colour_normalization",
    "objective": "fitting.objective",
    "parameters": "analytic.parameters analytic.parameter_space",
    "photographs": "images.targets images.image_loss",
    "picture": "evaluation.comparison_picture output.figure training.curve_picture",
    "placed": "images.scene_materials",
    "prior": "fitting.library_prior",
    "prune": "specialization.pruning",
    "report": "benchmark.benchmark benchmark.jobs benchmark.growth",
    "report_page": "benchmark.page",
    "rivals": "benchmark.nbrdf benchmark.residual_network benchmark.mitsuba_bsdfs",
    "sampling": "sampling.importance sampling.lobe_mixture sampling.albedo numerics.sequences",
    "scene": "evaluation.scenes",
    "search": "hypercube.search hypercube.settings output.pareto",
    "search_picture": "hypercube.picture",
    "search_view": "cli.live_table",
    "specialize": "specialization.specialize",
    "state": "hypercube.states",
    "surface": "fitting.texel_batches",
    "table": "output.table",
    "terms": "analytic.terms",
    "texels": "fitting.fit_texels",
    "timing": "benchmark.timing",
    "train": "training.train training.trainer training.settings training.analytic_start training.training_set",
    "unknowns": "images.unknowns",
    "view_files": "images.view_files",
    "views": "images.views images.cameras",
    "workers": "benchmark.processes",
}
# old name: new name, where that changed, too
NAMES = {
    "_llvm.Found": "system.llvm.LLVMLibrary",
    "bsdfs.function.of_function": "bsdfs.function.function_bsdf",
    "bsdfs.function.reflectance": "evaluation.reflectance.reflectance",
    "compact.Compact": "neural.distilled_network.DistilledNetwork",
    "demo.demo": "cli.demo.make_demo",
    "doctor.show": "cli.doctor_table.print_report",
    "lean.lean": "neural.simplify.simplify",
    "load": "material.material.load_material",
    "mixture.mixture": "sampling.mixture_fit.fit_mixture",
    "normalise.normalise": "material.colour_normalization.normalize",
    "placed.Placed": "images.scene_materials.SceneMaterial",
    "search.Found": "hypercube.search.SearchResult",
    "state.build": "hypercube.states.brdf_of",
    "state.change": "hypercube.states.describe_change",
    "state.name": "hypercube.states.state_digits",
    "surface.Surface": "fitting.texel_batches.TexelSamples",
}
# These are names of the package still: what was asked of them there may be, without a warning.
PUBLIC = ("geometry", "graph", "losses", "metrics", "models", "sampling", "terms")
_MISSING = object()


def lookup(old: str, name: str) -> Any:
    """Return what `name` of the old module `old` is now; ``""`` is the package itself.

    Raises
    ------
    AttributeError
        If there was no such name.
    """
    path = f"{old}.{name}" if old else name
    where = f"{_ROOT}.{old}" if old else _ROOT
    candidates = [NAMES[path]] if path in NAMES else [f"{module}.{name}" for module in MODULES.get(old, "").split()]
    for candidate in candidates:
        module, _, attribute = candidate.rpartition(".")
        found = getattr(importlib.import_module(f"{_ROOT}.{module}"), attribute, _MISSING)
        if found is not _MISSING:
            if old not in PUBLIC:
                home = f"{getattr(found, '__module__', '')}.{name}".removeprefix(f"{_ROOT}.")
                candidate = home if home in candidates else candidate  # not a module that only imports it
                text = f"{where}.{name} is now {_ROOT}.{candidate}; the old name will go in a later version."
                warnings.warn(text, DeprecationWarning, stacklevel=3)
            return found
    raise AttributeError(f'module "{where}" has no attribute "{name}"')


def names_of(old: str) -> Callable[[str], Any]:
    """Return the ``__getattr__`` of a package that has the name of an old module."""

    def get(name: str) -> Any:
        if name.startswith("__"):  # what Python itself asks for
            raise AttributeError(name)
        return lookup(old, name)

    return get


class _OldModule(types.ModuleType):
    """An old module. It can be called where the package has a function of its name, as ``mi_enhance.fit``."""

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return lookup(self.__name__.removeprefix(f"{_ROOT}."), name)

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        old = self.__name__.removeprefix(f"{_ROOT}.")
        return getattr(importlib.import_module(f"{_ROOT}.{MODULES[old].split()[0]}"), old)(*args, **kwargs)


class Finder(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Finds the modules of version 0.1."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: types.ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        root, _, old = fullname.partition(".")
        return importlib.util.spec_from_loader(fullname, self) if root == _ROOT and old in MODULES else None

    def create_module(self, spec: importlib.machinery.ModuleSpec) -> types.ModuleType:
        return _OldModule(spec.name)

    def exec_module(self, module: types.ModuleType) -> None:
        pass


def install() -> None:
    """Let Python ask for old modules, after everybody else."""
    if not any(isinstance(finder, Finder) for finder in sys.meta_path):
        sys.meta_path.append(Finder())
