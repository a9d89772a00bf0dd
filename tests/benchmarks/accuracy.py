"""Log-L1 of plain and enhanced GGX on measured RGL files, both fitted by the same method: ratio, mean and worst.

With ``--render`` also SSIM and Delta E_ITP on the Standard Shader Ball, by ``mi_enhance.compare``, which then fits too.
Writes ``accuracy.csv``, ``.json`` and ``.md`` into the folder of ``-o``.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import mi_enhance  # noqa: F401  (first: it finds the LLVM that Dr.Jit then loads)

import mitsuba as mi  # isort: skip
from common import finish, machine

from mi_enhance import Material, data, fit
from mi_enhance.compare import compare_files, default_models
from mi_enhance.data._io import material_name
from mi_enhance.table import write_table

_ROOT = Path(__file__).resolve().parents[2]
_COLUMNS = {
    "material": ("material", ""),
    "ggx_log_l1": ("log-L1, GGX", ".5f"),
    "enhanced_log_l1": ("enhanced", ".5f"),
    "ratio": ("ratio", ".3f"),
    "enhanced_fit_seconds": ("fit s", ".1f"),
}
_RENDERED = {
    "ggx_ssim": ("SSIM, GGX", ".4f"),
    "enhanced_ssim": ("enhanced", ".4f"),
    "ggx_delta_E_ITP_1000": ("ΔE ITP x1000, GGX", ".2f"),
    "enhanced_delta_E_ITP_1000": ("enhanced", ".2f"),
}


def main() -> None:
    """Run the benchmark of the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", nargs="*", help="RGL .bsdf (default: data/rgl/*.bsdf)")
    parser.add_argument("--network", help="network to fit (default: the shipped ggx)")
    parser.add_argument("--method", default="lm", choices=("lm", "rmsprop"))
    parser.add_argument("--samples", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--render", action="store_true", help="SSIM and Delta E_ITP on the shader ball, too")
    parser.add_argument("--resolution", type=int, default=256)
    parser.add_argument("--spp", type=int, default=256)
    parser.add_argument("-o", "--output", default="out/accuracy", help="folder (default: %(default)s)")
    parser.add_argument("--json", action="store_true", help="print one JSON object last")
    args = parser.parse_args()
    mi.set_variant("llvm_ad_rgb")
    about = machine()
    paths = args.data or sorted((_ROOT / "data/rgl").glob("*.bsdf"))
    network = Material.load(args.network) if args.network else Material.network("ggx")
    rows = _rendered(args, paths, network) if args.render else [_fitted(args, path, network) for path in paths]
    for row in rows:
        row["ratio"] = row["enhanced_log_l1"] / row["ggx_log_l1"]
    columns = _COLUMNS | (_RENDERED if args.render else {})
    rows += [_mean(rows, columns), {**max(rows, key=lambda row: row["ratio"])}]
    rows[-1]["material"] = f"worst: {rows[-1]['material']}"
    Path(args.output).mkdir(parents=True, exist_ok=True)
    write_table(rows, Path(args.output) / "accuracy", columns)
    finish(rows, columns, title=f"{args.samples:,} samples, {args.method}", about=about, as_json=args.json)


def _fitted(args, path, network: Material) -> dict:
    """A fit of the enhanced model fits its analytic ancestor first, by the same method."""
    measurements = data.load(path, n_samples=args.samples, seed=args.seed, kind="rgl")
    report = fit(network, measurements, method=args.method, seed=args.seed).report
    return {
        "material": material_name(path),
        "ggx_log_l1": report["log_l1_analytic"],
        "enhanced_log_l1": report["log_l1"],
        "enhanced_fit_seconds": report["seconds"],
    }


def _rendered(args, paths, network: Material) -> list[dict]:
    """One row per material from the three of `compare_files` (truth, GGX, enhanced)."""
    result = compare_files(
        paths, out_dir=args.output, models=default_models(network), method=args.method, n_samples=args.samples,
        seed=args.seed, resolution=args.resolution, spp=args.spp, log=print,
    )  # fmt: skip
    rows = []
    for start in range(0, len(result["rows"]), 3):
        _, *models = result["rows"][start : start + 3]
        row = {"material": models[0]["material"]}
        for name, model in zip(("ggx", "enhanced"), models, strict=True):
            row |= {f"{name}_{key}": model[key] for key in ("log_l1", "fit_seconds", "ssim", "delta_E_ITP_1000")}
        rows.append(row)
    return rows


def _mean(rows: list[dict], columns: dict) -> dict:
    """Means; the ratio is that of the mean losses."""
    mean = {key: sum(row[key] for row in rows) / len(rows) for key in columns if key != "material"}
    return {"material": f"mean of {len(rows)}", **mean, "ratio": mean["enhanced_log_l1"] / mean["ggx_log_l1"]}


if __name__ == "__main__":
    main()
