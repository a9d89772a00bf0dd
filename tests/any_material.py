"""Random parameters of any model, and pairs of directions up to grazing ones."""

from __future__ import annotations

import numpy as np
import twin

# Narrower than what is allowed, where float32 directions still say something of the lobe.
USUAL = {
    "n_x": (-0.2, 0.2), "n_y": (-0.2, 0.2), "rho_s": (0, 4), "alpha_x": (0.05, 1), "alpha_y": (0.05, 1),
    "rho_s2": (0, 4), "alpha_x2": (0.05, 1), "alpha_y2": (0.05, 1),
    "A": (0.1, 100), "B": (3, 1e5), "C": (0.1, 3), "ior": (1.05, 20), "n_u": (1, 800), "n_v": (1, 800),
}  # fmt: skip
ROUGHNESSES = ("alpha_x", "alpha_y", "alpha_x2", "alpha_y2")


def materials(model, n, seed=0, usual=USUAL):
    """n random materials, (n, size) each, as float32 holds them."""
    rng = np.random.default_rng(seed)
    result = {}
    for p in model.parameters:
        low, high = usual.get(p.name, usual.get(p.name.split("_")[0], (p.low, p.high)))  # norm_F: norm
        to, back = (np.log, np.exp) if p.log else (np.array, np.array)
        result[p.name] = back(rng.uniform(to(low), to(high), (n, p.size)))
    return {name: v.astype(np.float32).astype(np.float64) for name, v in result.items()}


def pairs(n, seed=1):
    """Random, mirrored, and grazing down to a cosine of 1e-4."""
    wi, wo = twin.pairs(n, seed)
    wo[::3] = wi[::3] * [-1, -1, 1]
    for w, k in ((wi, 1), (wo, 2)):
        w[k::3, 2] = np.geomspace(1e-4, 1, len(w[k::3]))
    return tuple(twin.unit(w).astype(np.float32) for w in (wi, wo))


def given(p, row=0):
    """One of the materials."""
    return {name: v[row] for name, v in p.items()}
