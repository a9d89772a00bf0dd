"""Code that the benchmarks share: arguments, bundled data, names of folders, a reciprocal truth, the end of a run."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
BUNDLED = ROOT / "mi_enhance/bundled"


def parser(description: str) -> argparse.ArgumentParser:
    """The command line of a benchmark, with the options that all have."""
    result = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    result.add_argument("--json", action="store_true", help="print one JSON object last")
    return result


def rgl_files(given: Sequence[str]) -> list[Path]:
    """The files given, else the bundled ones."""
    return [Path(name) for name in given] or sorted((BUNDLED / "rgl").glob("*.bsdf"))


def keep_settings(args: argparse.Namespace) -> None:
    """Keep the options of a run in its folder: what it leaves there is not taken for that of other options."""
    from mi_enhance.system import run_folder

    no_settings = ("json", "output", "data", "round_trip", "restarts")
    settings = {name: value for name, value in vars(args).items() if name not in no_settings}
    run_folder.keep_settings(Path(args.output) / "settings.json", settings, Path(sys.argv[0]).name)


def measurements(files: Sequence[str], count: int | None, n_samples: int, seed: int = 0):
    """Yield the measurements of files; without any those of the fifth of MERL that training keeps aside."""
    from mi_enhance import data
    from mi_enhance.training.sources import HELD_OUT_EVERY

    for path in files[:count]:
        yield data.load(path, n_samples=n_samples, seed=seed)
    merl = BUNDLED / "nps/merl.npz"
    for name in [] if files else data.names(merl)[HELD_OUT_EVERY - 1 :: HELD_OUT_EVERY][:count]:
        yield data.load(merl, material=name, n_samples=n_samples, seed=seed)


def folder_name(label: str) -> str:
    """The label of a run as the name of its folder."""
    return "".join(c if c.isalnum() else "_" for c in label)


def shipped() -> dict:
    """Materials with the parameters that every analytic model and network of the package starts from."""
    from mi_enhance import Material, models
    from mi_enhance.system.bundled_files import network_file

    result = {name: Material.analytic(name) for name in sorted(models.MODELS)}
    networks = sorted(network_file("ggx").parent.glob("*.bsdf"))
    return result | {f"network {path.stem}": Material.load(path) for path in networks}


def network(name: str):
    """A shipped network, or one of a file, in the form whose few numbers texels and photographs determine."""
    from mi_enhance import Material
    from mi_enhance.material.low_rank import of_low_rank

    return of_low_rank(Material.load(name) if name.endswith(".bsdf") else Material.pretrained(name), name)


def averaged(measurements, path):
    """The reflectance of an RGL file, (N, 3), as the average of both orders of each pair: reciprocal.

    What NPs was made from: f = (max(e(wi, wo), 0) + max(e(wo, wi), 0)) / (cos_i + cos_o), e with its cosine.
    """
    import numpy as np

    from mi_enhance.data import rgl

    wi, wo = measurements.wi, measurements.wo
    cos_i, cos_o = wi[:, 2:], wo[:, 2:]
    return (measurements.f * cos_o + np.maximum(rgl.evaluate(path, wo, wi) * cos_i, 0)) / (cos_i + cos_o)


def finish(rows: list[dict], columns: dict, *, title: str, about: dict, as_json: bool) -> None:
    """Print the table and the machine; one JSON object last if asked for."""
    from mi_enhance.output.table import print_table

    print_table(rows, columns, title=title)
    print(", ".join(f"{key} {value}" for key, value in about.items()))
    if as_json:
        print(json.dumps({"machine": about, "rows": rows}))
