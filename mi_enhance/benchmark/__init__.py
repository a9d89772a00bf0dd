"""Error against run time."""

from ..system.modules import submodules

__getattr__ = submodules(__name__)
