"""``mi-enhance doctor``: what is installed here, and what works.

Whatever could end a process is tried in a child process, so that it is reported and not suffered.
"""

from __future__ import annotations

import argparse
import importlib.metadata
import platform
import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

from .. import __version__
from ..system import llvm
from . import arguments

VARIANTS = ("scalar_rgb", "llvm_ad_rgb", "llvm_ad_mono", "llvm_ad_spectral", "cuda_ad_rgb")
_PACKAGES = ("mitsuba", "drjit", "numpy", "OpenEXR", "colour-science", "scikit-image")
_TIME_LIMIT = 120  # seconds; a cold compilation on a slow machine takes about 20


def add(subparsers: arguments.Subparsers) -> None:
    text = "tell what is installed and which variants work; exit 0 if rendering works"
    arguments.command(subparsers, "doctor", text, run)


def run(args: argparse.Namespace) -> dict:
    from .doctor_table import print_report

    report = examine()
    if not args.json:
        print_report(report)
    return report


def examine() -> dict:
    """Look at this installation.

    Returns
    -------
    dict
        ``versions`` (name to version), ``llvm`` (path, version, origin, problem), ``variants`` (name to ``"works"`` or
        what is wrong), ``enhanced`` (variant, and ``"works"`` or what is wrong), ``rendering_works``.

    Examples
    --------
    >>> examine()["rendering_works"]  # doctest: +SKIP
    True
    """
    with ThreadPoolExecutor(2) as pool:
        variants = dict(zip(VARIANTS, pool.map(lambda v: _try_in_child(v, "diffuse"), VARIANTS), strict=True))
    best = "cuda_ad_rgb" if variants["cuda_ad_rgb"] == "works" else "llvm_ad_rgb"
    enhanced = _try_in_child(best, "enhanced")
    found = llvm.found or llvm.LLVMLibrary("", None, "none")
    return {
        "versions": {
            "python": platform.python_version(),
            "platform": platform.platform(),
            "mi_enhance": __version__,
            **{name: _installed(name) for name in _PACKAGES},
        },
        "llvm": {
            "path": found.path,
            "version": ".".join(map(str, found.version)) if found.version else None,
            "origin": found.origin,
            "problem": llvm.problem or None,
        },
        "variants": variants,
        "enhanced": {"variant": best, "result": enhanced},
        "rendering_works": enhanced == "works",
    }


def try_variant(variant: str, bsdf: str) -> None:
    """Render a tiny sphere: what the child processes do. Raises, or ends the process, if it cannot be done.

    The sphere is lit and sampled such that the kernels hold minima and maxima, which an old LLVM cannot compile.
    """
    import drjit as dr
    import mitsuba as mi
    import numpy as np

    from ..system.bundled_files import network_file

    if variant.startswith("cuda") and not dr.has_backend(dr.JitBackend.CUDA):
        raise RuntimeError("no NVIDIA GPU with a working driver")
    mi.set_variant(variant)
    material = {"type": "enhanced", "filename": str(network_file("ggx"))} if bsdf == "enhanced" else {"type": bsdf}
    scene = mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "direct"},
            "sensor": {
                "type": "perspective",
                "to_world": mi.ScalarTransform4f().look_at([0, 0, 4], [0, 0, 0], [0, 1, 0]),
                "film": {"type": "hdrfilm", "width": 16, "height": 16},
            },
            "light": {"type": "constant"},
            "ball": {"type": "sphere", "bsdf": material},
        }
    )
    image = np.array(mi.render(scene, spp=4))
    if not (np.isfinite(image).all() and image.max() > 0):
        raise RuntimeError(f'doctor: variant "{variant}" rendered a wrong image (values not finite, or black).')


def _try_in_child(variant: str, bsdf: str) -> str:
    if llvm.problem:
        return "not tried"
    return _in_child(f"from mi_enhance.cli.doctor import try_variant; try_variant({variant!r}, {bsdf!r})")


def _in_child(code: str) -> str:
    """Run Python code in a process of its own and return "works", or one line that says what happened."""
    try:
        child = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, timeout=_TIME_LIMIT, check=False
        )
    except subprocess.TimeoutExpired:
        return f"no answer within {_TIME_LIMIT} s"
    if child.returncode == 0:
        return "works"
    lines = [line.strip() for line in child.stderr.splitlines() if line.strip()] or ["no message"]
    if child.returncode < 0:  # ended by a signal, as an abort in LLVM does; its message comes first, then details
        name = signal.Signals(-child.returncode).name
        return f"the process died ({name}): {next((x for x in lines if 'ERROR' in x), lines[-1])}"
    return lines[-1].partition("Error: ")[2] or lines[-1]


def _installed(name: str) -> str:
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return "not installed"
