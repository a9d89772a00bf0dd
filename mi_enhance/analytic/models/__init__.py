"""Analytic reflectance models as graphs with named parameters: every enhancement starts from one (paper, section 3).

A model is a function with the decorator `@model`. To add one, write its file: all files of this folder are imported,
and `models.NAME` is the function. Those of the package are listed for editors and type checkers.
"""

from ...system.modules import import_all
from .abc import abc
from .ashikhmin_shirley import ashikhmin_shirley
from .cook_torrance import cook_torrance
from .from_text import from_expression, from_toml
from .ggx import ggx, ggx2, ggx_retro
from .model import Model
from .registry import MODELS, get
from .ward import ward

__all__ = [
    "MODELS",
    "Model",
    "abc",
    "ashikhmin_shirley",
    "cook_torrance",
    "from_expression",
    "from_toml",
    "get",
    "ggx",
    "ggx2",
    "ggx_retro",
    "ward",
]

import_all(__name__, __path__)
globals().update(MODELS)
