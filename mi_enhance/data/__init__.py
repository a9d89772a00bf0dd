"""Measured reflectance in, one record out: `load` finds the reader, `Measurements` is what every fit takes.

One reader per file beside this one; each turns "light" and "view" of its source into `wo` and `wi` (DESIGN.md,
section 3) and draws its pairs of directions as section 6 of the paper does (`sampling.py`).
"""

from __future__ import annotations

import difflib
import importlib
import zipfile
from dataclasses import dataclass, field

import numpy as np

from ..system import files
from ..system import npz
from ..system import tensor_file

__all__ = ["KINDS", "Measurements", "clamp_negative", "load", "names", "save_table"]






















