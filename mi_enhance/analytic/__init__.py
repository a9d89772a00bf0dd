"""The analytic model as a computational graph (section 3 of the paper)."""

from ..system.modules import submodules

__getattr__ = submodules(__name__)
