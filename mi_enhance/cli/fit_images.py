"""``mi-enhance fit-images``"""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterable
from pathlib import Path

from ..system.bundled_files import DEFAULT_NETWORK
from . import arguments
from .outputs import made, output_file, output_folder
from .progress_bar import progress_bar
from .scene_file import load_scene, refuse_inputs


def add(subparsers: arguments.Subparsers) -> None:
    text = "fit the enhanced materials of a scene to photographs of it"
    p = arguments.command(subparsers, "fit-images", text, run)
    p.add_argument("scene", metavar="SCENE.xml", help="geometry and light; its parameter $material gets the model")
    p.add_argument("views", metavar="VIEWS", help="folder with transforms.json, or that file (docs/images.md)")
    arguments.add_model(
        p, help=f"what is fitted: a .bsdf file, or the name of a shipped network (default: {DEFAULT_NETWORK})"
    )
    arguments.add_define(p, "scene")
    arguments.add_seed(p)
    arguments.add_variant(p)
    arguments.add_output_file(p, "MAT.bsdf", "the material; several: MAT_<id>.bsdf each")
    p.add_argument("--light-scale", action="store_true", help="the brightness of the light is unknown, too")
    p.add_argument("--unknown", metavar="NAME", action="append", help="parameter that is sought (default: all)")
    p.add_argument(
        "--stage",
        dest="stages",
        metavar="FACTOR,SPP,STEPS",
        type=_stage,
        action="append",
        help="images at 1/FACTOR of their size, samples per pixel, iterations; repeat, coarse to fine "
        "(default: 2,8,80 and 1,16,120)",
    )
    p.add_argument(
        "--max-depth", type=int, default=6, help="longest path; a photograph has them all (default: %(default)s)"
    )
    p.add_argument("--preview", metavar="DIR", help="folder for pictures: every few iterations, and at the end")


def run(args: argparse.Namespace) -> dict:
    from ..images.own_files import OwnFiles

    model = arguments.model_path(args.model)
    inputs = [args.scene, args.views, model]
    output = output_file(args.output, (".bsdf",), inputs)
    preview = output_folder(args.preview, "--preview") if args.preview else None
    pages = OwnFiles(preview, "fit-images --preview") if preview else None
    if pages:
        for name in ("views.png", "convergence.png"):
            pages.check(name)  # a photograph of that name is found before the fit, not after it
    mi = arguments.set_variant(args.variant)
    from ..images import fit_images, pictures, scene_materials
    from ..images.view_files import read_views

    scene = load_scene(mi, args.scene, f'fit-images "{args.scene}"', args.define, material=model)
    outputs = _outputs(output, scene_materials.find(mi.traverse(scene)))
    for path in outputs.values():
        output_file(path, (".bsdf",), inputs)
    refuse_inputs(mi, args.scene, args.define, outputs.values())
    views = read_views(args.views)
    with progress_bar(f"fit {len(views)} views", quiet=args.json) as progress:
        found = fit_images.fit_images(
            scene,
            views,
            unknowns=args.unknown,
            light_scale=args.light_scale,
            stages=args.stages or fit_images.STAGES,
            max_depth=args.max_depth,
            seed=args.seed,
            progress=progress,
            preview=preview,
        )
    for name, material in found.materials.items():
        material.save(made(outputs[name]))
        print(f"{material.show()}\n{outputs[name]}")
    if pages:
        with pages.replacing("views.png") as temporary:
            pictures.draw_views(views, found.renders, temporary)
        with pages.replacing("convergence.png") as temporary:
            pictures.draw_convergence({output.stem: found.curve}, temporary)
    if not found.materials:
        print("No file is written: a parameter of each material is a texture.")
    for row in found.report["views"]:
        print(f"{row['name']} ({row['split']}): mean abs log difference {row['mean_abs_log']:.4f}")
    return {**found.report, "curve": found.curve, "outputs": [str(outputs[name]) for name in found.materials]}


def _outputs(output: Path, names: Iterable[str]) -> dict[str, Path]:
    """Return the file of each material: `output` of the only one, else with its id, as far as that is a file name."""
    names = list(names)
    if len(names) == 1:
        return {names[0]: output}
    stems: dict[str, str] = {}
    for name in names:
        stem = re.sub(r"[^\w.-]", "_", name)  # an id may hold "/"
        while stem in stems.values():
            stem += "_"
        stems[name] = stem
    return {name: output.with_stem(f"{output.stem}_{stem}") for name, stem in stems.items()}


def _stage(text: str) -> tuple[int, ...]:
    numbers = tuple(arguments.positive(part) for part in text.split(","))
    if len(numbers) != 3:
        raise argparse.ArgumentTypeError(f"{text} is not FACTOR,SPP,STEPS")
    return numbers
