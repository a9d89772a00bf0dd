"""``mi-enhance render``"""

from __future__ import annotations

import argparse
import time

from .arguments import _output, _set_variant

_IMAGES = (".exr", ".png", ".jpg", ".hdr", ".pfm")


def render(args: argparse.Namespace) -> dict:
    output = _output(args.output, _IMAGES)
    mi = _set_variant(args.variant)
    from ..system.files import replacing, require_file

    scene = mi.load_file(str(require_file(args.scene, f'render "{args.scene}"')), **dict(args.define))
    spp = args.spp or scene.sensors()[0].sampler().sample_count()
    start = time.perf_counter()
    bitmap = mi.Bitmap(mi.render(scene, spp=spp, seed=args.seed))  # the copy waits for the kernels
    seconds = time.perf_counter() - start
    spp = scene.sensors()[0].sampler().sample_count()  # what was traced: some samplers round up
    with replacing(output) as temporary:
        mi.util.write_bitmap(temporary, bitmap, write_async=False)
    width, height = bitmap.size()
    rate = width * height * spp / seconds / 1e6
    print(f"{output}: {width} x {height}, {spp} spp, {seconds:.2f} s, {rate:.2f} Mpaths/s (compilation included)")
    return {
        "output": str(output),
        "width": int(width),
        "height": int(height),
        "spp": spp,
        "seconds": seconds,
        "mpaths_per_s": rate,
        "variant": mi.variant(),
    }
