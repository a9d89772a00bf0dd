"""Finds a libLLVM that Dr.Jit can use, before Dr.Jit loads one.

Dr.Jit loads libLLVM while ``drjit`` is imported (``import mitsuba`` does that) and keeps it. With LLVM 15 and 16 that
goes well until a kernel holds a minimum or maximum; then LLVM ends the whole process ("Cannot select: fminimum").
Measured with Dr.Jit 1.5.0: 14 is refused, 15 and 16 abort, 17, 18 and 23 render. So the choice is made here:

1. the user's own ``DRJIT_LIBLLVM_PATH``,
2. the library in the wheel ``karellen-llvm-core`` (installed with mi_enhance where that wheel exists),
3. the newest LLVM of the system that is new enough.

If none is found, importing mi_enhance fails with one sentence, except on a machine with a GPU: there Dr.Jit can do
without LLVM, so that one warning is all, and only if an LLVM was loaded that would abort the process.
"""

from __future__ import annotations

import glob
import importlib.metadata
import os
import re
import shutil
import subprocess
import sys
import warnings
from pathlib import Path
from typing import NamedTuple

VARIABLE = "DRJIT_LIBLLVM_PATH"
OLDEST = 17  # the first version that can select fminimum / fmaximum, which Dr.Jit emits for every dr.minimum
WHEEL = "karellen-llvm-core"

# Where package managers put libLLVM when the dynamic linker does not list it (LLVM-C.dll is its name on Windows).
_FOLDERS = (
    f"{sys.prefix}/lib",  # conda
    "/usr/lib/llvm-*/lib",
    "/usr/lib64/llvm*/lib*",
    "/usr/lib64",
    "/usr/local/lib",
    "/opt/homebrew/opt/llvm*/lib",
    "/usr/local/opt/llvm*/lib",
    "/opt/local/libexec/llvm-*/lib",
    "C:/Program Files/LLVM/bin",
)
_NAMES = ("libLLVM*.so*", "libLLVM*.dylib", "LLVM-C.dll")


class LLVMLibrary(NamedTuple):
    """The LLVM in use: `path` ("" if Dr.Jit chose it itself), `version` (None if unknown), where it came from."""

    path: str
    version: tuple[int, ...] | None
    origin: str


found: LLVMLibrary | None = (
    None  # what prepare() returned, and why it failed: set by mi_enhance/__init__.py, read by doctor
)
problem = ""


def prepare() -> LLVMLibrary:
    """Choose an LLVM, let Dr.Jit load it, and check what it loaded.

    Returns
    -------
    LLVMLibrary
        The library in use; ``version`` is None if Dr.Jit has no LLVM at all (and works on a GPU).

    Raises
    ------
    ImportError
        If ``DRJIT_LIBLLVM_PATH`` names a library that cannot work, or if there is neither a usable LLVM nor a GPU.
    """
    early = "drjit" in sys.modules
    chosen = LLVMLibrary("", None, "loaded before mi_enhance") if early else _choose()
    if not early and chosen.path:
        os.environ[VARIABLE] = chosen.path

    import drjit as dr  # only now: this is the moment in which libLLVM is loaded

    version = dr.detail.llvm_version()  # (-1, -1, -1) if there is none
    if version[0] >= OLDEST:
        return chosen._replace(version=version)

    sentence = _too_early(version) if early else _unusable(version, chosen)
    if not any(dr.has_backend(b) for b in (dr.JitBackend.CUDA, dr.JitBackend.Metal)):
        raise ImportError(sentence)
    if version[0] > 0:
        warnings.warn(f"{sentence} Only the GPU variants are safe until then.", RuntimeWarning, stacklevel=2)
    return chosen._replace(version=version if version[0] > 0 else None)


def _choose() -> LLVMLibrary:
    """Return the library Dr.Jit is to load; an empty path if there is none worth naming."""
    own = os.environ.get(VARIABLE)
    if own:
        return _check_own(own)
    wheel = _in_wheel()
    if wheel:
        return LLVMLibrary(wheel, _version(wheel), f"wheel {WHEEL}")
    usable = [(v, p) for p in _in_system() if (v := _version(p)) and v[0] >= OLDEST]
    if usable:
        version, path = max(usable)
        return LLVMLibrary(path, version, "system")
    return LLVMLibrary("", None, "none found")


def _check_own(path: str) -> LLVMLibrary:
    """Accept the user's setting, or say what is wrong with it."""
    advice = f"Unset {VARIABLE} to let mi_enhance choose, or set it to a libLLVM of version {OLDEST} or newer."
    # A name without a folder is looked up by the dynamic linker: only loading it tells.
    if os.path.isdir(path):
        inside = sorted(p for name in _NAMES for p in glob.glob(f"{glob.escape(path)}/{name}"))
        said = f'. Name the library in it, "{inside[-1]}".' if inside else ", and holds no libLLVM. Name a library."
        raise ImportError(f'mi_enhance: {VARIABLE}="{path}" is a folder{said} {advice}')
    if os.path.dirname(path) and not os.path.exists(path):
        what = "is a link to a file that does not exist" if os.path.islink(path) else "does not exist"
        raise ImportError(f'mi_enhance: {VARIABLE}="{path}" {what}. {advice}')
    if os.path.dirname(path) and not os.path.isfile(path):
        raise ImportError(f'mi_enhance: {VARIABLE}="{path}" is no file. {advice}')
    if os.path.isfile(path) and not os.access(path, os.R_OK):
        raise ImportError(f'mi_enhance: {VARIABLE}="{path}" may not be read by you. {advice}')
    version = _version(path)
    if version is None:
        raise ImportError(f'mi_enhance: {VARIABLE}="{path}" cannot be loaded as an LLVM library. {advice}')
    if version[0] < OLDEST:
        raise ImportError(f'mi_enhance: {VARIABLE}="{path}" is LLVM {version[0]}, which Dr.Jit cannot use. {advice}')
    return LLVMLibrary(path, version, f"your {VARIABLE}")


def _in_wheel() -> str | None:
    """Return the libLLVM of the wheel, from its own list of files: they need not lie under sys.prefix."""
    try:
        files = importlib.metadata.files(WHEEL) or []
    except importlib.metadata.PackageNotFoundError:
        return None
    libraries = (Path(f.locate()).resolve() for f in files if f.name.startswith("libLLVM"))
    return next((str(p) for p in libraries if p.is_file()), None)


def _in_system() -> set[str]:
    """Return every libLLVM the dynamic linker or a package manager's usual folder knows, links resolved."""
    paths = [p for folder in _FOLDERS for name in _NAMES for p in glob.glob(f"{folder}/{name}")]
    ldconfig = shutil.which("ldconfig") or shutil.which("ldconfig", path="/sbin:/usr/sbin")
    if ldconfig:
        listing = subprocess.run([ldconfig, "-p"], capture_output=True, text=True, check=False).stdout
        paths += re.findall(r"=> (\S*/libLLVM[^/\s]*)$", listing, re.MULTILINE)
    return {os.path.realpath(p) for p in paths}


def _version(path: str) -> tuple[int, ...] | None:
    """Return the version of a libLLVM, or None if it cannot be told.

    The name tells it nearly always (libLLVM-15.so.1, libLLVM.so.19.1; not libLLVM.dylib). Else a
    child process asks the library itself: two LLVMs loaded into one process can end it.
    """
    name = os.path.realpath(path) if os.path.dirname(path) else path
    numbers = re.search(r"libLLVM(?:\.so\.|-)(\d+(?:\.\d+)*)[^/]*$", name)
    if numbers:
        return tuple(int(n) for n in numbers[1].split("."))
    # LLVMGetVersion came with LLVM 16: a library without it is reported as 15, the newest that it can be.
    ask = (
        "import ctypes, sys\n"
        "lib, v = ctypes.CDLL(sys.argv[1]), [ctypes.c_uint(n) for n in (15, 0, 0)]\n"
        "lib.LLVMContextCreate\n"
        "hasattr(lib, 'LLVMGetVersion') and lib.LLVMGetVersion(*map(ctypes.byref, v))\n"
        "print(*(n.value for n in v))"
    )
    answer = subprocess.run([sys.executable, "-I", "-c", ask, path], capture_output=True, text=True, check=False)
    return tuple(int(n) for n in answer.stdout.split()) if answer.returncode == 0 else None


def _too_early(version: tuple[int, ...]) -> str:
    """Say that Dr.Jit was loaded before us, with an LLVM that cannot work, and how to get the right one."""
    better = _choose()  # raises if the user's own setting is the cause
    loaded = f"LLVM {version[0]}, which ends the process at the first minimum" if version[0] > 0 else "no LLVM"
    remedy = f"or set {VARIABLE}={better.path}" if better.path else f"after: {install_command()}"
    return (
        f"mi_enhance: mitsuba or drjit was imported first and loaded {loaded} (Dr.Jit needs {OLDEST} or newer). "
        f"Start Python again and import mi_enhance before them, {remedy}."
    )


def _unusable(version: tuple[int, ...], chosen: LLVMLibrary) -> str:
    """Say that there is no LLVM, or that the chosen one could not be loaded, and which command helps."""
    if chosen.path:
        return (
            f'mi_enhance: Dr.Jit could not load "{chosen.path}" ({chosen.origin}); its own message is above. '
            f"Set {VARIABLE} to another libLLVM of version {OLDEST} or newer, or run: {install_command()}."
        )
    had = f"only LLVM {version[0]}, which ends the process at the first minimum" if version[0] > 0 else "none"
    return f"mi_enhance: Dr.Jit needs LLVM {OLDEST} or newer and found {had}. Run: {install_command()}."


def install_command() -> str:
    """Return the command that installs a usable LLVM on this kind of machine."""
    if sys.platform == "darwin":
        return "brew install llvm"
    if sys.platform == "win32":
        return "winget install LLVM.LLVM"
    if os.uname().machine == "x86_64":
        return f"pip install {WHEEL}"
    return "apt install libllvm19 (or your distribution's LLVM 17 or newer)"
