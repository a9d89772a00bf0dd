"""Analytic terms of reflectance models, one function each, with its source. They read like the textbook.

A file for each letter of the paper. Arguments are bound by name, see :mod:`mi_enhance.analytic.geometry` and
:mod:`mi_enhance.analytic.parameters`.
"""

from .diffuse import B_ashikhmin_shirley
from .diffuse import B_lambert
from .diffuse import M_lambert
from .distribution import D_abc
from .distribution import D_abc_normalised
from .distribution import D_ashikhmin_shirley
from .distribution import D_beckmann
from .distribution import D_ggx
from .distribution import D_ward
from .fresnel import F_cook_torrance
from .fresnel import F_dielectric
from .fresnel import F_schlick
from .normalization import inv_E
from .normalization import inv_E_ashikhmin_shirley
from .normalization import inv_E_pi
from .normalization import inv_E_ward
from .shadowing import G_smith_ggx
from .shadowing import G_v_cavity
from .specular import S_abc
from .specular import S_constant

__all__ = [
    "B_ashikhmin_shirley",
    "B_lambert",
    "D_abc",
    "D_abc_normalised",
    "D_ashikhmin_shirley",
    "D_beckmann",
    "D_ggx",
    "D_ward",
    "F_cook_torrance",
    "F_dielectric",
    "F_schlick",
    "G_smith_ggx",
    "G_v_cavity",
    "M_lambert",
    "S_abc",
    "S_constant",
    "inv_E",
    "inv_E_ashikhmin_shirley",
    "inv_E_pi",
    "inv_E_ward",
]
