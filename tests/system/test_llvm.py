"""The LLVM that Dr.Jit gets: chosen before it loads, and never one that ends the process."""

from __future__ import annotations

import os

import drjit as dr
import pytest

from mi_enhance.system import llvm

# Any kernel with a minimum makes LLVM 15 and 16 end the process.
USE = "import mitsuba as mi, drjit as dr; mi.set_variant('llvm_ad_rgb'); print(dr.minimum(mi.Float([1, 5]), 2))"


def no_gpu():
    return not (dr.has_backend(dr.JitBackend.CUDA) or dr.has_backend(dr.JitBackend.Metal))


needs_no_gpu = pytest.mark.skipif(not no_gpu(), reason="with a GPU a missing LLVM is no error")


def old_llvm():
    """An LLVM of this machine that Dr.Jit loads and then dies of."""
    versions = {p: llvm._version(p) for p in llvm._in_system()}
    return next((p for p, v in versions.items() if v and 15 <= v[0] < llvm.OLDEST), None)


@pytest.mark.parametrize(
    "path, version",
    [
        ("/some/lib/libLLVM-15.so.1", (15,)),
        ("/some/lib/libLLVM-14.0.6.so.1", (14, 0, 6)),
        ("/some/llvm-18/lib/libLLVM.so.19.1", (19, 1)),
        ("/env/lib/libLLVM-17.so", (17,)),
        ("libLLVM.so.23.1", (23, 1)),
    ],
)
def test_version_is_read_from_the_file_name(path, version):
    assert llvm._version(path) == version


def test_version_of_a_nameless_library_is_asked_of_the_library(tmp_path):
    library = llvm.found.path
    if not library:
        pytest.skip("mitsuba was loaded before mi_enhance: no path is known")
    # The copy must lie beside the original, because it looks there for the libraries it needs itself.
    link = tmp_path / "renamed.so"
    link.symlink_to(library)
    assert llvm._version(str(link))[0] == llvm.found.version[0]


def test_version_of_another_library_is_unknown(tmp_path):
    other = tmp_path / "libLLVM.so"
    other.write_bytes(b"not a library")
    assert llvm._version(str(other)) is None


@pytest.mark.parametrize(
    "name, message",
    [
        ("missing/libLLVM.so", r'DRJIT_LIBLLVM_PATH=".*missing/libLLVM.so" does not exist\. Unset DRJIT_LIBLLVM_PATH'),
        ("libLLVM-15.so.1", r'DRJIT_LIBLLVM_PATH=".*" is LLVM 15, which Dr\.Jit cannot use\..* version 17 or newer'),
        ("libLLVM.so", r'DRJIT_LIBLLVM_PATH=".*" cannot be loaded as an LLVM library'),
    ],
    ids=["missing", "old", "no library"],
)
def test_own_setting_that_cannot_work_is_refused(tmp_path, monkeypatch, name, message):
    if "/" not in name:
        (tmp_path / name).write_bytes(b"not a library")
    monkeypatch.setenv(llvm.VARIABLE, str(tmp_path / name))
    with pytest.raises(ImportError, match=message):
        llvm._choose()


@pytest.mark.parametrize(
    "make, message",
    [
        (lambda p: p.mkdir(), r'" is a folder, and holds no libLLVM\. Name a library\. Unset'),
        (
            lambda p: (p.mkdir(), (p / "libLLVM-19.so").touch()),
            r'" is a folder\. Name the library in it, ".*x/libLLVM-19\.so"',
        ),
        (lambda p: p.symlink_to("gone"), r'" is a link to a file that does not exist\. Unset'),
        (lambda p: os.mkfifo(p), r'" is no file\. Unset'),
        (lambda p: p.write_text("text"), r'" cannot be loaded as an LLVM library\. Unset'),
    ],
    ids=["folder", "folder of the library", "link", "pipe", "text"],
)
def test_own_setting_that_is_no_library_says_what_it_is(tmp_path, monkeypatch, make, message):
    path = tmp_path / "x"
    make(path)
    monkeypatch.setenv(llvm.VARIABLE, str(path))
    with pytest.raises(ImportError, match=f'DRJIT_LIBLLVM_PATH=".*x{message}'):
        llvm._choose()


def test_choice_is_own_then_wheel_then_newest_of_the_system(tmp_path, monkeypatch):
    own = tmp_path / "libLLVM-20.so"
    own.touch()
    monkeypatch.setattr(llvm, "_in_wheel", lambda: "/wheel/libLLVM.so.23.1")
    system = {"/usr/lib/libLLVM-15.so.1", "/usr/lib/libLLVM.so.18.1", "/usr/lib/libLLVM.so.19.1"}
    monkeypatch.setattr(llvm, "_in_system", lambda: system)
    monkeypatch.setenv(llvm.VARIABLE, str(own))
    assert llvm._choose().path == str(own)
    monkeypatch.delenv(llvm.VARIABLE)
    assert llvm._choose().path == "/wheel/libLLVM.so.23.1"
    monkeypatch.setattr(llvm, "_in_wheel", lambda: None)
    assert llvm._choose().path == "/usr/lib/libLLVM.so.19.1"
    system -= {"/usr/lib/libLLVM.so.18.1", "/usr/lib/libLLVM.so.19.1"}
    assert llvm._choose().path == ""


def test_import_of_mi_enhance_first_makes_llvm_usable(run_child):
    child = run_child(f"import mi_enhance; {USE}")
    assert (child.returncode, child.stdout.strip()) == (0, "[1, 2]"), child.stderr


def test_import_after_mitsuba_with_an_old_llvm_is_refused_not_fatal(run_child):
    library = old_llvm()
    if library is None:
        pytest.skip("this machine has no LLVM 15 or 16 to die of")
    if not no_gpu():
        pytest.skip("with a GPU this is a warning")
    # The variable is gone again when mi_enhance looks: as if Dr.Jit had found the old library itself.
    child = run_child(
        f"import os; import mitsuba; del os.environ['DRJIT_LIBLLVM_PATH']; import mi_enhance; {USE}",
        DRJIT_LIBLLVM_PATH=library,
    )
    assert child.returncode == 1, child.stderr  # an exception; the signal of an abort would be negative
    assert "mitsuba or drjit was imported first and loaded LLVM" in child.stderr
    assert "Start Python again and import mi_enhance before them, or set DRJIT_LIBLLVM_PATH=" in child.stderr


@needs_no_gpu
def test_import_without_any_llvm_names_the_command(run_child):
    child = run_child(
        "import drjit, mitsuba\n"  # finds nothing at the given path
        "import os; del os.environ['DRJIT_LIBLLVM_PATH']\n"
        "import importlib.metadata as m; m.files = lambda name: []\n"
        "import shutil, glob; shutil.which = lambda *a, **k: None; glob.glob = lambda *a, **k: []\n"
        "import mi_enhance",
        DRJIT_LIBLLVM_PATH="/nowhere/libLLVM.so",
    )
    assert child.returncode == 1
    assert (
        f"loaded no LLVM (Dr.Jit needs 17 or newer). Start Python again and import mi_enhance before them, after: "
        f"{llvm.install_command()}." in child.stderr
    )
