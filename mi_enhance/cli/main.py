"""The command line: what each subcommand takes, and what a user sees when something is wrong.

What a subcommand does is in the file of its name; nothing heavy is imported before one is chosen. Scripts depend on the names
and options here and on the JSON that ``--json`` prints last on stdout.
"""

from __future__ import annotations

import argparse
import importlib
import json
import sys

from .. import __version__
from ..system import llvm
from ..system.bundled_files import DEFAULT_NETWORK

_OUR_ERRORS = (ValueError, KeyError, RuntimeError, OSError, ImportError)  # what a wrong input or machine can raise


def main(argv: list[str] | None = None) -> int:
    """Run one subcommand.

    Parameters
    ----------
    argv : list of str, optional
        The arguments; those of the process if left out.

    Returns
    -------
    int
        Exit status: 0 done, 1 doctor found that rendering does not work or check that something is off, 2 an error,
        130 interrupted.

    Examples
    --------
    >>> main(["show", "gold.bsdf"])  # doctest: +SKIP
    0
    """
    args = parser().parse_args(argv)
    try:
        if llvm.problem and args.command != "doctor":
            raise ImportError(llvm.problem)
        name = args.command.replace("-", "_")
        result = getattr(importlib.import_module(f".{name}", __package__), name)(args)
    except KeyboardInterrupt:
        print("mi-enhance: interrupted", file=sys.stderr)
        return 130
    except _OUR_ERRORS as error:
        if args.traceback:
            raise
        print(f"mi-enhance: {_one_line(error)}", file=sys.stderr)
        return 2
    if args.json:
        print(json.dumps(result))
    return 0 if result.get("rendering_works", True) and result.get("ok", True) else 1


def _one_line(error: BaseException) -> str:
    """Return the sentence of an error: Mitsuba passes on a plugin's error with its whole traceback around it."""
    text = str(error.args[0]) if isinstance(error, KeyError) and error.args else str(error)
    lines = [line.strip() for line in text.splitlines() if line.strip()] or [repr(error)]
    if "Traceback (most recent call last):" in text:
        lines = [lines[-1].partition("Error: ")[2] or lines[-1]]
    return " ".join(lines).removeprefix("mi_enhance: ")


def parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="mi-enhance", description="Neural enhancement of analytical BRDFs for Mitsuba 3."
    )
    parser.add_argument("--version", action="version", version=f"mi-enhance {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")

    common = argparse.ArgumentParser(add_help=False)
    common.add_argument("--json", action="store_true", help="print one JSON object last on stdout")
    common.add_argument("--traceback", action="store_true", help="show where in the code an error arose")
    device = argparse.ArgumentParser(add_help=False)
    device.add_argument("--variant", help="Mitsuba variant (default: cuda_ad_rgb if a GPU works, else llvm_ad_rgb)")
    sampled = argparse.ArgumentParser(add_help=False)
    sampled.add_argument(
        "--samples", type=_positive, default=100_000, help="pairs of directions (default: %(default)s)"
    )
    sampled.add_argument("--seed", type=int, default=0, help="the same seed gives the same result (default: 0)")
    one = argparse.ArgumentParser(add_help=False)
    one.add_argument("data", metavar="DATA", help="MERL .binary, RGL .bsdf, NBRDF or NPs .npz, table .csv or .npz")
    one.add_argument("--material", help="which material, in a file that holds several")
    network = argparse.ArgumentParser(add_help=False)
    network.add_argument(
        "-m",
        "--network",
        default=DEFAULT_NETWORK,
        help="trained network: a .bsdf file or the name of a shipped one (default: %(default)s); or a model, .toml",
    )
    method = argparse.ArgumentParser(add_help=False)
    method.add_argument(
        "--method",
        choices=("lm", "rmsprop"),
        default="lm",
        help="Levenberg-Marquardt or the paper's recipe (default: lm)",
    )

    def add(name, text, *parents):
        return commands.add_parser(name, help=text, description=text, parents=[*parents, common])

    def add_define(p, text):
        p.add_argument("-D", dest="define", type=_pair, action="append", default=[], metavar="KEY=VALUE", help=text)

    add("doctor", "tell what is installed and which variants work; exit 0 if rendering works")

    p = add("demo", "fit a real measured material and render it beside ground truth and plain GGX", device)
    p.add_argument("-o", "--output", metavar="DIR", default="out/demo", help="folder (default: %(default)s)")

    p = add("fit", "fit a material to measurements", one, network, method, sampled, device)
    p.add_argument("-o", "--output", metavar="MAT.bsdf", required=True)
    p.add_argument("--reciprocal", action="store_true", help="f(wi, wo) = f(wo, wi), even where the file is not")
    p.add_argument(
        "--bound-energy", action="store_true", help="reflect no more than is received, for every view and edit"
    )

    p = add("fit-images", "fit the enhanced materials of a scene to photographs of it", network, device)
    p.add_argument("scene", metavar="SCENE.xml", help="geometry and light; its parameter $material gets the network")
    p.add_argument("views", metavar="VIEWS", help="folder with transforms.json, or that file (docs/images.md)")
    p.add_argument("-o", "--output", metavar="MAT.bsdf", required=True, help="several materials: MAT_<id>.bsdf each")
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
    p.add_argument("--seed", type=int, default=0, help="the same seed gives the same random numbers (default: 0)")
    add_define(p, "parameter of the scene")

    p = add("render", "render a scene; the plugin `enhanced` is registered", device)
    p.add_argument("scene", metavar="SCENE.xml")
    p.add_argument("-o", "--output", metavar="OUT.exr", required=True, help=".exr, or .png tone-mapped to sRGB")
    p.add_argument("--spp", type=_positive, help="samples per pixel (default: the scene's)")
    p.add_argument("--seed", type=int, default=0)
    add_define(p, "parameter of the scene")

    p = add("show", "print a material", device)
    p.add_argument("file", metavar="MAT.bsdf")
    p.add_argument(
        "--set", dest="edits", type=_edit, action="append", default=[], metavar="NAME=V[,V,V]", help="edit a parameter"
    )
    p.add_argument("-o", "--output", metavar="NEW.bsdf", help="write the edited material")

    p = add("check", "examine a material: NaN, negative values, reciprocity, albedo, chi-square; exit 1 if off", device)
    p.add_argument("file", metavar="MAT.bsdf")
    p.add_argument("-o", "--output", metavar="DIR", help="folder for the table and a picture")
    p.add_argument("--seed", type=int, default=0)

    p = add("specialize", "make a material several times cheaper to render, with a stated error", sampled, device)
    p.add_argument("file", metavar="MAT.bsdf")
    p.add_argument("data", metavar="DATA", nargs="?", help="what it was fitted to: the small network then follows that")
    p.add_argument("--material", help="which material, in a data file that holds several")
    p.add_argument("-o", "--output", metavar="FAST.bsdf", required=True)
    p.add_argument(
        "--max-error",
        type=float,
        default=1e-3,
        help="mean absolute difference of log(1 + f cos) to the exact material, which the file keeps (default: 0.001)",
    )
    p.add_argument(
        "--textured",
        action="store_true",
        help="take the smaller network that all materials share: for maps and textures; best with DATA",
    )
    p.add_argument("--undo", action="store_true", help="go back to the exact material of a specialized one")

    p = add("convert", "write measurements of any readable kind as a table", one, sampled, device)
    p.add_argument("-o", "--output", metavar="TABLE", required=True, help=".csv or .npz")

    p = add("train", "train the networks of an enhanced model on many materials, or go on where a run stopped", device)
    p.add_argument("config", metavar="CONFIG.json", help="settings that differ from the defaults, the data among them")
    p.add_argument("-o", "--output", metavar="DIR", required=True, help="folder of the run: checkpoint and curve")
    add_define(p, "setting, as JSON: -D steps=2000")

    p = add(
        "search", "find which terms of an analytic model to replace by networks, or go on where a run stopped", device
    )
    p.add_argument("model", metavar="MODEL", help="analytic model: ggx, ward, ..., or a text file .toml")
    p.add_argument(
        "--data", action="append", default=[], required=True, metavar="FILES", help="to train on; *, ? and .json lists"
    )
    p.add_argument("--validation", action="append", default=[], metavar="FILES", help="materials to watch only")
    p.add_argument("-o", "--output", metavar="NET.bsdf", required=True, help="the network; its run lies in NET.search/")
    p.add_argument("--workers", type=_positive, default=1, help="processes on this machine (default: %(default)s)")
    p.add_argument("--scheduler", metavar="ADDRESS", help="Dask scheduler whose workers train the candidates")
    add_define(
        p,
        "setting, as JSON: -D epochs=10 -D max_modules=4 -D nodes_only=true (all: mi_enhance.hypercube.settings)",
    )

    text = "SSIM, Delta E_ITP and log-L1 of the enhanced and the analytic model, fitted to measured RGL files"
    p = add("compare", text, network, method, sampled, device)
    p.add_argument("data", metavar="DATA", nargs="+", help="RGL .bsdf")
    p.add_argument("-o", "--output", metavar="DIR", default="out/compare", help="folder (default: %(default)s)")
    p.add_argument("--scene", default="shader_ball", help="bundled scene or .xml file (default: %(default)s)")
    p.add_argument("--resolution", type=_positive, default=256, help="pixels on a side (default: %(default)s)")
    p.add_argument("--spp", type=_positive, default=256, help="samples per pixel (default: %(default)s)")

    text = "error against run time of every model on this machine, as table, plot and HTML page"
    p = add("bench", text, sampled, device)
    p.add_argument("data", metavar="DATA", nargs="*", help="RGL .bsdf (default: the one of the demo)")
    p.add_argument("-o", "--output", metavar="DIR", default="out/bench", help="folder (default: %(default)s)")
    p.add_argument("--resolution", type=_positive, default=256, help="pixels on a side (default: %(default)s)")
    p.add_argument("--spp", type=_positive, default=64, help="samples per pixel (default: %(default)s)")
    p.add_argument("--rounds", type=_positive, default=5, help="interleaved runs (default: %(default)s)")
    return parser


def _positive(text: str) -> int:
    try:
        value = float(text)  # 1e5 is how the paper writes it
    except ValueError:
        value = 0.0
    if not (value >= 1 and value.is_integer()):
        raise argparse.ArgumentTypeError(f"{text} is not a positive whole number")
    return int(value)


def _pair(text: str) -> tuple[str, str]:
    key, equals, value = text.partition("=")
    if not (key and equals):
        raise argparse.ArgumentTypeError(f'"{text}" is not KEY=VALUE')
    return key, value


def _stage(text: str) -> tuple[int, ...]:
    numbers = tuple(_positive(part) for part in text.split(","))
    if len(numbers) != 3:
        raise argparse.ArgumentTypeError(f"{text} is not FACTOR,SPP,STEPS")
    return numbers


def _edit(text: str) -> tuple[str, float | tuple[float, ...]]:
    name, value = _pair(text)
    try:
        numbers = tuple(float(v) for v in value.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f'"{text}": the values must be numbers, as in rho_d=0.2,0.1,0.0') from None
    return name, numbers if len(numbers) > 1 else numbers[0]
