"""Mitsuba's own BSDFs fitted to measurements, for comparison."""

from __future__ import annotations

import time

import mitsuba as mi
import numpy as np

from ..data.measurements import Measurements
from ..numerics.arrays import vector3f

# Parameters and their bounds. A parameter that is 0 when the plugin is made is left out for good: starts are inside.
MITSUBA = {
    "roughconductor": {"alpha": (1e-3, 1, 1), "specular_reflectance": (0, 1, 3)},
    "principled": {
        "base_color": (0, 1, 3),
        "roughness": (0.02, 1, 1),
        "metallic": (0, 1, 1),
        "specular": (0.01, 1, 1),
        "spec_tint": (0, 1, 1),
        "sheen": (0, 1, 1),
        "sheen_tint": (0, 1, 1),
        "clearcoat": (0, 1, 1),
        "clearcoat_gloss": (0, 1, 1),
    },
}


_MITSUBA_SAMPLES = 4096
_ROUGH = (0.1, 0.3, 0.6)  # roughness of the starts


def fit_mitsuba(plugin: str, measurements: Measurements, *, seed: int = 0) -> tuple[dict, float]:
    """Fit a BSDF of Mitsuba to measurements: SciPy's bounded least squares, several starts, the same loss (soft L1).

    Parameters
    ----------
    plugin : str
        A key of `MITSUBA`.
    measurements : Measurements
    seed : int
        Of the samples that are used.

    Returns
    -------
    dict
        For ``mi.load_dict``.
    seconds : float
    """
    from scipy.optimize import least_squares

    start = time.perf_counter()
    bounds = MITSUBA[plugin]
    low, high = (np.concatenate([np.full(n, b[k], float) for *b, n in bounds.values()]) for k in (0, 1))
    index = np.random.default_rng(seed).permutation(len(measurements.f))[:_MITSUBA_SAMPLES]
    wi, wo = vector3f(measurements.wi[index]), vector3f(measurements.wo[index])
    truth = np.log1p(measurements.f[index] * measurements.wo[index, 2:])
    si = mi.SurfaceInteraction3f()
    si.wi = wi
    bsdf = mi.load_dict(_plugin(plugin, 0.5 * (low + high)))
    params = mi.traverse(bsdf)

    def residuals(u: np.ndarray) -> np.ndarray:
        for key, value in _values(plugin, u).items():
            name = f"{key}.value" if f"{key}.value" in params else key
            params[name] = value if np.ndim(value) else float(value)
        params.update()
        value = np.array(bsdf.eval(mi.BSDFContext(), si, wo), np.float64).T  # with the cosine
        return (np.log1p(np.maximum(np.nan_to_num(value), 0)) - truth).ravel()

    best: tuple[float, np.ndarray] | None = None
    for rough in _ROUGH:
        first = _values(plugin, 0.5 * (low + high))
        first["roughness" if "roughness" in first else "alpha"] = rough
        u = np.clip(np.concatenate([np.ravel(v) for v in first.values()]), low + 1e-3, high - 1e-3)
        # 1e-3: float32 values change by 1e-7 of themselves; smaller steps would differentiate rounding
        found = least_squares(
            residuals, u, bounds=(low, high), loss="soft_l1", f_scale=0.01, diff_step=1e-3, max_nfev=25
        )
        error = float(np.abs(found.fun).mean())
        if best is None or error < best[0]:
            best = error, found.x
    assert best is not None  # there is a start
    return _plugin(plugin, best[1]), time.perf_counter() - start


def _values(plugin: str, u: np.ndarray) -> dict:
    """Parameters by name; a single number, or three of a colour."""
    result, k = {}, 0
    for name, (_, _, n) in MITSUBA[plugin].items():
        result[name] = float(u[k]) if n == 1 else [float(v) for v in u[k : k + n]]
        k += n
    return result


def _plugin(plugin: str, u: np.ndarray) -> dict:
    values = {k: {"type": "rgb", "value": v} if isinstance(v, list) else v for k, v in _values(plugin, u).items()}
    extra = {"distribution": "ggx", "material": "none"} if plugin == "roughconductor" else {}
    return {"type": plugin, **extra, **values}
