"""Arguments that several commands share: each is defined once, and read the same way everywhere.

Of the outputs, a file is always named by the user; a folder is ``out/COMMAND`` unless named. `show` and `check` answer
on the terminal and write only what is named.
"""

from __future__ import annotations

import argparse
import glob
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..system.bundled_files import DEFAULT_NETWORK, network_exists, network_file
from ..system.files import require_file

if TYPE_CHECKING:
    from ..data.measurements import Measurements
    from ..material.material import Material

Subparsers = Any  # argparse has no public name for what add_subparsers() returns
MEASURED = "MERL, RGL, UTIA, ALTA, ASTM, MIT, Zemax, LightTools, NBRDF or NPs file, table .csv or .npz (docs/files.md)"
OUTPUT_RULE = (
    "A file to be written is always named with -o. A folder is out/COMMAND unless -o names another. "
    "show and check write nothing unless -o is given. No command writes over one of its inputs."
)


def command(subparsers: Subparsers, name: str, text: str, run: Callable) -> argparse.ArgumentParser:
    """Add a command with the options that all commands have."""
    parser = subparsers.add_parser(name, help=text, description=text)
    parser.set_defaults(run=run)
    parser.add_argument("--json", action="store_true", help="print one JSON object last on stdout")
    parser.add_argument("--traceback", action="store_true", help="show where in the code an error arose")
    return parser


# ---------------------------------------------------------------------- options


def add_variant(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--variant", help="Mitsuba variant (default: cuda_ad_rgb if a GPU works, else llvm_ad_rgb)")


def add_samples(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--samples", type=positive, default=100_000, help="pairs of directions (default: %(default)s)")
    add_seed(parser)


def add_seed(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--seed", type=int, default=0, help="the same seed gives the same result (default: 0)")


def add_measurements(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("data", metavar="DATA", help=MEASURED)
    add_material(parser)


def add_material(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--material", help="which material, in a file that holds several")


def add_model(parser: argparse.ArgumentParser, help: str | None = None, default: str | None = DEFAULT_NETWORK) -> None:
    """``-m/--model``; ``--network`` is its name in version 0.1."""
    text = (
        f"what is fitted: a .bsdf file, the name of a shipped network (default: {DEFAULT_NETWORK}) or of an analytic "
        "model that has none (ggx_retro), or a model .toml"
    )
    parser.add_argument("-m", "--model", default=default, help=help or text)
    parser.add_argument("--network", dest="model", default=argparse.SUPPRESS, help=argparse.SUPPRESS)


def add_method(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--method",
        choices=("lm", "rmsprop"),
        default="lm",
        help="Levenberg-Marquardt or the paper's recipe (default: lm)",
    )


def add_define(parser: argparse.ArgumentParser, whose: str) -> None:
    parser.add_argument(
        "-D",
        dest="define",
        type=pair,
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help=f"give KEY of the {whose} this value; may be repeated",
    )


def add_edits(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--set", dest="edits", type=edit, action="append", default=[], metavar="NAME=V[,V,V]", help="edit a parameter"
    )


def add_output_file(parser: argparse.ArgumentParser, metavar: str, text: str, *, required: bool = True) -> None:
    parser.add_argument("-o", "--output", metavar=metavar, required=required, help=text)


def add_output_folder(parser: argparse.ArgumentParser, command: str, text: str = "folder") -> None:
    parser.add_argument(
        "-o", "--output", metavar="DIR", default=f"out/{command}", help=f"{text} (default: %(default)s)"
    )


def positive(text: str) -> int:
    try:
        value = float(text)  # 1e5 is how the paper writes it
    except ValueError:
        value = 0.0
    if not (value >= 1 and value.is_integer()):
        raise argparse.ArgumentTypeError(f"{text} is not a positive whole number")
    return int(value)


def picture_size(text: str) -> int:
    """Pixels on a side of a picture whose SSIM is measured; its window needs as many."""
    value = positive(text)
    if value < 11:
        raise argparse.ArgumentTypeError(f"{text} is too small: SSIM needs at least 11 pixels on a side")
    return value


def pair(text: str) -> tuple[str, str]:
    key, equals, value = text.partition("=")
    if not (key and equals):
        raise argparse.ArgumentTypeError(f'"{text}" is not KEY=VALUE')
    return key, value


def edit(text: str) -> tuple[str, float | tuple[float, ...]]:
    name, value = pair(text)
    try:
        numbers = tuple(float(v) for v in value.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f'"{text}": the values must be numbers, as in rho_d=0.2,0.1,0.0') from None
    return name, numbers if len(numbers) > 1 else numbers[0]


# ---------------------------------------------------------------------- what they stand for


def set_variant(name: str | None) -> Any:
    """Activate the variant asked for, else the first one that works here, and return Mitsuba."""
    import mitsuba as mi

    if name is None:
        mi.set_variant("cuda_ad_rgb", "llvm_ad_rgb")
        return mi
    if name not in mi.variants():
        raise ValueError(f'--variant: "{name}" is not a variant. Choose one of: {", ".join(mi.variants())}.')
    try:
        mi.set_variant(name)
    except ImportError as error:
        raise RuntimeError(f'--variant: "{name}" does not work here ({error}). Run: mi-enhance doctor') from None
    return mi


def files(names: Sequence[str], where: str) -> list[str]:
    """Return the files that names and patterns stand for, where the shell has not put them in already.

    Raises
    ------
    ValueError
        If no file matches a pattern; the message begins with `where`.
    """
    found: list[str] = []
    for name in names:
        matches = sorted(glob.glob(name)) if glob.has_magic(name) and not Path(name).exists() else [name]
        if not matches:
            raise ValueError(f'{where}: no file matches "{name}". Check the pattern.')
        found += matches
    return found


def measurements(args: argparse.Namespace, file: str | None = None) -> Measurements:
    """Return the samples of `file`, of ``args.data`` if left out."""
    from .. import data

    return data.load(file or args.data, n_samples=args.samples, seed=args.seed, material=args.material)


def require_data(args: argparse.Namespace) -> None:
    """Raise if ``--material`` names one of several measurements, and no file of them is given."""
    if args.material and not args.data:
        raise ValueError(f'--material: "{args.material}" is one of a measured file, and no DATA is given.')


def model(name: str) -> Material:
    from ..analytic import models
    from ..material.material import Material

    if name.lower().endswith(".toml"):
        return Material.analytic(models.from_toml(name))
    if name in models.MODELS and not network_exists(name):
        return Material.analytic(name)
    return Material.load(model_path(name))


def model_path(name: str) -> Path:
    """Return the absolute path of a ``.bsdf`` file, or of a shipped network by name.

    Mitsuba looks for relative names beside the scene first; what a user names on the command line is meant from where
    the user stands.
    """
    if not name.lower().endswith(".bsdf") and Path(name).name == name:
        return network_file(name)
    return require_file(name, f'-m "{name}"').absolute()


def settings(define: Sequence[tuple[str, str]]) -> dict[str, Any]:
    """Settings of a run: values that read as JSON are numbers, lists and so on, others text."""
    return {key: _json_or_text(value) for key, value in define}


def _json_or_text(value: str) -> Any:
    try:
        return json.loads(value)
    except ValueError:
        return value
