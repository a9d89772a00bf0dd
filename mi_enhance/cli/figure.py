"""``mi-enhance figure``"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ..system.progress import Callback
from . import arguments
from .outputs import output_folder
from .progress_bar import progress_bar

# measured files that are shown unless others are named
_COLOURS = ("cc_ibiza_sunset", "ilm_solo_m_68", "satin_rosaline")
_DEFAULTS = {
    5: _COLOURS,
    7: ("ilm_solo_m_68", "satin_rosaline"),
    8: ("ilm_solo_m_68",),
    9: (),
    11: ("ilm_solo_m_68",),
    14: ("cc_ibiza_sunset",),
    16: (*_COLOURS, "aurora_white", "cg_sunflower", "chm_mint", "chm_orange"),
}
_TRAINED = (8, 9, 11)


def add(subparsers: arguments.Subparsers) -> None:
    text = "draw a figure of the paper with the models of this package: " + ", ".join(map(str, _DEFAULTS))
    p = arguments.command(subparsers, "figure", text, run)
    p.add_argument("number", type=int, choices=tuple(_DEFAULTS), metavar="N", help="of the figure in the paper")
    p.add_argument("data", metavar="DATA", nargs="*", help="RGL .bsdf (default: bundled ones); none for figure 9")
    arguments.add_model(p, default=None, help="the enhanced model of figures 5, 7, 14, 16 (default: as for fit)")
    arguments.add_samples(p)
    arguments.add_variant(p)
    arguments.add_output_folder(p, "figure")
    p.add_argument(
        "--resolution", type=arguments.picture_size, default=256, help="pixels on a side (default: %(default)s)"
    )
    p.add_argument("--spp", type=arguments.positive, default=256, help="samples per pixel (default: %(default)s)")
    p.add_argument(
        "--steps",
        type=arguments.positive,
        default=4000,
        help="of the trainings of figures 8, 9 and 11, minutes each (default: %(default)s)",
    )


def run(args: argparse.Namespace) -> dict:
    number: int = args.number
    if number in _TRAINED and args.model:
        raise ValueError(f"figure {number}: it shows models that it trains itself. Leave -m out.")
    if number == 9 and args.data:
        raise ValueError("figure 9: its errors are those of training materials kept aside. Name no file.")
    folder = output_folder(args.output)
    arguments.set_variant(args.variant)
    from ..benchmark.contenders import settings_of_fits
    from ..output.table import COLUMNS, print_table
    from ..system.bundled_files import demo_data
    from ..system.run_folder import keep_settings

    model = arguments.model(args.model) if args.model else None
    data = args.data or [demo_data(f"{name}_rgb.bsdf") for name in _DEFAULTS[number]]
    if number != 9:
        keep_settings(folder / "settings.json", settings_of_fits(model, args.samples, args.seed), "figure")
    with progress_bar(f"figure {number}", quiet=args.json) as progress:
        rows = _figure(number)(args, data, folder, model, progress)
    columns = {"samples": ("fitted to", ""), **COLUMNS, "validation": ("unseen materials", ".4f")}
    columns |= {"n_weights": ("weights", ",d"), "multiply_adds": ("multiply-adds", ",d")}
    picture = folder / f"figure_{number}.png"
    print_table(rows, {k: v for k, v in columns.items() if any(k in row for row in rows)})
    print(picture)
    return {"figure": number, "output": str(picture), "rows": rows}


def _figure(number: int) -> Callable[[argparse.Namespace, list, Path, Any, Callback], list[dict]]:
    """Return the function that draws it."""
    from ..benchmark import figure_renders, figure_slices, figure_variants

    def renders(args: argparse.Namespace, data: list, folder: Path, model: Any, progress: Callback) -> list[dict]:
        return figure_renders.renders(
            number, data, folder, model=model, **_fits(args), **_size(args), progress=progress
        )

    def slices(args: argparse.Namespace, data: list, folder: Path, model: Any, progress: Callback) -> list[dict]:
        return figure_slices.slices(data, folder, model=model, **_fits(args), progress=progress)

    def variants(args: argparse.Namespace, data: list, folder: Path, model: Any, progress: Callback) -> list[dict]:
        given = {**_fits(args), **_size(args), "steps": args.steps}
        return figure_variants.fitted_variants(number, data, folder, **given, progress=progress)

    def sizes(args: argparse.Namespace, data: list, folder: Path, model: Any, progress: Callback) -> list[dict]:
        return figure_variants.sizes(folder, steps=args.steps, seed=args.seed, progress=progress)

    return {7: slices, 8: variants, 9: sizes, 11: variants}.get(number, renders)


def _fits(args: argparse.Namespace) -> dict[str, int]:
    return {"n_samples": args.samples, "seed": args.seed}


def _size(args: argparse.Namespace) -> dict[str, int]:
    return {"resolution": args.resolution, "spp": args.spp}
