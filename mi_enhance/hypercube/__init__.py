"""The search for what to replace (sections 4.1 and 4.2 of the paper)."""

from ..system.modules import submodules

__getattr__ = submodules(__name__)
