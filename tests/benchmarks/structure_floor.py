"""The floor of a structure before any training: its error if every network in it could say anything at all.

In place of networks each sample gets free scalars, at least 0; only the colours are constants of the material. A graph
with scalar modules then is a fixed colour (or none) plus a cone of colours: M + S D F G / E with constant rho_d and
rho_s is rho_d + s rho_s; a specular colour that turns white, s (rho_s + (max(rho_s) - rho_s) q) with q in [0, 1], is
the cone of rho_s and white. No training can do better; how near it comes is another matter.

For given colours the best scalars of a sample are those that match as many channels exactly as there are scalars, so
all such combinations are tried. (That is how a linear L1 problem is solved; the logarithm bends it by less than 0.1 %,
held against a grid search.) The colours are found by L-BFGS (SciPy, which scikit-image brings) from several starts.

Default data: the fifth of MERL that training keeps aside, from the NPs stand-ins. RGL files may be looked at with it,
but no structure is to be chosen by them.
"""

from __future__ import annotations

from itertools import combinations

import mi_enhance  # noqa: F401  (first: it finds the LLVM that Dr.Jit then loads)

import mitsuba as mi  # isort: skip
import common
import numpy as np
from scipy.optimize import minimize

from mi_enhance import Material, fit
from mi_enhance.benchmark.timing import machine

_SUBSET = 1500  # samples that the colours are found on; the floor is that of all
_STARTS = 3
# name: (is there a colour of scalar 1, colours with a free scalar, is white among the free ones)
STRUCTURES = {
    "rho_d + s rho_s": (True, 1, False),
    "b rho_d + s rho_s": (False, 2, False),
    "rho_d + s (rho_s .. white)": (True, 1, True),
    "b rho_d + s (rho_s .. white)": (False, 2, True),
    "rho_d + s1 rho_1 + s2 rho_2": (True, 2, False),
    "b rho_d + s1 rho_1 + s2 rho_2": (False, 3, False),
    "rho_d + s1 rho_1 + s2 rho_2 + s3 white": (True, 2, True),
}
_COLUMNS = {
    "structure": ("structure", ""),
    "log_l1": ("floor, log-L1", ".5f"),
    "ratio": ("to GGX", ".3f"),
    "worst_ratio": ("worst", ".3f"),
    "worst": ("at", ""),
}


def main() -> None:
    """Run the benchmark of the command line."""
    parser = common.parser(__doc__)
    parser.add_argument("data", nargs="*", help="RGL .bsdf (default: the fifth of MERL kept aside)")
    parser.add_argument("--samples", type=int, default=10_000)
    parser.add_argument("--count", type=int, help="only so many materials (default: all)")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    mi.set_variant("llvm_ad_rgb")
    about = machine()
    losses = {name: {} for name in ("GGX, fitted", *STRUCTURES)}
    for measurements in common.measurements(args.data, args.count, args.samples, args.seed):
        print(measurements.name, flush=True)
        report = fit(Material.analytic("ggx"), measurements, seed=args.seed).report
        losses["GGX, fitted"][measurements.name] = report["log_l1"]
        for name, structure in STRUCTURES.items():
            losses[name][measurements.name] = floor(measurements, *structure, seed=args.seed)
    ggx = losses["GGX, fitted"]
    rows = []
    for name, own in losses.items():
        worst = max(own, key=lambda material, own=own: own[material] / ggx[material])
        row = {"structure": name, "log_l1": float(np.mean(list(own.values()))), "worst": worst}
        rows.append(row | {"worst_ratio": own[worst] / ggx[worst]})
        rows[-1]["ratio"] = rows[-1]["log_l1"] / float(np.mean(list(ggx.values())))
    title = f"Mean of {len(ggx)} materials, {args.samples:,} samples"
    common.finish(rows, _COLUMNS, title=title, about=about, as_json=args.json)


def floor(measurements, constant: bool, free: int, white: bool, seed: int = 0) -> float:
    """Least log-L1 of one structure on all samples of a material.

    Parameters
    ----------
    measurements : Measurements
    constant : bool
        A colour that every sample has, with the scalar 1.
    free : int
        Colours of the material with a free scalar in every sample.
    white : bool
        White with a free scalar as well.
    seed : int
        Of the starts.

    Returns
    -------
    float
    """
    rng = np.random.default_rng(seed)
    f, cos = measurements.f.astype(np.float64), measurements.wo[:, 2:].astype(np.float64)
    some = rng.permutation(len(f))[:_SUBSET]

    def colours(x):
        c = np.exp(x.reshape(-1, 3))
        base, cone = (c[0], c[1:]) if constant else (np.zeros(3), c)
        return base, np.concatenate([cone, np.ones((1, 3))]) if white else cone

    def loss(x):
        return float(residual(*colours(x), f[some], cos[some]).mean())

    starts = [_start(f, cos, constant, free, rng) for _ in range(_STARTS)]
    # 1e-3: the loss has kinks in every sample; a shorter difference sees those of single samples
    options = {"eps": 1e-3, "maxiter": 60}
    best = min((minimize(loss, x, method="L-BFGS-B", options=options) for x in starts), key=lambda r: r.fun)
    return float(residual(*colours(best.x), f, cos).mean())


def residual(base, cone, f, cos) -> np.ndarray:
    """Least mean over channels of abs(log(1 + f cos) differences) of each sample, (N,), for given colours.

    Parameters
    ----------
    base : array (3,)
        Colour with the scalar 1.
    cone : array (K, 3)
        Colours with free scalars.
    f : array (N, 3)
    cos : array (N, 1)
    """
    truth = np.log1p(f * cos)
    best = np.abs(truth - np.log1p(base * cos)).sum(1)  # all scalars 0
    for size in range(1, min(3, len(cone)) + 1):
        for members in combinations(range(len(cone)), size):
            for channels in combinations(range(3), size):
                matrix = cone[list(members)][:, list(channels)]
                if abs(np.linalg.det(matrix)) < 1e-9 * np.abs(matrix).max() ** size:
                    continue  # colours that are one and the same in these channels
                scalars = np.maximum((f - base)[:, list(channels)] @ np.linalg.inv(matrix), 0)
                value = base + scalars @ cone[list(members)]
                np.minimum(best, np.abs(truth - np.log1p(value * cos)).sum(1), out=best)
    return best / 3


def _start(f, cos, constant: bool, free: int, rng) -> np.ndarray:
    """Logarithms of colours to start from: of a dark sample for the constant one, of random samples for the rest."""
    dark = np.quantile(f, rng.uniform(0.05, 0.5), axis=0)
    # by their part of the loss: a dark sample's colour matters little
    weights = np.log1p(f * cos).sum(1)
    picked = f[rng.choice(len(f), free, replace=False, p=weights / weights.sum())]
    picked = picked / np.maximum(picked.max(1, keepdims=True), 1e-9)
    return np.log(np.concatenate([dark[None], picked] if constant else [picked]).clip(1e-4)).ravel()


if __name__ == "__main__":
    main()
