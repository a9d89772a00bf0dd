"""``mi-enhance fit-images``"""

from __future__ import annotations

import argparse
from pathlib import Path

from .arguments import _network_path, _output, _set_variant


def fit_images(args: argparse.Namespace) -> dict:
    output = _output(args.output, (".bsdf",))
    mi = _set_variant(args.variant)
    from tqdm import tqdm

    from ..images import fit_images as fit_images_module
    from ..images import pictures
    from ..images.view_files import read_views
    from ..system.files import require_file

    file = require_file(args.scene, f'fit-images "{args.scene}"')
    define = dict(args.define)
    if "$material" in file.read_text(encoding="utf-8"):
        define.setdefault("material", str(_network_path(args.network)))
    scene, views = mi.load_file(str(file), **define), read_views(args.views)
    with tqdm(desc=f"fit {len(views)} views", unit=" steps", disable=args.json, leave=False) as bar:

        def progress(stage, step, loss):
            bar.update()
            bar.set_postfix_str(f"{stage}, loss {loss:.5f}")

        found = fit_images_module.fit_images(
            scene,
            views,
            unknowns=args.unknown,
            light_scale=args.light_scale,
            stages=args.stages or fit_images_module.STAGES,
            max_depth=args.max_depth,
            seed=args.seed,
            callback=progress,
            preview=args.preview,
        )
    outputs = []
    for name, material in found.materials.items():
        outputs.append(output if len(found.materials) == 1 else output.with_stem(f"{output.stem}_{name}"))
        material.save(outputs[-1])
        print(f"{material.show()}\n{outputs[-1]}")
    if args.preview:
        pictures.draw_views(views, found.renders, Path(args.preview) / "views.png")
        pictures.draw_convergence({output.stem: found.curve}, Path(args.preview) / "convergence.png")
    for row in found.report["views"]:
        print(f"{row['name']} ({row['split']}): mean abs log difference {row['mean_abs_log']:.4f}")
    return {**found.report, "curve": found.curve, "outputs": [str(path) for path in outputs]}
