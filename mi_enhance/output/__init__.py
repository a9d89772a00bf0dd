"""For the eye: tables, figures, Pareto fronts, sRGB."""

from ..system.modules import submodules

__getattr__ = submodules(__name__)
