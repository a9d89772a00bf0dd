"""Error against seconds of a fit: Levenberg-Marquardt, the paper's RMSProp, Adam, and L-BFGS from SciPy.

One file, several numbers of samples, all methods one after the other on the same samples, the loss of each on all of
them. The descents start from the analytic fit, whose seconds count; RMSProp and Adam take 1,000 steps with gradients of
all samples, as the paper does. Every method runs twice: the second run counts, so nothing is compiled in it.
"""

from __future__ import annotations

import time
from pathlib import Path

import mi_enhance  # noqa: F401  (first: it finds the LLVM that Dr.Jit then loads)

import drjit as dr  # isort: skip
import common
import mitsuba as mi
import numpy as np
from drjit.opt import Adam, RMSProp
from scipy.optimize import minimize

from mi_enhance import Material, data, fit
from mi_enhance.analytic import parameters
from mi_enhance.benchmark.timing import clock, machine
from mi_enhance.fitting.analytic_fit import objective
from mi_enhance.fitting.rmsprop import descend
from mi_enhance.neural.enhanced_brdf import EnhancedBRDF
from mi_enhance.output.figure import sheet

_OPTIMISERS = {
    "RMSProp (the paper)": lambda p: RMSProp(lr=1e-3, alpha=0.9, params=p),
    "Adam": lambda p: Adam(lr=1e-2, params=p),
}
_COLUMNS = {
    "samples": ("samples", ",d"),
    "label": ("method", ""),
    "log_l1": ("log-L1", ".5f"),
    "seconds": ("s", ".2f"),
    "reached": ("s until within 1 % of its best", ".2f"),
}


def main() -> None:
    """Run the benchmark of the command line."""
    parser = common.parser(__doc__)
    parser.add_argument("data", nargs="?", default=str(common.BUNDLED / "rgl/ilm_solo_m_68_rgb.bsdf"))
    parser.add_argument("--samples", type=float, nargs="+", default=[1e3, 1e4, 1e5, 1e6])
    parser.add_argument("--steps", type=int, default=1000, help="of RMSProp and Adam (default: %(default)s)")
    parser.add_argument("-o", "--output", default="out/fit_convergence", help="folder of the picture")
    args = parser.parse_args()
    mi.set_variant("llvm_ad_rgb")
    about, rows, curves = machine("scipy"), [], {}
    for n in map(int, args.samples):
        measurements = data.load(args.data, n_samples=n)
        for label, run in _methods(measurements, args.steps).items():
            run(2)  # compiles
            curve = run(args.steps)
            curves[n, label] = curve
            losses = np.minimum.accumulate([loss for _, loss in curve])
            reached = curve[int(np.argmax(losses <= 1.01 * losses[-1]))][0]
            rows.append(
                {"samples": n, "label": label, "log_l1": losses[-1], "seconds": curve[-1][0], "reached": reached}
            )
    Path(args.output).mkdir(parents=True, exist_ok=True)
    _draw(curves, Path(args.output) / "fit_convergence.png")
    common.finish(rows, _COLUMNS, title=Path(args.data).stem, about=about, as_json=args.json)


def _methods(measurements, steps: int) -> dict:
    """Functions of the number of steps that return [(seconds, loss on all samples), ...]."""
    network = Material.pretrained("ggx2")
    seconds, analytic = clock(lambda: fit(Material.analytic(network.brdf.model.name), measurements))
    brdf: EnhancedBRDF = network.brdf
    values = {**parameters.initial(brdf.parameters), **analytic.params}
    problem = objective(brdf, measurements)
    first = problem.space.to_free(parameters.flatten(brdf.parameters, values))

    def lm(_):
        # its own analytic fit is among its seconds
        total, material = clock(lambda: fit(network, measurements))
        return [(total, material.report["log_l1"])]

    def by_steps(make, n):
        curve, start = [], time.perf_counter()
        optimizer = make({"u": mi.Float(first.astype(np.float32))})

        def report(_, loss):
            curve.append((seconds + time.perf_counter() - start, float(dr.mean(loss)[0])))

        descend(problem, optimizer, problem.space, n, report)
        return curve

    def lbfgs(n):
        curve, start = [], time.perf_counter()

        def f(u):
            flat = mi.Float(u.astype(np.float32))
            dr.enable_grad(flat)
            loss, gradient = problem.gradient(flat)
            value = float(dr.mean(loss)[0])
            curve.append((seconds + time.perf_counter() - start, value))
            return value, np.array(gradient, np.float64)

        minimize(
            f,
            first,
            jac=True,
            method="L-BFGS-B",
            bounds=list(zip(problem.space.low, problem.space.high, strict=True)),
            options={"maxiter": n, "maxfun": n},
        )
        return curve

    runs = {"Levenberg-Marquardt, many starts": lm}
    runs |= {label: (lambda n, make=make: by_steps(make, n)) for label, make in _OPTIMISERS.items()}
    return {**runs, "L-BFGS (SciPy)": lbfgs}


def _draw(curves: dict, path: Path) -> None:
    numbers = sorted({n for n, _ in curves})
    with sheet(path, (4.5 * len(numbers), 4.5), 90) as figure:
        for axes, n in zip(np.ravel(figure.subplots(1, len(numbers), squeeze=False)), numbers, strict=True):
            for (m, label), curve in curves.items():
                if m == n:
                    x, y = zip(*curve, strict=True)
                    axes.plot(x, np.minimum.accumulate(y), "*" if len(x) == 1 else "-", ms=12, label=label)
            axes.set(xlabel="seconds", ylabel="log-L1", xscale="log", yscale="log", title=f"{n:,} samples")
            axes.tick_params(axis="x", which="minor", labelbottom=False)  # they would run into each other
            axes.grid(alpha=0.3, which="both")
            axes.legend(fontsize=7)


if __name__ == "__main__":
    main()
