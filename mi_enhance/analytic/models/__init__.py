"""Analytic reflectance models as graphs with named parameters: what an enhancement starts from (paper, section 3)."""

from .abc import abc
from .ashikhmin_shirley import ashikhmin_shirley
from .cook_torrance import cook_torrance
from .ggx import ggx, ggx2
from .model import Model
from .registry import MODELS, from_expression, get, registered
from .ward import ward

__all__ = [
    "MODELS",
    "Model",
    "abc",
    "ashikhmin_shirley",
    "cook_torrance",
    "from_expression",
    "get",
    "ggx",
    "ggx2",
    "registered",
    "ward",
]
