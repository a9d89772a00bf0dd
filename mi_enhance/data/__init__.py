"""Measured reflectance in, one record out: `load` finds the reader, `Measurements` is what every fit takes.

One reader per file beside this one; ``registry.py`` says how to add another. Each turns "light" and "view" of its
source into `wo` and `wi` (the conventions are on top of ``analytic/geometry.py``) and draws its pairs of directions as
section 6 of the paper does (``directions.py``).
"""

from ..system.modules import submodules
from .functions import function_of
from .loading import load, names, save_table
from .measurements import Measurements, clamp_negative
from .photometric_samples import photometric, photometric_texels

__all__ = [
    "Measurements",
    "clamp_negative",
    "function_of",
    "load",
    "names",
    "photometric",
    "photometric_texels",
    "save_table",
]

__getattr__ = submodules(__name__)
