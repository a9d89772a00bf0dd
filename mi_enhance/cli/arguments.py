"""What several subcommands share: variants, outputs, measurements, pretrained networks."""

from __future__ import annotations

import argparse
import json
from pathlib import Path


def _set_variant(name: str | None):
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


def _output(name: str, suffixes: tuple[str, ...]) -> Path:
    """Check where the result goes before any work is done for it, and make its folder."""
    path = Path(name)
    if path.suffix.lower() not in suffixes:
        raise ValueError(f'-o: "{name}" must end in {" or ".join(suffixes)}.')
    path.parent.mkdir(parents=True, exist_ok=True)
    return path


def _measurements(args: argparse.Namespace):
    from .. import data

    return data.load(args.data, n_samples=args.samples, seed=args.seed, material=args.material)


def _json_or_text(value: str):
    try:
        return json.loads(value)
    except ValueError:
        return value


def _network(name: str):
    from ..analytic import models
    from ..material.material import Material

    if name.endswith(".toml"):
        return Material.analytic(models.from_toml(name))
    return Material.load(_network_path(name))


def _network_path(name: str) -> Path:
    from ..system.bundled_files import network_file

    return Path(name) if name.endswith(".bsdf") else network_file(name)
