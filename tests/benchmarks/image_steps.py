"""The time of an iteration of fits to photographs: `principled`, plain GGX and a network in the same loop.

CPU seconds of both threads, median over the iterations after the first four, which compile; models take turns, sizes
of photographs too, so that other work on the machine meets all of them.
"""

from __future__ import annotations

import dataclasses
import time

import mi_enhance  # noqa: F401  (first: it finds the LLVM that Dr.Jit then loads)

import mitsuba as mi  # isort: skip
import common
import images
import numpy as np

from mi_enhance.benchmark.timing import machine
from mi_enhance.evaluation import scenes
from mi_enhance.images.cameras import around
from mi_enhance.images.descent import Descent
from mi_enhance.images.image_loss import Measure
from mi_enhance.images.survey import survey

_COLUMNS = {
    "label": ("model", ""),
    "resolution": ("pixels a side", ""),
    "cpu_seconds": ("CPU s of an iteration", ".3f"),
    "ratio": ("to principled", ".2f"),
}
_FIRST = 4


def main() -> None:
    """Run the benchmark of the command line."""
    parser = common.parser(__doc__)
    parser.add_argument("-m", "--network", default="ggx2", help="shipped network or .bsdf (default: %(default)s)")
    parser.add_argument("--scene", choices=("shader_ball", "sphere_envmap"), default="shader_ball")
    parser.add_argument("--max-depth", type=int, default=6)
    parser.add_argument("--resolution", type=int, nargs="+", default=[64])
    parser.add_argument("--pixels", type=int, default=4096)
    parser.add_argument("--spp", type=int, default=16)
    parser.add_argument("--steps", type=int, default=10)
    args = parser.parse_args()
    mi.set_variant("llvm_ad_rgb")
    descents, about = {}, machine()
    for label, model in images.MODELS.items():
        start, sought, *_ = model(args)
        scene = scenes.load(args.scene, start, resolution=16, spp=1)
        descents[label] = Descent(scene, sought(scene), None, Measure("log", 0.3), args.max_depth, 0)
    seconds: dict[tuple[str, int], list[float]] = {(label, r): [] for label in descents for r in args.resolution}
    batches = {key: pixels(args, key[1]).batches(0, args.steps) for key in seconds}
    for _ in range(args.steps):
        for key, own in seconds.items():
            target, start = next(batches[key]), time.process_time()
            descents[key[0]].step(target, args.spp, 0.01)
            own.append(time.process_time() - start)
    median = {key: float(np.median(own[_FIRST:])) for key, own in seconds.items()}
    rows = [
        {"label": label, "resolution": r, "cpu_seconds": s, "ratio": s / median["principled", r]}
        for (label, r), s in median.items()
    ]
    common.finish(rows, _COLUMNS, title="Iterations of fits to photographs", about=about, as_json=args.json)


def pixels(args, resolution: int):
    """Random pixels of four grey photographs: what they show does not matter."""
    at, distance = images._CAMERAS[args.scene]
    grey = np.full((resolution, resolution, 3), 0.4, np.float32)
    views = around(4, target=at, distance=distance, resolution=resolution)
    views = [dataclasses.replace(v, image=grey, mask=None) for v in views]
    return survey(views, [(1, args.spp, args.steps)], args.pixels, 0, 0).stages[0]


if __name__ == "__main__":
    main()
