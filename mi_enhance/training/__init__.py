"""From many materials to weights (section 4.3 of the paper)."""

from ..system.modules import submodules

__getattr__ = submodules(__name__)
