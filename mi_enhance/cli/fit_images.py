"""``mi-enhance fit-images``"""

from __future__ import annotations

import argparse
import contextlib
import re
import sys
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from ..system.bundled_files import SURFACE_NETWORK
from ..system.progress import Callback
from . import arguments
from .outputs import made, output_file, output_folder
from .progress_bar import progress_bar
from .progress_lines import progress_lines
from .scene_file import load_scene, refuse_inputs

if TYPE_CHECKING:
    from ..material.material import Material


def add(subparsers: arguments.Subparsers) -> None:
    text = "fit the enhanced materials of a scene to photographs of it; a run that was killed goes on where it was"
    p = arguments.command(subparsers, "fit-images", text, run)
    p.add_argument("scene", metavar="SCENE.xml", help="geometry and light; its parameter $material gets the model")
    p.add_argument("views", metavar="VIEWS", help="folder with transforms.json, or that file (docs/images.md)")
    arguments.add_model(
        p,
        help=f"what is fitted: a .bsdf file, or the name of a shipped network (default: {SURFACE_NETWORK})",
        default=SURFACE_NETWORK,
    )
    arguments.add_define(p, "scene")
    arguments.add_seed(p)
    arguments.add_variant(p)
    arguments.add_output_file(p, "MAT.bsdf", "the material; several: MAT_<id>.bsdf each")
    p.add_argument("--light-scale", action="store_true", help="the brightness of the light is unknown, too")
    p.add_argument("--exposures", action="store_true", help="the exposure of each photograph is unknown, too")
    p.add_argument("--unknown", metavar="NAME", action="append", help="parameter that is sought (default: all)")
    p.add_argument(
        "--stage",
        dest="stages",
        metavar="FACTOR,SPP,STEPS",
        type=_stage,
        action="append",
        help="images at 1/FACTOR of their size, samples per pixel, iterations; repeat, coarse to fine "
        "(default: K,8,400 with K that makes them about 64 pixels wide; of maps 2,16,150 and 1,16,250)",
    )
    p.add_argument(
        "--pixels", type=arguments.positive, help="random pixels of all photographs in an iteration (default: 4096)"
    )
    p.add_argument("--restart", action="store_true", help="begin anew where a run that was killed could go on")
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
        for name in ("views.png", "convergence.png", "uncertainty.png"):
            pages.check(name)  # a photograph of that name is found before the fit, not after it
    mi = arguments.set_variant(args.variant)
    from ..images import fit_images, pictures, scene_materials
    from ..images.view_files import ViewFiles

    with _of_low_rank(model) as path:
        scene = load_scene(mi, args.scene, f'fit-images "{args.scene}"', args.define, material=path)
    outputs = _outputs(output, scene_materials.find(mi.traverse(scene)))
    for path in outputs.values():
        output_file(path, (".bsdf",), inputs)
    refuse_inputs(mi, args.scene, args.define, outputs.values())
    views, state = ViewFiles(args.views), made(output.with_name(f"{output.stem}.run.npz"))
    if args.restart:
        state.unlink(missing_ok=True)

    def keep(materials: Mapping[str, Material]) -> None:
        for name, material in materials.items():
            material.save(made(outputs[name]))

    with _progress(f"fit {len(views)} views", args.json) as progress:
        found = fit_images.fit_images(
            scene,
            views,
            unknowns=args.unknown,
            light_scale=args.light_scale,
            exposures=args.exposures,
            stages=args.stages,
            pixels=args.pixels or fit_images.PIXELS,
            max_depth=args.max_depth,
            seed=args.seed,
            checkpoint=state,
            keep=keep,
            progress=progress,
            preview=preview,
        )
    keep(found.materials)
    state.unlink(missing_ok=True)
    for name, material in found.materials.items():
        print(f"{material.show()}\n{outputs[name]}")
    if pages:
        with pages.replacing("views.png") as temporary:
            pictures.draw_views(views, found.renders, temporary)
        with pages.replacing("convergence.png") as temporary:
            pictures.draw_convergence({output.stem: found.curve}, temporary)
        if found.uncertainty:
            with pages.replacing("uncertainty.png") as temporary:
                pictures.draw_uncertainty(found.uncertainty, temporary)
    if not found.materials:
        print("No file is written: a parameter of each material is a texture.")
    for row in found.report["views"]:
        print(f"{row['name']} ({row['split']}): mean abs log difference {row['mean_abs_log']:.4f}")
    if found.uncertainty:
        print(found.uncertainty.words())
    return {**found.report, "curve": found.curve, "outputs": [str(outputs[name]) for name in found.materials]}


@contextlib.contextmanager
def _of_low_rank(model: Path) -> Iterator[Path]:
    """Yield the file of a network in the form that photographs determine, as long as a scene is loaded with it."""
    from ..material.low_rank import of_low_rank
    from ..material.material import Material

    network = Material.load(model)
    if not network.low_rank:
        yield model
        return
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / model.name
        of_low_rank(network, "fit-images").save(path)
        yield path


def _progress(title: str, is_json: bool) -> contextlib.AbstractContextManager[Callback]:
    """A bar for an eye, lines for everything else."""
    if sys.stderr.isatty() and not is_json:
        return progress_bar(title)
    return contextlib.nullcontext(progress_lines(title))


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
