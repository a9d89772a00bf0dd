"""Fits of retro-reflective materials: a lobe by the back vector beside GGX, and other tails.

    python tests/benchmarks/retro.py retro-3M-jaune.dat retro-gray-tape.dat

log-L1 over all rows of each file (a third of them, drawn by seed, are held out and judged apart), all models by the
same fit. Files are those of any reader.
"""

from __future__ import annotations

import argparse
import dataclasses
import time

import numpy as np

import mi_enhance as me

import mitsuba as mi  # isort: skip
from mi_enhance.analytic.alternative_terms import with_terms
from mi_enhance.neural.enhance import enhance
from mi_enhance.output.table import markdown

CONTENDERS = {
    "ggx": ("ggx", {}),
    "ggx2": ("ggx2", {}),
    "ggx2, Student-t": ("ggx2", {"D": "D_student_t", "D2": "D_student_t"}),
    "ggx2, generalized Beckmann": ("ggx2", {"D": "D_generalized_beckmann", "D2": "D_generalized_beckmann"}),
    "ggx2, Hyper-Cauchy": ("ggx2", {"D": "D_hyper_cauchy", "D2": "D_hyper_cauchy"}),
    "ggx_retro": ("ggx_retro", {}),
    "ggx_retro, EON": ("ggx_retro", {"B": "B_eon"}),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="+")
    args = parser.parse_args()
    mi.set_variant("llvm_ad_rgb")
    rows = []
    for name, (model, terms) in CONTENDERS.items():
        row: dict = {"model": name}
        for path in args.files:
            m = me.data.load(path)
            aside = np.random.default_rng(0).random(len(m.f)) < 1 / 3
            seen = dataclasses.replace(m, wi=m.wi[~aside], wo=m.wo[~aside], f=m.f[~aside])
            start = time.perf_counter()
            brdf = enhance(with_terms(me.models.get(model), terms), ())
            material = me.fit(me.Material(brdf, {}), seen)
            error = np.abs(np.log1p(material.evaluate(m.wi, m.wo) * m.wo[:, 2:]) - np.log1p(m.f * m.wo[:, 2:])).mean(1)
            row |= {f"{m.name} log-L1": error.mean(), f"{m.name} held out": error[aside].mean()}
            row["seconds"] = row.get("seconds", 0) + time.perf_counter() - start
        print(row, flush=True)
        rows.append(row)
    print(markdown(rows, {key: (key, ".4f" if "log" in key or "held" in key else "") for key in rows[0]}))


if __name__ == "__main__":
    main()
