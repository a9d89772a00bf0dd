"""From measurements to parameters (section 5.1 of the paper)."""

from ..system.modules import submodules

__getattr__ = submodules(__name__)
