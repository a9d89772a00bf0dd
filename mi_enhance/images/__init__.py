"""From photographs to parameters."""

from ..system.modules import submodules

__getattr__ = submodules(__name__)
