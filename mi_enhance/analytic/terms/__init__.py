"""Analytic terms of reflectance models, one function each, with its source. They read like the textbook.

A file for each letter of the paper. A term that can stand in a slot of any model registers itself with `@term`; to add
one, write its file and import it here. Arguments are bound by name, see :mod:`mi_enhance.analytic.geometry` and
:mod:`mi_enhance.analytic.parameters`.
"""

from .diffuse import B_ashikhmin_shirley, B_lambert, M_lambert
from .distribution import D_ashikhmin_shirley, D_beckmann, D_ggx, D_ward
from .distribution_abc import D_abc, D_abc_normalised
from .fresnel import F_cook_torrance, F_dielectric, F_schlick
from .normalization import inv_E, inv_E_ashikhmin_shirley, inv_E_pi, inv_E_ward
from .shadowing import G_smith_ggx, G_v_cavity
from .specular import S_abc, S_constant

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
