"""Analytic terms of reflectance models, one function each, with its source. They read like the textbook.

A file for each letter of the paper. A term that can stand in a slot of any model registers itself with `@term`. To add
one, write it into such a file or into a new one: all files of this folder are imported, and `terms.NAME` is the
function. Those of the package are listed for editors and type checkers. Arguments are bound by name, see
:mod:`mi_enhance.analytic.geometry` and :mod:`mi_enhance.analytic.parameters`.
"""

from ...system.modules import import_all
from .diffuse import B_ashikhmin_shirley, B_lambert, M_lambert
from .diffuse_rough import B_eon
from .distribution import D_ashikhmin_shirley, D_beckmann, D_ggx, D_ward
from .distribution_abc import D_abc, D_abc_normalised
from .distribution_tails import D_generalized_beckmann, D_hyper_cauchy, D_student_t
from .fresnel import F_cook_torrance, F_dielectric, F_schlick
from .normalization import inv_E, inv_E_ashikhmin_shirley, inv_E_pi, inv_E_ward
from .registry import ALTERNATIVES
from .retro import D_retro_ggx, F_retro_schlick
from .shadowing import G_smith_ggx, G_v_cavity
from .specular import S_abc, S_constant

__all__ = [
    "B_ashikhmin_shirley",
    "B_eon",
    "B_lambert",
    "D_abc",
    "D_abc_normalised",
    "D_ashikhmin_shirley",
    "D_beckmann",
    "D_generalized_beckmann",
    "D_ggx",
    "D_hyper_cauchy",
    "D_retro_ggx",
    "D_student_t",
    "D_ward",
    "F_cook_torrance",
    "F_dielectric",
    "F_retro_schlick",
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

import_all(__name__, __path__)
globals().update({name: alternative.term for name, alternative in ALTERNATIVES.items()})
