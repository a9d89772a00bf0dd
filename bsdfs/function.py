"""Any reflectance function as a BSDF, sampled like an enhanced material: so models that are not ours are rendered."""

from __future__ import annotations

from collections.abc import Callable

import drjit as dr
import mitsuba as mi
import numpy as np

from mi_enhance.material.material import Material


def of_function(f: Callable, lobe: Material) -> mi.BSDF:
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
    >>> half = of_function(lambda wi, wo: mi.Color3f(0.5 / dr.pi), Material.analytic("ggx"))
    >>> si = mi.SurfaceInteraction3f()
    >>> si.wi = mi.Vector3f(0, 0, 1)
    >>> half.eval(mi.BSDFContext(), si, si.wi).x.numpy().round(4)
    array([0.1592], dtype=float32)
    """
    from mi_enhance.bsdfs.enhanced import Enhanced  # valid in the active variant only, as every plugin class

    class Function(Enhanced):
        def _eval(self, si, wo, form, params, folded, active):
            return dr.select(active, f(si.wi, wo) * mi.Frame3f.cos_theta(wo), 0)

    props = mi.Properties("function")
    for key, value in lobe.to_dict().items():
        if key != "type":
            props[key] = value
    return Function(props)


def reflectance(bsdf: mi.BSDF, wi: np.ndarray, wo: np.ndarray) -> np.ndarray:
    """The other way: f_r in 1/sr of any BSDF, linear RGB, (N, 3), for unit vectors (N, 3) above the horizon.

    Examples
    --------
    >>> half = mi.load_dict({"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.5}})
    >>> reflectance(half, np.array([[0, 0, 1.0]]), np.array([[0, 0.6, 0.8]])).round(4)
    array([[0.1592, 0.1592, 0.1592]])
    """
    si = mi.SurfaceInteraction3f()
    si.wi, light = (mi.Vector3f(np.ascontiguousarray(np.asarray(w, np.float32).T)) for w in (wi, wo))
    return np.array(bsdf.eval(mi.BSDFContext(), si, light)).T / wo[:, 2:]
