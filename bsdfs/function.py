"""Any reflectance function as a BSDF, sampled like an enhanced material: so models that are not ours are rendered."""

from __future__ import annotations

from collections.abc import Callable

import mitsuba as mi

from mi_enhance._moved import names_of
from mi_enhance.material.material import Material

__getattr__ = names_of("bsdfs.function")  # the names of version 0.1


def function_bsdf(f: Callable, lobe: Material) -> mi.BSDF:
    """A BSDF of the active variant.

    Parameters
    ----------
    f : callable
        ``f(wi, wo) -> mi.Color3f``, reflectance in 1/sr for directions (``mi.Vector3f``) towards viewer and light,
        above the horizon, in the frame of the surface.
    lobe : Material
        Directions are drawn as for this material: a fitted GGX, say.

    Returns
    -------
    mi.BSDF
        One-sided.

    Examples
    --------
    >>> half = function_bsdf(lambda wi, wo: mi.Color3f(0.5 / 3.1415927), Material.analytic("ggx"))
    >>> si = mi.SurfaceInteraction3f()
    >>> si.wi = mi.Vector3f(0, 0, 1)
    >>> half.eval(mi.BSDFContext(), si, si.wi).x.numpy().round(4)
    array([0.1592], dtype=float32)
    """
    from mi_enhance.bsdfs.enhanced import Enhanced  # valid in the active variant only, as every plugin class

    props = mi.Properties("function")
    for key, value in lobe.to_dict().items():
        if key != "type":
            props[key] = value
    return Enhanced(props, f)
