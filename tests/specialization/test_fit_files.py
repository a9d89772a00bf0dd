"""Fits of many files: each to its own, and nothing that is finished is lost."""

from __future__ import annotations

import json
import os
import shutil
import signal
import sys
import time
from pathlib import Path

import mi_enhance as me

import numpy as np  # isort: skip
import pytest

from mi_enhance import data
from mi_enhance.cli.main import main
from mi_enhance.specialization.fit_files import fit_files
from mi_enhance.system.workers import run_all

HOW = {"n_samples": 200, "seed": 3}


@pytest.fixture
def files(llvm, tmp_path):
    """Three tables of one GGX each."""
    wi, wo = data.directions.sample_pairs(200, seed=1)
    paths = []
    for k in range(3):
        truth = me.Material.analytic("ggx").edit(alpha_x=0.2 + 0.1 * k, alpha_y=0.3)
        paths.append(tmp_path / f"m{k}.npz")
        data.save_table(data.Measurements(wi, wo, truth.evaluate(wi, wo), f"m{k}"), paths[-1])
    return paths


def numbers(fits) -> list:
    return [me.load_material(f.output).as_vector() for f in fits]


def test_each_file_gets_its_own_material(files, tmp_path):
    heard = []
    fits = fit_files(me.Material.analytic("ggx"), files, tmp_path / "fits", **HOW, progress=heard.append)
    assert [Path(f.output).name for f in fits] == ["m0.bsdf", "m1.bsdf", "m2.bsdf"]
    assert all(f.report["log_l1"] < 1e-4 and not f.error for f in fits)
    params = [me.load_material(f.output).params for f in fits]
    products = [float(np.squeeze(p["alpha_x"] * p["alpha_y"])) for p in params]  # the tangent may turn by 90 degrees
    np.testing.assert_allclose(products, [0.06, 0.09, 0.12], rtol=0.02)
    assert [p.step for p in heard] == [0, 1, 2, 3] and {p.total for p in heard} == {3}


def test_what_is_finished_is_not_done_again_unless_its_file_changed(files, tmp_path):
    folder, start = tmp_path / "fits", me.Material.analytic("ggx")
    before = [Path(f.output).stat().st_mtime_ns for f in fit_files(start, files[:2], folder, **HOW)]
    os.utime(files[1], (time.time() + 5,) * 2)
    fits = fit_files(start, files, folder, **HOW)
    after = [Path(f.output).stat().st_mtime_ns for f in fits]
    assert after[0] == before[0] and after[1] > before[1] and len(after) == 3
    with pytest.raises(ValueError, match=r'm0.json" is of a run with other settings \(seed\)'):
        fit_files(start, files, folder, n_samples=200, seed=4)


def test_a_material_of_other_settings_or_of_no_fit_is_not_taken_for_a_result(files, tmp_path):
    folder, start = tmp_path / "fits", me.Material.analytic("ggx")
    fit_files(start, files[:1], folder, n_samples=200, seed=0)
    fit_files(start, files[1:2], folder, n_samples=200, seed=7)
    with pytest.raises(ValueError, match=r"other settings \(seed\)"):
        fit_files(start, files, folder, n_samples=200, seed=7)
    (folder / "m2.bsdf").write_bytes((folder / "m1.bsdf").read_bytes())
    with pytest.raises(ValueError, match=r'm2.bsdf" is there already, and is no fit of this command'):
        fit_files(start, files[1:], folder, n_samples=200, seed=7)


def test_a_damaged_file_loses_nothing_else(files, tmp_path):
    files[1].write_bytes(b"PK damaged")
    fits = fit_files(me.Material.analytic("ggx"), files, tmp_path / "fits", **HOW)
    assert [bool(f.error) for f in fits] == [False, True, False] and "m1.npz" in fits[1].error
    assert not Path(fits[1].output).exists()


def test_two_files_of_one_name_are_refused(files, tmp_path):
    (tmp_path / "other").mkdir()
    twin = shutil.copy(files[0], tmp_path / "other")
    with pytest.raises(ValueError, match=r'would both be "m0.bsdf". Rename one.'):
        fit_files(me.Material.analytic("ggx"), [files[0], twin], tmp_path / "fits")


def test_run_all_is_told_of_every_item_by_an_executor_too():
    from concurrent.futures import ThreadPoolExecutor

    told = []
    with ThreadPoolExecutor(2) as pool:
        assert run_all(abs, [-1, -2, -3], pool, lambda done: told.append(len(done))) == {-1: 1, -2: 2, -3: 3}
    assert told[0] == 0 and told[-1] == 3 and told == sorted(told)


def command(files, tmp_path, *more: str) -> list[str]:
    names = [str(tmp_path / "m*.npz")] if files else []
    return ["fit", *names, "-m", "ggx_retro", "-o", str(tmp_path / "fits"), "--samples", "200", *more]


def test_command_takes_a_pattern_and_a_folder(files, tmp_path, capsys):
    assert main(command(files, tmp_path, "--json")) == 0
    result = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert result["ok"] and [Path(f["output"]).name for f in result["fits"]] == ["m0.bsdf", "m1.bsdf", "m2.bsdf"]
    files[2].write_text("nothing\n")
    os.utime(files[2], (time.time() + 5,) * 2)
    assert main(command(files, tmp_path)) == 1
    out, err = capsys.readouterr()
    assert "2 of 3 files" in out and 'mi-enhance: fit: "' in err and err.count("has no material") == 1


@pytest.mark.parametrize(
    "arguments, message",
    [
        (["a", "b", "-o", "c.bsdf"], '-o: "c.bsdf" is one file, and 2 materials are to be written. Name a folder.'),
        (["a", "-o", "c.bsdf", "--workers", "2"], "--workers and --scheduler share out files. Give several"),
        (["a", "b", "-o", "c", "--workers", "2", "--scheduler", "x"], "--workers and --scheduler exclude each other"),
        (["no*.csv", "-o", "c"], 'fit: no file matches "no*.csv". Check the pattern.'),
    ],
)
def test_what_does_not_go_together_is_refused(llvm, capsys, arguments, message):
    assert main(["fit", *arguments]) == 2
    assert message in capsys.readouterr().err


def test_without_dask_the_error_names_the_extra(files, tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert main(command(files, tmp_path, "--scheduler", "tcp://localhost:1")) == 2
    assert '--scheduler needs Dask. Install it: pip install "mi-enhance[cluster]"' in capsys.readouterr().err


@pytest.mark.slow
def test_a_killed_dask_worker_loses_nothing(files, tmp_path):
    distributed = pytest.importorskip("distributed")
    start, here = me.Material.analytic("ggx"), fit_files(me.Material.analytic("ggx"), files, tmp_path / "one", **HOW)
    with (
        distributed.LocalCluster(2, threads_per_worker=1, processes=True, dashboard_address=None) as cluster,
        distributed.Client(cluster) as client,
    ):
        pids = list(client.run(os.getpid).values())

        def kill(progress):
            if progress.step == 0 and pids:  # all are under way, none is finished; heard again while that is so
                time.sleep(3)
                os.kill(pids.pop(), signal.SIGKILL)

        fits = fit_files(start, files, tmp_path / "two", **HOW, executor=client.get_executor(pure=False), progress=kill)
    assert not any(f.error for f in fits)
    np.testing.assert_array_equal(numbers(fits), numbers(here))
