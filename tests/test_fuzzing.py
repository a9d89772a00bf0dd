"""Any damaged file is read or refused in a sentence; a full disk or a kill while writing leaves the old file whole."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import fuzzing

import mi_enhance  # noqa: F401  (before mitsuba)

import mitsuba as mi  # isort: skip
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mi_enhance import data
from mi_enhance.data import directions
from mi_enhance.system import files

SMALL = [reader for reader in fuzzing.READERS if reader not in ("MERL", "RGL", "NPs decoder")]
anything = settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Path and content of an intact file for every reader."""
    mi.set_variant("llvm_ad_rgb")
    return {r: fuzzing.intact(r, tmp_path_factory.mktemp(re.sub(r"\W", "", r))) for r in fuzzing.READERS}


@pytest.mark.parametrize("reader", fuzzing.READERS)
def test_intact_file_is_read(llvm, whole, reader):
    path, content = whole[reader]
    path.write_bytes(content)
    assert fuzzing.attempt(reader, path) == "read"


@pytest.mark.parametrize("reader", SMALL)
@anything
@given(seed=st.integers(0, 2**32 - 1))
def test_damaged_file_is_read_or_refused(whole, reader, seed):
    path, content = whole[reader]
    path.write_bytes(fuzzing.damage(content, np.random.default_rng(seed)))
    assert fuzzing.attempt(reader, path) in ("read", "refused")


@pytest.mark.parametrize("reader", SMALL)
@anything
@given(content=st.binary(max_size=200))
def test_any_bytes_are_read_or_refused(whole, reader, content):
    path, good = whole[reader]
    for head in (b"", good[:20]):
        path.write_bytes(head + content)
        assert fuzzing.attempt(reader, path) in ("read", "refused")


def test_the_damage_reaches_what_lies_behind_the_header(llvm, whole):
    """Some damaged files are read, and what refuses the others is not always the same."""
    path, content = whole["material"]
    rng, messages, read = np.random.default_rng(0), set(), 0
    for _ in range(300):
        path.write_bytes(fuzzing.damage(content, rng))
        try:
            fuzzing.READERS["material"][2](path)
            read += 1
        except ValueError as error:
            messages.add(re.sub(r"[\d\[\]'\".,-]+", "", str(error).split(": ", 1)[1])[:25])
    assert read > 5 and len(messages) > 10


def test_words_of_a_file_are_unicode(tmp_path):
    """Found by fuzzing: Python made a string of such numbers and failed when it was compared."""
    names = np.array(["brass", "paint"])
    names.view(np.uint32)[2] = 0x7FFFFFFF
    np.savez(tmp_path / "x.npz", names=names, mean=np.zeros((2, 7), np.float32))
    with pytest.raises(ValueError, match="x.npz.*characters that do not exist"):
        data.load(tmp_path / "x.npz", material="brasss")


# --- writing ----------------------------------------------------------------------------------------------------------

# What writes a file at `path`; the second time with other content.
WRITERS = {
    "material": ("fuzzing._material().edit(rho_d=time % 1).save(path)", ".bsdf"),
    "table .csv": ("data.save_table(fuzzing._table(), path)", ".csv"),
    "table .npz": ("data.save_table(fuzzing._table(), path)", ".npz"),
    "MERL": ("merl.write_merl(path, lambda wi, wo: np.full((len(wi), 3), 0.1))", ".binary"),
    "training set": ("TrainingSet(['a'], ['nps'], np.random.rand(9, 99).astype('f'), 99).save(path)", ".npz"),
    "plot": ("curve_picture.draw_curve([{'step': k, 'loss': time + k} for k in (1, 2)], path)", ".png"),
    "image": ("save_image(path)", ".exr"),
}
_PREPARE = f"""
import sys; sys.path.insert(0, {str(Path(__file__).parent)!r})
import resource
from pathlib import Path
from time import time as clock
import fuzzing
import mitsuba as mi
import numpy as np
from mi_enhance import data
from mi_enhance.data import directions
from mi_enhance.data import merl
from mi_enhance.system import files
from mi_enhance.training import curve_picture
from mi_enhance.training.training_set import TrainingSet
mi.set_variant("llvm_ad_rgb")
path, time = Path(sys.argv[1]), clock()
def save_image(path):
    with files.replacing(path) as temporary:
        mi.Bitmap(np.random.rand(64, 64, 3).astype("f")).write(temporary)
"""


def child(code: str, path: Path) -> subprocess.Popen:
    """A process that has everything at hand to write `path`."""
    return subprocess.Popen(
        [sys.executable, "-c", _PREPARE + code, str(path)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


@pytest.mark.parametrize("writer", WRITERS)
def test_a_full_disk_leaves_the_old_file_and_nothing_else(tmp_path, writer):
    """A limit on the size of files: the system refuses the write as it would on a full disk."""
    write, suffix = WRITERS[writer]
    path = tmp_path / f"x{suffix}"
    code = f"""
{write}
resource.setrlimit(resource.RLIMIT_FSIZE, (100, resource.RLIM_INFINITY))
before, time = path.read_bytes(), time + 0.5
try:
    {write}
except (OSError, RuntimeError) as error:
    print("said", error)
print(path.read_bytes() == before, [p.name for p in path.parent.iterdir()])
"""
    out, err = child(code, path).communicate(timeout=100)
    said, same = out.splitlines()[-2:]
    assert said.startswith("said") and same == f"True ['x{suffix}']", out + err


@pytest.mark.slow
def test_a_kill_while_writing_leaves_a_whole_file(llvm, tmp_path):
    """Eight kills at moments of their own, of a process that does nothing but save."""
    path, rng = tmp_path / "x.npz", np.random.default_rng(1)
    m = data.Measurements(*directions.sample_pairs(200_000), np.ones((200_000, 3)))
    data.save_table(m, path)
    halves = 0
    code = "m = data.load(path, n_samples=10**6)\nprint('go', flush=True)\nwhile True: data.save_table(m, path)"
    for _ in range(8):
        process = child(code, path)
        assert process.stdout.readline() == "go\n", process.communicate()[1]
        time.sleep(0.3 * rng.random())
        process.send_signal(signal.SIGKILL)
        process.communicate()
        assert len(data.load(path, n_samples=10**6).f) == 200_000
        halves += len(list(tmp_path.iterdir())) - 1
        for left in tmp_path.glob(".x.npz.*"):
            left.unlink()
    assert halves > 0  # some of the kills did hit a half-written file


def test_an_interrupted_write_takes_its_half_file_away(tmp_path):
    path = tmp_path / "x.txt"
    path.write_text("old")
    with pytest.raises(KeyboardInterrupt), files.replacing(path) as temporary:
        Path(temporary).write_text("half")
        raise KeyboardInterrupt
    assert path.read_text() == "old" and os.listdir(tmp_path) == ["x.txt"]


def test_a_damaged_log_of_a_run_is_refused(tmp_path):
    path = tmp_path / "curve.jsonl"
    for content, message in (
        ('{"step": 1, "loss": 2}\n{"st', r"curve.jsonl is no JSON"),
        (
            '{"step": 1, "loss": 2}\n{"step": 2}\n',
            r"curve.jsonl, line 2, .*: loss is missing. It is",
        ),
        ("[1, 2]\n", r"line 1, is no object with the entries step, loss"),
        ("[" * 100_000, "is no JSON"),
    ):
        path.write_text(content)
        with pytest.raises(ValueError, match=message):
            files.read_json(path, "test", ("step", "loss"), lines=True)
