"""Beyond the usual case: anisotropic kinds that no training set holds, and few or odd samples of the RGL files.

- *Anisotropic*: Ward and mixtures of two Beckmann lobes, rotated by 0 to 180 degrees, in random colours
  (``mi_enhance.data.synthetic``). Error: eq. (1) over the samples of the fit.
- *Odd samples*: the fit sees only 1,000 random pairs; only retro-reflective ones, both directions within 3 degrees of
  each other (the paper's Fig. 7); only pairs in one plane with the normal; or random pairs with 10 % multiplicative
  noise. The errors are those of ``accuracy.py``, over the usual random pairs, which the fits of the first case have
  seen and no others. NBRDF is trained on the same samples.

Ratios are those of the means to GGX; *worst* is the largest ratio of a single material. Writes ``anisotropic`` and
``samples`` as ``.csv``, ``.json``, ``.md`` into the folder of ``-o``, with every fit beside them, from which an
interrupted run goes on. With the folder of ``accuracy.py`` its fits are used again.
"""

from __future__ import annotations

from pathlib import Path

import mi_enhance  # noqa: F401  (first: it finds the LLVM that Dr.Jit then loads)

import mitsuba as mi  # isort: skip
import common
import numpy as np
import rivals
from accuracy import errors

from mi_enhance import data
from mi_enhance.benchmark import odd_samples
from mi_enhance.benchmark.timing import machine
from mi_enhance.data import synthetic
from mi_enhance.fitting.losses import log_l1
from mi_enhance.output.table import print_table, write_table
from mi_enhance.system.files import material_name

_KINDS = (synthetic.ward_anisotropic, synthetic.beckmann_mixture)
_FEW = 1000
_NOISE = 0.1
_COLUMNS = {
    "case": ("case", ""),
    "label": ("model", ""),
    "log_l1": ("log-L1", ".5f"),
    "log_l1_ratio": ("ratio", ".3f"),
    "log_l1_80": ("< 80°", ".5f"),
    "log_l1_80_ratio": ("ratio", ".3f"),
    "worst_ratio": ("worst", ".3f"),
    "worst": ("at", ""),
}


def main() -> None:
    """Run the benchmark of the command line."""
    parser = common.parser(__doc__)
    parser.add_argument("data", nargs="*", help="RGL .bsdf (default: mi_enhance/bundled/rgl/*.bsdf)")
    rivals.add_options(parser)
    parser.add_argument("--count", type=int, default=10, help="materials of each anisotropic kind (default: 10)")
    parser.add_argument("--ours", action="store_true", help="without NBRDF, whose training takes the most time")
    parser.add_argument("-o", "--output", default="out/generalization", help="folder (default: %(default)s)")
    args = parser.parse_args()
    mi.set_variant("llvm_ad_rgb")
    about = machine()
    models = rivals.ours(args)
    anisotropic = []
    for draw in _KINDS:
        print(draw.__name__, flush=True)
        rows = [row for seed in range(args.count) for row in _synthetic(args, draw(seed, args.samples), models)]
        anisotropic += [_mean(draw.__name__, rows, rival.label) for rival in models]
    if not args.ours:
        models.append(rivals.nbrdf_trained(args.seed))
    samples = []
    for case in _CASES:
        print(case, flush=True)
        paths = common.rgl_files(args.data)
        rows = [row for path in paths for row in _odd(args, case, path, models)]
        samples += [_mean(case, rows, rival.label) for rival in models]
    for name, rows in (("anisotropic", anisotropic), ("samples", samples)):
        write_table(rows, Path(args.output) / name, _present(rows))
    print_table(anisotropic, _present(anisotropic), title=f"Unseen anisotropic kinds, {args.count} materials each")
    title = f"Fits to few and odd samples of {len(paths)} RGL files"
    common.finish(samples, _present(samples), title=title, about=about, as_json=args.json)


def _synthetic(args, measurements: data.Measurements, models: list[rivals.Rival]) -> list[dict]:
    """One row per model."""
    folder = _folder(args, measurements.name)

    def row(rival):
        f = rival.fit(measurements, folder).evaluate(measurements.wi, measurements.wo)
        return {"log_l1": log_l1(f, measurements.f, measurements.wo[:, 2])}

    return _rows(args, folder, measurements, models, row)


def _odd(args, case: str, path, models: list[rivals.Rival]) -> list[dict]:
    """One row per model, fitted to the samples of a case and judged on the usual ones."""
    folder = _folder(args, material_name(path))
    usual = data.load(path, n_samples=args.samples, seed=args.seed, kind="rgl")
    seen = _CASES[case](path, args.samples, args.seed)
    return _rows(args, folder, seen, models, lambda rival: errors(rival.fit(seen, folder).evaluate, usual, path))


def _rows(args, folder: Path, seen: data.Measurements, models: list[rivals.Rival], row) -> list[dict]:
    result = []
    for rival in models:
        # the number of samples decides what the fit is judged on, too
        file = rival.stem(seen, folder).with_suffix(f".{args.samples}.json")
        result.append({"material": seen.name, "label": rival.label, **rivals.kept(file, lambda r=rival: row(r))})
    return result


def _folder(args, name: str) -> Path:
    folder = Path(args.output) / name
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def _mean(case: str, rows: list[dict], label: str) -> dict:
    """Means of one model; the ratios are those of the means."""
    own, reference = ([row for row in rows if row["label"] == name] for name in (label, rivals.REFERENCE))
    mean = {"case": case, "label": label, "n_materials": len(own)}
    for error in ("log_l1", "log_l1_80"):
        if error in own[0]:
            mean[error] = float(np.mean([row[error] for row in own]))
            mean[f"{error}_ratio"] = mean[error] / float(np.mean([row[error] for row in reference]))
    ratios = {row["material"]: row["log_l1"] / r["log_l1"] for row, r in zip(own, reference, strict=True)}
    worst = max(ratios, key=ratios.get)
    return {**mean, "worst_ratio": ratios[worst], "worst": worst}


def _present(rows: list[dict]) -> dict:
    return {key: column for key, column in _COLUMNS.items() if key in rows[0]}


# ---------------------------------------------------------------------- what the fit sees of an RGL file


def _usual(path, n: int, seed: int) -> data.Measurements:
    return data.load(path, n_samples=n, seed=seed, kind="rgl")


def _few(path, n: int, seed: int) -> data.Measurements:
    return data.load(path, n_samples=min(n, _FEW), seed=seed + 1, kind="rgl")


def _noisy(path, n: int, seed: int) -> data.Measurements:
    m = data.load(path, n_samples=n, seed=seed + 1, kind="rgl")
    noise = np.random.default_rng(seed).normal(1, _NOISE, m.f.shape)
    return data.Measurements(m.wi, m.wo, np.maximum(m.f * noise, 0), m.name, m.source)


_CASES = {
    "all random samples": _usual,
    f"{_FEW:,} random samples": _few,
    "only retro-reflective": odd_samples.retro_reflective,
    "only in-plane": odd_samples.in_plane,
    "10 % noise": _noisy,
}


if __name__ == "__main__":
    main()
