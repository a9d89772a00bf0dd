"""Damaged photographs, masks and poses, in processes of their own: read or refused in a sentence, never a crash.

``python tests/images/photograph_damage.py FOLDER INPUTS SEED [NAMES]``, with ``tests`` on the path, tries more.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

_HARNESS = Path(__file__).with_name("photograph_damage.py")
_FAST = ["zip.exr", "tiled.exr", "deep.exr", "overscan.exr", "parts.exr", "rgb.png", "rgba16.png", "baseline.jpg"]


def fuzz(folder: Path, inputs: int, seed: int, *names: str) -> dict:
    paths = os.pathsep.join([str(_HARNESS.parents[1]), str(_HARNESS.parents[2]), os.environ.get("PYTHONPATH", "")])
    command = [sys.executable, str(_HARNESS), str(folder), str(inputs), str(seed), *names]
    done = subprocess.run(command, capture_output=True, env={**os.environ, "PYTHONPATH": paths}, timeout=3600)
    tried = folder / "tried"
    at = tried.read_text() if tried.exists() else "nothing"
    assert done.returncode == 0, f"ended with {done.returncode} at {at}: {done.stderr[-2000:].decode(errors='replace')}"
    return json.loads(done.stdout.splitlines()[-1].decode().rpartition("\x1b[0m")[2])


@pytest.mark.parametrize("seed", [0, 1])  # 1: as masks
def test_damage_is_read_or_refused(tmp_path, seed):
    found = fuzz(tmp_path, 8, seed, *_FAST, "transforms.json")
    assert found["wrong"] == 0 and found["tried"] == 8 * (len(_FAST) + 1) and found["refused"] > 8


@pytest.mark.slow
def test_much_damage_is_read_or_refused(tmp_path):
    """5 GB: 150 million pixels, the most that are read, twice as float32; a header that asks for more is seen."""
    for seed in (2, 3):
        found = fuzz(tmp_path, 200, seed)
        assert found["wrong"] == 0 and found["megabytes"] < 5000
