"""What a material loses on its way out: measured files and nearest parameters of other models.

The model is fitted to each file; the fitted material is written as RGL, as MERL and as parameters of `principled`,
OpenPBR and glTF. Errors are log-L1 against the material, at random pairs; of the RGL file also the difference of two
renders of the shader ball, one of the material and one of the file by Mitsuba's `measured`, each with its own noise,
beside that of two renders of the material with different seeds.

    python tests/benchmarks/exported.py mi_enhance/bundled/rgl/satin_rosaline_rgb.bsdf --json
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

import mi_enhance as me  # first: it finds the LLVM that Dr.Jit then loads

import mitsuba as mi  # isort: skip
import common
import numpy as np

from mi_enhance.benchmark import timing
from mi_enhance.evaluation import image_metrics, scenes
from mi_enhance.export.registry import export_material

COLUMNS = {
    "material": ("material", ""),
    "fit": ("fit", ".4f"),
    "bsdf": ("RGL", ".4f"),
    "bsdf_below_80": ("below 80°", ".4f"),
    "megabytes": ("MB", ".1f"),
    "seconds": ("s", ".1f"),
    "render": ("render, ΔE ITP x1000", ".2f"),
    "noise": ("noise", ".2f"),
    "binary": ("MERL", ".4f"),
    "binary_below_80": ("below 80°", ".4f"),
    "xml": ("principled", ".4f"),
    "mtlx": ("OpenPBR", ".4f"),
    "gltf": ("glTF", ".4f"),
}


def row(path: Path, folder: Path, args) -> dict:
    material = me.fit(me.Material.pretrained(args.model), me.data.load(path, n_samples=args.samples))
    result = {"material": path.stem.removesuffix("_rgb"), "fit": material.report["log_l1"]}
    for kind in ("bsdf", "binary", "xml", "mtlx", "gltf"):
        start = time.perf_counter()
        facts = export_material(material, folder / f"x.{kind}")
        result[kind] = facts["log_l1"]
        if kind == "bsdf":
            result |= {"megabytes": facts["bytes"] / 1e6, "seconds": time.perf_counter() - start}
        if "log_l1_below_80" in facts:
            result[f"{kind}_below_80"] = facts["log_l1_below_80"]
    written = {"type": "measured", "filename": str(folder / "x.bsdf")}
    images = [
        np.array(mi.render(scenes.shader_ball(bsdf, resolution=args.resolution, spp=args.spp), seed=mi.UInt32(seed)))
        for bsdf, seed in ((material.bsdf(), 0), (written, 1), (material.bsdf(), 1))
    ]
    result["render"], result["noise"] = (
        1000 * float(np.mean(image_metrics.delta_E_ITP_map(images[0], image))) for image in images[1:]
    )
    return result


def main() -> None:
    parser = common.parser(__doc__)
    parser.add_argument("data", nargs="*", help="RGL .bsdf (default: the bundled ones)")
    parser.add_argument("--model", default="ggx2", help="pretrained network (default: %(default)s)")
    parser.add_argument("--samples", type=int, default=20_000, help="of each fit (default: %(default)s)")
    parser.add_argument("--resolution", type=int, default=128)
    parser.add_argument("--spp", type=int, default=256)
    args = parser.parse_args()
    mi.set_variant("llvm_ad_rgb")
    with tempfile.TemporaryDirectory() as folder:
        rows = [row(path, Path(folder), args) for path in common.rgl_files(args.data)]
    common.finish(rows, COLUMNS, title="log-L1 against the material", about=timing.machine(), as_json=args.json)


if __name__ == "__main__":
    main()
