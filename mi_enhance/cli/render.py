"""``mi-enhance render``"""

from __future__ import annotations

import argparse
import time
from typing import Any

from . import arguments
from .outputs import made, output_file
from .scene_file import load_scene, refuse_inputs

_EIGHT_BIT = (".png", ".jpg", ".jpeg")
_IMAGES = (".exr", ".png", ".jpg", ".jpeg", ".hdr", ".pfm")


def add(subparsers: arguments.Subparsers) -> None:
    p = arguments.command(subparsers, "render", "render a scene; the plugin `enhanced` is registered", run)
    p.add_argument("scene", metavar="SCENE.xml")
    arguments.add_define(p, "scene")
    arguments.add_seed(p)
    arguments.add_variant(p)
    arguments.add_output_file(
        p, "OUT.exr", "all channels of the film as .exr; its colour as .hdr or .pfm, or as .png or .jpg in sRGB"
    )
    p.add_argument("--spp", type=arguments.positive, help="samples per pixel (default: the scene's)")


def run(args: argparse.Namespace) -> dict:
    where = f'render "{args.scene}"'
    output = output_file(args.output, _IMAGES, [args.scene, *(value for _, value in args.define)])
    mi = arguments.set_variant(args.variant)
    from ..system.files import replacing

    scene = load_scene(mi, args.scene, where, args.define)
    refuse_inputs(mi, args.scene, args.define, [output])
    if scene.integrator() is None:
        raise ValueError(f'{where}: the scene has no integrator. Add one: <integrator type="path"/>')
    if not scene.sensors():
        raise ValueError(f'{where}: the scene has no sensor. Add one: <sensor type="perspective"> ... </sensor>')
    film = scene.sensors()[0].film()
    if film.class_name() == "SpecFilm" and scene.integrator().aov_names():
        raise ValueError(
            f"{where}: a specfilm cannot record what integrator aov adds: Mitsuba writes beyond its end. Use an "
            "hdrfilm, or render without aov."
        )
    film.prepare(scene.integrator().aov_names())
    suffix = output.suffix.lower()
    empty = film.bitmap()
    _picture(mi, empty, suffix)  # refused before the work, not after

    spp = args.spp or scene.sensors()[0].sampler().sample_count()
    start = time.perf_counter()
    image = mi.render(scene, spp=spp, seed=args.seed)
    # The copy waits for the kernels. Of what the film has beside the colour, names and all, the tensor lacks some.
    named = empty.pixel_format() == mi.Bitmap.PixelFormat.MultiChannel
    bitmap = film.bitmap() if named else mi.Bitmap(image, empty.pixel_format())
    seconds = time.perf_counter() - start
    spp = scene.sensors()[0].sampler().sample_count()  # what was traced: some samplers round up
    with replacing(made(output)) as temporary:
        mi.util.write_bitmap(temporary, _picture(mi, bitmap, suffix), write_async=False)
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


def _picture(mi: Any, bitmap: Any, suffix: str) -> Any:
    """Return what a file holds of a film: an ``.exr`` all channels by their names, others the colour alone."""
    if suffix == ".exr":
        return bitmap
    names = [field.name for field in bitmap.struct_() if "." not in field.name]
    if not set(names) <= set("RGBAXYZ"):
        text = ", ".join(names)
        raise ValueError(f"-o: the film records {text}, which are no colour that a {suffix} can hold. Write an .exr.")
    colour = dict(bitmap.split())["<root>"]
    if suffix in _EIGHT_BIT:
        return mi.util.convert_to_bitmap(colour, uint8_srgb=True)
    return colour.convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32, srgb_gamma=False)
