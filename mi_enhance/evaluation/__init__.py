"""Materials judged (section 7 of the paper): image metrics, scenes, comparisons, physical checks."""

from ..system.modules import submodules

__getattr__ = submodules(__name__)
