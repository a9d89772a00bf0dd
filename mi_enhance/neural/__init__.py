"""The neural modules and the enhanced BRDF (section 3 and Fig. 3 of the paper)."""

from ..system.modules import submodules

__getattr__ = submodules(__name__)
