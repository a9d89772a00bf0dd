"""Output that cannot be shown as it is, or that nobody reads any more, is no error."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from mi_enhance.cli import streams
from mi_enhance.system import llvm
from mi_enhance.system.bundled_files import network_file

COMMAND = [sys.executable, "-m", "mi_enhance"]


def shell(line: str, **environment: str) -> subprocess.CompletedProcess:
    environment = {**os.environ, "DRJIT_LIBLLVM_PATH": llvm.found.path, **environment}
    program = " ".join(f"'{part}'" for part in COMMAND)
    line = line.replace("mi-enhance", program).replace("MAT", str(network_file("ggx")))
    return subprocess.run(["bash", "-c", line], capture_output=True, env=environment, timeout=120)


@pytest.mark.parametrize("encoding", ["ascii", "cp1252", "latin-1"])
def test_tables_are_printed_in_any_encoding(encoding):
    """The tables hold a dash and a Greek letter."""
    code = (
        "from mi_enhance.cli import streams; from mi_enhance.output.table import print_table; streams.accept_any(); "
        "print_table([{'label': 'GGX', 'delta_E_ITP_1000': None, 'ssim': 1.0}], title='Größe ρ → α'); print('Δ')"
    )
    child = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        env={**os.environ, "PYTHONIOENCODING": encoding, "DRJIT_LIBLLVM_PATH": llvm.found.path},
    )
    assert child.returncode == 0, child.stderr
    text = child.stdout.decode(encoding)
    assert "GGX" in text and text.rstrip().endswith("?")


@pytest.mark.parametrize(
    "line, status",
    [
        ("mi-enhance show MAT | true; exit ${PIPESTATUS[0]}", streams.CLOSED),
        ("PYTHONUNBUFFERED=1 mi-enhance show MAT --json | true; exit ${PIPESTATUS[0]}", streams.CLOSED),
        ("mi-enhance show nothing.bsdf 2>&1 | true; exit ${PIPESTATUS[0]}", streams.CLOSED),
        ("mi-enhance show MAT >&-", 0),
        ("mi-enhance show nothing.bsdf 2>&-", 2),
        ("mi-enhance show MAT >&- 2>&-", 0),
    ],
    ids=["pipe", "json", "error", "no stdout", "no stderr", "neither"],
)
def test_streams_that_are_closed_are_no_error(line, status):
    child = shell(line)
    assert (child.returncode, child.stdout, child.stderr) == (status, b"", b"")


def test_help_ends_silently_where_nobody_reads_it():
    child = shell("mi-enhance fit --help | true; exit ${PIPESTATUS[0]}", PYTHONUNBUFFERED="1")
    assert child.returncode in (0, streams.CLOSED) and child.stderr == b""


def test_full_disk_behind_standard_output_is_one_line():
    child = shell("if [ -e /dev/full ]; then mi-enhance show MAT >/dev/full; else exit 2; fi")
    assert child.returncode == 2 and child.stderr.count(b"\n") <= 1


def test_broken_pipe_of_somebody_else_is_an_error(capsys):
    with pytest.raises(BrokenPipeError), streams.until_closed():
        raise BrokenPipeError("a process that works for this one died")


def test_help_imports_no_more_than_the_package(run_child):
    code = """
import sys, mi_enhance
before = set(sys.modules)
from mi_enhance.cli.main import parser
parser().parse_args(["fit", "d.csv", "-o", "m.bsdf"])
new = set(sys.modules) - before
print(sorted({"rich", "tqdm", "numpy", "matplotlib", "scipy"} & {n.partition(".")[0] for n in new}))
print([n for n in new if n.startswith("mi_enhance.") and not n.startswith(("mi_enhance.cli", "mi_enhance.system"))])
"""
    child = run_child(code, DRJIT_LIBLLVM_PATH=llvm.found.path)
    assert child.stdout.split() == ["[]", "[]"], child.stdout + child.stderr
