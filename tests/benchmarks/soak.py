"""Long use in one process: scenes loaded and materials swapped a thousand times, with the time and memory of each.

Four loads, each in a process of its own, on the smallest scene there is (a sphere, 16 x 16 pixels, 1 sample):

* ``scenes``: another scene is loaded with another material of the shared network, rendered and dropped;
* ``swaps``: the scene stays, its shape is given another material;
* ``edits``: scene and material stay, parameters change through ``mi.traverse``;
* ``networks``: as ``swaps``, but every material has a network of its own, so every frame is another kernel. With
  ``--flush N`` Dr.Jit's kernels are dropped after every N of them.

Writes ``soak.csv``, ``.json``, ``.md`` and, with ``--plot``, a picture.
"""

from __future__ import annotations

import multiprocessing
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import mi_enhance as me  # (before mitsuba)

import drjit as dr  # isort: skip
import mitsuba as mi  # isort: skip
import common
import numpy as np

from mi_enhance.benchmark.timing import machine
from mi_enhance.output.figure import sheet
from mi_enhance.output.table import write_table

_FILES = 10  # materials of the shared network on disk, loaded in turn and edited
COLUMNS = {
    "load": ("load", ""),
    "n": ("times", "d"),
    "first_ms": ("first, CPU ms", ".0f"),
    "early_ms": ("11th to 100th, median", ".1f"),
    "late_ms": ("last 90, median", ".1f"),
    "early_mb": ("MB after 100", ".1f"),
    "late_mb": ("MB at the end", ".1f"),
    "kb_each": ("KB a time", ".2f"),
}


def scene(bsdf) -> mi.Scene:
    """Return the smallest scene, a sphere below a white sky."""
    look = mi.ScalarTransform4f().look_at([0, 0, 4], [0, 0, 0], [0, 1, 0])
    film = {"type": "hdrfilm", "width": 16, "height": 16, "rfilter": {"type": "box"}}
    sensor = {"type": "perspective", "to_world": look, "film": film, "sampler": {"type": "independent"}}
    return mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "path", "max_depth": 3},
            "sensor": sensor,
            "light": {"type": "constant"},
            "ball": {"type": "sphere", "bsdf": bsdf},
        },
        optimize=False,
    )


def _edits(k: int) -> dict:
    diffuse, specular = np.random.default_rng(k).uniform(0.01, 0.5, (2, 3))
    return {name: {"type": "rgb", "value": v.tolist()} for name, v in (("rho_d", diffuse), ("rho_s", specular))}


def _material(folder: Path, k: int) -> dict:
    return {"type": "enhanced", "filename": str(folder / f"{k % _FILES}.bsdf"), **_edits(k)}


def _scenes(folder: Path) -> Callable[[int], mi.Scene]:
    return lambda k: scene(_material(folder, k))


def _swaps(folder: Path) -> Callable[[int], mi.Scene]:
    kept = scene(_material(folder, 0))

    def swapped(k: int) -> mi.Scene:
        kept.shapes()[0].set_bsdf(mi.load_dict(_material(folder, k)))
        return kept

    return swapped


def _edited(folder: Path) -> Callable[[int], mi.Scene]:
    kept = scene(_material(folder, 0))
    params = mi.traverse(kept)

    def edited(k: int) -> mi.Scene:
        for name, colour in _edits(k).items():
            params[f"ball.bsdf.{name}"] = mi.Color3f(colour["value"])
        params.update()
        return kept

    return edited


def _networks(folder: Path) -> Callable[[int], mi.Scene]:
    kept = scene({"type": "diffuse"})

    def other(k: int) -> mi.Scene:
        brdf = me.enhance("ggx", {"F": (8, 8)}, n_latent=2, seed=k)
        kept.shapes()[0].set_bsdf(me.Material(brdf, {}).bsdf())
        return kept

    return other


LOADS = {"scenes": _scenes, "swaps": _swaps, "edits": _edited, "networks": _networks}


def soak(load: str, n: int, folder: str, flush: int = 0) -> tuple[list[float], list[float]]:
    """Return the milliseconds of each time, and the megabytes of the process after it.

    They are those of the processor, in all threads: other work on the machine disturbs them little.
    """
    mi.set_variant("llvm_ad_rgb")
    milliseconds, megabytes = [], []
    given = LOADS[load](Path(folder))
    for k in range(n):
        start = time.process_time()
        mi.render(given(k), spp=1, seed=k).numpy()
        if flush and k % flush == flush - 1:
            dr.flush_kernel_cache()
        milliseconds.append(1e3 * (time.process_time() - start))
        megabytes.append(_megabytes())
    return milliseconds, megabytes


def _megabytes() -> float:
    """Return the memory that this process asked for and has used; pages of files come and go as the system likes."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) / 1024 for line in lines if line.startswith("RssAnon"))


def row(load: str, milliseconds: list[float], megabytes: list[float]) -> dict:
    """Return the figures of one load: what a time costs at the beginning and the end, and what it leaves behind."""
    early, late = slice(10, 100), slice(-90, None)
    slope = np.polyfit(np.arange(len(megabytes))[100:], megabytes[100:], 1)[0] if len(megabytes) > 200 else np.nan
    return {
        "load": load,
        "n": len(milliseconds),
        "first_ms": milliseconds[0],
        "early_ms": float(np.median(milliseconds[early] or np.nan)),
        "late_ms": float(np.median(milliseconds[late])),
        "early_mb": megabytes[min(99, len(megabytes) - 1)],
        "late_mb": megabytes[-1],
        "kb_each": 1024 * float(slope),
    }


def draw(path: str, found: dict[str, tuple[list[float], list[float]]]) -> None:
    """Draw time and memory over the number of times."""
    with sheet(path, (9, 3.6), 100) as figure:
        for ax, k, label in zip(figure.subplots(1, 2), (0, 1), ("CPU ms", "MB of the process"), strict=True):
            for name, values in found.items():
                ax.plot(np.arange(1, len(values[k]) + 1), values[k], lw=0.8, label=name)
            ax.set(xlabel="scenes loaded, or materials swapped", ylabel=label)
            ax.set_yscale("log" if k == 0 else "linear")
        ax.set_ylim(bottom=0)
        ax.legend(frameon=False)


def _files(folder: Path) -> None:
    mi.set_variant("llvm_ad_rgb")
    material = me.Material.pretrained()
    for k in range(_FILES):
        material.edit(alpha_x=0.1 + 0.02 * k, alpha_y=0.1 + 0.02 * k).save(folder / f"{k}.bsdf")


def _found(args) -> Iterator[tuple[str, tuple[list[float], list[float]]]]:
    with tempfile.TemporaryDirectory() as folder:
        _files(Path(folder))
        for load in args.only or LOADS:
            n = min(args.count, args.networks) if load == "networks" else args.count
            flush = args.flush if load == "networks" else 0
            # spawn: Dr.Jit's threads do not survive a fork
            with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
                yield load, pool.submit(soak, load, n, folder, flush).result()


def main() -> None:
    """Run the benchmark of the command line."""
    parser = common.parser(__doc__)
    parser.add_argument("--only", action="append", choices=LOADS, help="repeatable (default: all)")
    parser.add_argument("-n", "--count", type=int, default=1000, help="times (default: %(default)s)")
    parser.add_argument("--networks", type=int, default=300, help="of the last load (default: %(default)s)")
    parser.add_argument(
        "--flush", type=int, default=0, metavar="N", help="drop kernels after N networks (default: never)"
    )
    parser.add_argument("--plot", metavar="PNG")
    parser.add_argument("-o", "--output", default="out/soak", help="folder (default: %(default)s)")
    args = parser.parse_args()
    about, found = machine(), {}
    for load, values in _found(args):
        found[load] = values
        print(row(load, *values), flush=True)
    rows = [row(load, *values) for load, values in found.items()]
    Path(args.output).mkdir(parents=True, exist_ok=True)
    write_table(rows, Path(args.output) / "soak", COLUMNS)
    if args.plot:
        draw(args.plot, found)
    common.finish(rows, COLUMNS, title="long use", about=about, as_json=args.json)


if __name__ == "__main__":
    main()
