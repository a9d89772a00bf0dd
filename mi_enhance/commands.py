"""What the subcommands of ``mi-enhance`` do: each takes the parsed arguments, prints text and returns its JSON."""

from __future__ import annotations

import argparse
import contextlib
import json
import time
from pathlib import Path

_IMAGES = (".exr", ".png", ".jpg", ".hdr", ".pfm")


def doctor(args: argparse.Namespace) -> dict:
    from .doctor import examine, show

    report = examine()
    if not args.json:
        show(report)
    return report


def demo(args: argparse.Namespace) -> dict:
    _set_variant(args.variant)
    from .demo import demo

    return demo(args.output)


def fit(args: argparse.Namespace) -> dict:
    output = _output(args.output, (".bsdf",))
    _set_variant(args.variant)
    from tqdm import tqdm

    from .fitting.fit import fit

    measurements = _measurements(args)
    with tqdm(desc=f"fit {measurements.name}", unit=" steps", disable=args.json, leave=False) as bar:

        def progress(stage, step, loss):
            bar.update()
            bar.set_postfix_str(f"{stage}, log-L1 {loss:.5f}")

        material = fit(
            _network(args.network),
            measurements,
            method=args.method,
            reciprocal=args.reciprocal,
            energy=args.energy,
            seed=args.seed,
            callback=progress,
        )
    material.save(output)
    print(f"{material.show()}\n{output}")
    return {**material.report, "output": str(output)}


def fit_images(args: argparse.Namespace) -> dict:
    output = _output(args.output, (".bsdf",))
    mi = _set_variant(args.variant)
    from tqdm import tqdm

    from .images import fit_images as fit_images_module
    from .images import pictures
    from .images.view_files import read_views
    from .system.files import require_file

    file = require_file(args.scene, f'fit-images "{args.scene}"')
    define = dict(args.define)
    if "$material" in file.read_text(encoding="utf-8"):
        define.setdefault("material", str(_network_path(args.network)))
    scene, views = mi.load_file(str(file), **define), read_views(args.views)
    with tqdm(desc=f"fit {len(views)} views", unit=" steps", disable=args.json, leave=False) as bar:

        def progress(stage, step, loss):
            bar.update()
            bar.set_postfix_str(f"{stage}, loss {loss:.5f}")

        found = fit_images_module.fit_images(
            scene,
            views,
            unknowns=args.unknown,
            light_scale=args.light_scale,
            stages=args.stages or fit_images_module.STAGES,
            max_depth=args.max_depth,
            seed=args.seed,
            callback=progress,
            preview=args.preview,
        )
    outputs = []
    for name, material in found.materials.items():
        outputs.append(output if len(found.materials) == 1 else output.with_stem(f"{output.stem}_{name}"))
        material.save(outputs[-1])
        print(f"{material.show()}\n{outputs[-1]}")
    if args.preview:
        pictures.draw_views(views, found.renders, Path(args.preview) / "views.png")
        pictures.draw_convergence({output.stem: found.curve}, Path(args.preview) / "convergence.png")
    for row in found.report["views"]:
        print(f"{row['name']} ({row['split']}): mean abs log difference {row['mean_abs_log']:.4f}")
    return {**found.report, "curve": found.curve, "outputs": [str(path) for path in outputs]}


def render(args: argparse.Namespace) -> dict:
    output = _output(args.output, _IMAGES)
    mi = _set_variant(args.variant)
    from .system.files import replacing, require_file

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


def show(args: argparse.Namespace) -> dict:
    output = _output(args.output, (".bsdf",)) if args.output else None
    _set_variant(args.variant)
    from .material.material import Material

    material = Material.load(args.file)
    if args.edits:
        material = material.edit(**dict(args.edits))
    if output:
        material.save(output)
    text = material.show()
    print(text)
    return {"text": text, "output": str(output) if output else None}


def check(args: argparse.Namespace) -> dict:
    _set_variant(args.variant)
    from tqdm import tqdm

    from .evaluation.check import COLUMNS, check
    from .material.material import Material
    from .output.table import print_table

    material = Material.load(args.file)
    with tqdm(desc="check", unit=" parts", disable=args.json, leave=False) as bar:

        def progress(part):
            bar.update()
            bar.set_postfix_str(part)

        result = check(material, args.output, seed=args.seed, callback=progress)
    print_table(result["rows"], COLUMNS, title=args.file)
    print("\n".join([*result["files"].values(), "all as it should be" if result["ok"] else "something is off"]))
    return result


def specialize(args: argparse.Namespace) -> dict:
    output = _output(args.output, (".bsdf",))
    _set_variant(args.variant)
    from .material.material import Material
    from .specialization.specialize import specialize

    material = Material.load(args.file)
    if args.undo:
        if not material.brdf.compact:
            raise ValueError(
                f'specialize --undo: "{args.file}" keeps no exact material to go back to. Nothing was written.'
            )
        material = material.exact
    else:
        measurements = _measurements(args) if args.data else None
        material = specialize(material, measurements, max_error=args.max_error, textured=args.textured, seed=args.seed)
    material.save(output)
    print(f"{material.show()}\n{output}")
    return {**material.report, "output": str(output)}


def convert(args: argparse.Namespace) -> dict:
    output = _output(args.output, (".csv", ".npz"))
    _set_variant(args.variant)
    from .data.loading import save_table

    measurements = _measurements(args)
    save_table(measurements, output)
    print(f"{output}: {len(measurements.f)} samples of {measurements.name}")
    return {
        "output": str(output),
        "name": measurements.name,
        "n_samples": len(measurements.f),
        "clamped_fraction": measurements.clamped_fraction,
    }


def train(args: argparse.Namespace) -> dict:
    from .system.files import require_file

    where = f'train "{args.config}"'
    try:
        config = json.loads(require_file(args.config, where).read_text())
        if not isinstance(config, dict):
            raise ValueError("no object { ... }")
    except ValueError as error:
        raise ValueError(f"{where}: no JSON settings ({error}). Write it like the config.json of a run.") from None
    config.update((key, _json_or_text(value)) for key, value in args.define)
    _set_variant(args.variant)
    from .training.train import train

    trainer = train(config, Path(args.output), progress=not args.json)
    print(f"{args.output}: {trainer.step} steps, {trainer.n_materials} materials")
    return {"output": args.output, "steps": trainer.step, "n_materials": trainer.n_materials}


def search(args: argparse.Namespace) -> dict:
    output = _output(args.output, (".bsdf",))
    if args.scheduler and args.workers > 1:
        raise ValueError("--workers and --scheduler exclude each other: a Dask cluster has its own workers.")
    if "model" in dict(args.define):
        raise ValueError("-D model: the model is the first argument of the command.")
    data, validation = (_sources(names) for names in (args.data, args.validation))
    _set_variant(args.variant)
    from .hypercube.search import search

    folder = output.with_suffix(".search")
    start = time.perf_counter()
    with _executor(args) as executor:
        found = search(
            args.model,
            data,
            folder,
            validation=validation,
            executor=executor,
            progress=not args.json,
            **{key: _json_or_text(value) for key, value in args.define},
        )
    found.network.save(output)
    print(f"{found.network.brdf}\n{output}\n{folder / 'search.png'}")
    return {
        "output": str(output),
        "model": str(found.network.brdf),
        "seconds": time.perf_counter() - start,
        "stages": [{k: v for k, v in s.items() if k != "candidates"} for s in found.stages],
        "pareto": [{k: row[k] for k in ("equation", "loss", "cost")} for row in found.pareto],
    }


def _sources(names: list[str]) -> list[dict]:
    """Sources of all materials in the files that `names` stand for."""
    import glob

    from .training.sources import sources_of

    sources = []
    for name in names:
        files = sorted(glob.glob(name)) if glob.has_magic(name) else [name]
        if not files:
            raise ValueError(f'search: no file matches "{name}". Check the pattern.')
        for file in files:
            sources += sources_of(file)
    return sources


@contextlib.contextmanager
def _executor(args: argparse.Namespace):
    """What trains the candidates: this process (None), processes of this machine, or a Dask cluster."""
    if args.scheduler:
        try:
            from distributed import Client
        except ImportError:
            raise ImportError('--scheduler needs Dask. Install it: pip install "mi-enhance[cluster]"') from None
        with Client(args.scheduler) as client:
            yield client.get_executor(pure=False)
    elif args.workers > 1:
        import multiprocessing
        from concurrent.futures import ProcessPoolExecutor

        # spawn: Dr.Jit's threads do not survive a fork
        pool = ProcessPoolExecutor(args.workers, mp_context=multiprocessing.get_context("spawn"))
        try:
            yield pool
        finally:
            pool.shutdown(wait=True, cancel_futures=True)
    else:
        yield None


def compare(args: argparse.Namespace) -> dict:
    _set_variant(args.variant)
    from .evaluation.compare import compare_files, default_models
    from .output.table import print_table

    result = compare_files(
        args.data,
        out_dir=args.output,
        models=default_models(_network(args.network)),
        method=args.method,
        n_samples=args.samples,
        seed=args.seed,
        scene=args.scene,
        resolution=args.resolution,
        spp=args.spp,
        log=print,
    )
    print_table(result["rows"] + result["mean"])
    return result


def bench(args: argparse.Namespace) -> dict:
    _set_variant(args.variant)
    from .benchmark.benchmark import COLUMNS, bench
    from .benchmark.growth import GROWTH_COLUMNS
    from .output.table import print_table
    from .system.bundled_files import demo_data

    result = bench(
        args.data or [demo_data("satin_rosaline_rgb.bsdf")],
        args.output,
        resolution=args.resolution,
        spp=args.spp,
        rounds=args.rounds,
        samples=args.samples,
        seed=args.seed,
        log=(lambda _: None) if args.json else print,
    )
    print_table(result["rows"], COLUMNS, title=", ".join(result["materials"]))
    print_table(result["growth"], GROWTH_COLUMNS, title="how the time of a frame grows")
    print(f"{result['files']['html']}\n" + ", ".join(f"{k} {v}" for k, v in result["machine"].items()))
    return result


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
    from . import data

    return data.load(args.data, n_samples=args.samples, seed=args.seed, material=args.material)


def _json_or_text(value: str):
    try:
        return json.loads(value)
    except ValueError:
        return value


def _network(name: str):
    from .material.material import Material

    return Material.analytic(name) if name.endswith(".toml") else Material.load(_network_path(name))


def _network_path(name: str) -> Path:
    from .system.bundled_files import network_file

    return Path(name) if name.endswith(".bsdf") else network_file(name)
