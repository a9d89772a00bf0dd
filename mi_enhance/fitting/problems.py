"""The loss of a BRDF on samples, of the kind that its networks ask for."""

from __future__ import annotations

import mitsuba as mi
import numpy as np

from ..neural.enhanced_brdf import EnhancedBRDF
from .code_objective import CodeObjective
from .objective import Objective
from .trunk_objective import TrunkObjective


def objective_of(brdf: EnhancedBRDF, wi: mi.Vector3f, wo: mi.Vector3f, f: mi.Color3f, n: int) -> Objective:
    """Return the loss of a BRDF; arguments as of :class:`mi_enhance.fitting.objective.Objective`."""
    if not brdf.trunk:
        return Objective(brdf, wi, wo, f, n)
    return (CodeObjective if brdf.trunk.basis else TrunkObjective)(brdf, wi, wo, f, n)


def stacked(brdf: EnhancedBRDF, wi: np.ndarray, wo: np.ndarray, f: np.ndarray) -> Objective:
    """Return the objective of B problems with n samples each, from arrays.

    Parameters
    ----------
    brdf : EnhancedBRDF
    wi, wo : array (n, 3) or (B, n, 3)
        Unit vectors towards viewer and light, the same for all problems or of each.
    f : array (B, n, 3)
        Reflectance, 1/sr, at least 0.

    Examples
    --------
    >>> from mi_enhance.neural.enhance import enhance
    >>> stacked(enhance("ggx", ()), np.array([[0, 0, 1.0]]), np.array([[0, 0.6, 0.8]]), np.ones((7, 1, 3))).n_problems
    7
    """
    n = f.shape[1]
    wi, wo, f = (np.broadcast_to(a, f.shape).reshape(-1, 3).T.astype(np.float32, order="C") for a in (wi, wo, f))
    return objective_of(brdf, mi.Vector3f(wi), mi.Vector3f(wo), mi.Color3f(f), n)
