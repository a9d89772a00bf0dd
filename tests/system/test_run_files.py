"""Files of long runs: what is computed once, and the settings a run is continued with."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mi_enhance.system.cache import cached
from mi_enhance.system.checks import positive_int
from mi_enhance.system.run_folder import keep_settings


def test_cached_computes_once(tmp_path):
    path, calls = tmp_path / "new" / "x.txt", []

    def compute():
        calls.append(1)
        return "value"

    for _ in range(3):
        assert cached(path, compute, Path.read_text, Path.write_text) == "value"
    assert len(calls) == 1 and [p.name for p in path.parent.iterdir()] == ["x.txt"]


def test_cached_keeps_nothing_of_a_write_that_failed(tmp_path):
    def write(path, value):
        path.write_text("half")
        raise OSError("disk is full")

    with pytest.raises(OSError, match="disk is full"):
        cached(tmp_path / "x.txt", lambda: "value", Path.read_text, write)
    assert list(tmp_path.iterdir()) == []


def test_settings_of_a_run_do_not_change(tmp_path):
    file = tmp_path / "run" / "settings.json"
    keep_settings(file, {"seed": 0, "hidden": (16, 16)}, "train()")
    before = file.read_bytes()
    keep_settings(file, {"hidden": [16, 16], "seed": 0}, "train()")
    with pytest.raises(
        ValueError, match=r'train\(\): ".*settings.json" is of a run with other settings \(seed, steps\)'
    ):
        keep_settings(file, {"seed": 1, "hidden": (16, 16), "steps": 3}, "train()")
    assert file.read_bytes() == before
    keep_settings(file, {"seed": 1}, "train()", begun=False)
    keep_settings(file, {"seed": 1}, "train()")


def test_settings_that_are_damaged_are_refused(tmp_path):
    file = tmp_path / "settings.json"
    file.write_text('{"seed": ')
    with pytest.raises(ValueError, match="settings.json is no JSON"):
        keep_settings(file, {"seed": 0}, "train()")


@pytest.mark.parametrize("value", [1, np.int64(1), np.uint8(1)])
def test_whole_numbers_are_positive_integers(value):
    assert positive_int(value, "spp", "render()") == 1


@pytest.mark.parametrize("value", [0, -3, 1.0, np.float32(2), True, np.bool_(True), "4", None])
def test_others_are_not(value):
    with pytest.raises(ValueError, match=r"render\(\): spp is .*; it must be a positive integer"):
        positive_int(value, "spp", "render()")
