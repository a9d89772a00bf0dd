"""One material made cheaper to render."""

from ..system.modules import submodules

__getattr__ = submodules(__name__)
