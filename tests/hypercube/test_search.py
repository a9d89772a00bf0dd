"""The search: candidates inherit and are judged fairly, the best wins, and a killed search ends the same."""

from __future__ import annotations

import json
import multiprocessing
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from types import SimpleNamespace

import numpy as np
import pytest
from planted import first_change

import mi_enhance  # noqa: F401  (before mitsuba)

import mitsuba as mi  # isort: skip
from mi_enhance import data, models, search
from mi_enhance.data.random_terms import assorted
from mi_enhance.hypercube import candidate, inheritance, states
from mi_enhance.hypercube.settings import SearchSettings
from mi_enhance.hypercube.setup import Setup, candidate_folder
from mi_enhance.hypercube.stages import candidates_of
from mi_enhance.material.material import Material
from mi_enhance.neural import mlp
from mi_enhance.system.progress import Progress

# Networks that train in a moment; the code is the same. Two slots are free: four candidates in two stages.
SMALL = {
    "modules": [[4, 4]], "n_latent": 2, "n_samples": 128, "n_aside": 64, "batch": 32, "epochs": 8, "lr": 2e-2,
    "imitation_steps": 30, "tolerance": 0.001,
    "fixed": {slot: "analytic" for slot in models.get("ggx").graph.slots if slot not in ("F", "G")},
}  # fmt: skip


def materials(n=3, samples=192):
    return [assorted(k, samples) for k in range(n)]


def run(folder, **settings):
    executor = settings.pop("executor", None)
    return search("ggx", materials(), folder, executor=executor, **{**SMALL, **settings})


def weights(folder):
    return mlp.flatten(Material.load(folder / "network.bsdf").brdf.modules)


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A search from beginning to end, where it lies, and what it found."""
    mi.set_variant("llvm_ad_rgb")
    folder = tmp_path_factory.mktemp("search") / "run"
    return folder, run(folder)


# --- what it does -----------------------------------------------------------------------------------------------------


def test_stages_end_when_the_current_state_wins(finished):
    folder, found = finished
    assert len(found.stages) > 1
    assert found.stages[-1]["best"] == found.stages[-1]["current"] and found.stages[-1]["change"] == "unchanged"
    assert all(s["best"] != s["current"] for s in found.stages[:-1])
    for before, after in zip(found.stages, found.stages[1:], strict=False):
        assert before["best"] == after["current"]
    for s in found.stages:
        losses = {tuple(row["digits"]): row["loss"] for row in s["candidates"]}
        unchanged = losses[tuple(s["current"])]
        assert s["unchanged"] == unchanged and s["loss"] == losses[tuple(s["best"])]
        better = [loss for loss in losses.values() if loss < 0.999 * unchanged]  # the tolerance
        assert s["loss"] == (min(losses.values()) if better else unchanged)
    assert (folder / "search.png").stat().st_size > 10_000


def test_the_network_is_the_last_state_and_carries_the_log(finished):
    folder, found = finished
    network = Material.load(folder / "network.bsdf")
    assert str(network.brdf) == str(found.material.brdf) == found.stages[-1]["equation"]
    assert len(network.library) == 3 and network.report["library"] == [m.name for m in materials()]
    assert [s["change"] for s in network.report["stages"]] == [s["change"] for s in found.stages]
    np.testing.assert_array_equal(weights(folder), mlp.flatten(found.material.brdf.modules))


def test_candidates_start_where_their_parent_is(finished):
    """Weights and parameters by name; what is new imitates, so no material is far from where it was."""
    folder, found = finished
    setup = Setup(folder)
    start = tuple(found.stages[0]["current"])
    before, old = inheritance.restore(
        states.brdf_of(setup.model, start, setup.choices, **setup.build),
        candidate_folder(folder, 0, start) / "checkpoint.npz",
    )
    for digits in states.neighbours(start, setup.choices):
        brdf, values = inheritance.inherit(setup, folder, 1, digits, start)
        names = [p.name for p in brdf.parameters]
        assert set(names) - {p.name for p in before.parameters} <= {"asymmetry", "latent", "norm_F", "norm_G"}
        np.testing.assert_allclose(values[:, : old.shape[1]], old, rtol=1e-6)


def test_the_samples_kept_aside_are_not_trained_on(finished):
    samples, aside = Setup(finished[0]).samples
    assert (samples.n_samples, aside.n_samples) == (128, 64)
    seen = {tuple(row) for row in samples.samples.T}
    assert not seen & {tuple(row) for row in aside.samples.T}


def test_all_candidates_have_the_same_budget(finished):
    for result in finished[0].glob("stage-0[1-9]/*/progress.json"):
        assert json.loads(result.read_text())["step"] == 8 * 128 // 32


def test_the_pareto_front_falls(finished):
    front = finished[1].pareto
    cost, loss = ([row[k] for row in front] for k in ("cost", "loss"))
    assert cost == sorted(cost) and loss == sorted(loss, reverse=True) and cost[0] == 0
    assert loss[-1] == min(row["loss"] for s in finished[1].stages for row in s["candidates"])


def test_a_price_on_run_time_keeps_the_model_cheap(llvm, tmp_path):
    dear = run(tmp_path / "dear", price=100.0)
    assert not dear.material.brdf.modules and len(dear.stages) == 1


def test_measured_cost_is_a_time(llvm, tmp_path):
    found = run(tmp_path / "timed", cost="measured", epochs=0.25)
    assert all(0 < row["cost"] < 1e6 for row in found.stages[0]["candidates"])


@pytest.mark.slow
def test_other_terms_are_tried(llvm, tmp_path):
    """Terms of other models compete with modules."""
    settings = {**SMALL, "fixed": {**SMALL["fixed"], "D": "analytic", "F": "analytic"}}
    found = run(tmp_path / "r", **{**settings, "alternatives": {"D": ["D_abc_normalised"], "F": ["F_dielectric"]}})
    changes = {row["change"] for row in found.stages[0]["candidates"]}
    assert changes == {"unchanged", "D_abc_normalised", "F_dielectric", "[G]"}
    assert all(np.isfinite(row["loss"]) for s in found.stages for row in s["candidates"])


def test_a_change_may_be_reverted_but_no_lost_state_comes_back():
    choices = states.choices(models.get("ward"))
    setup = SimpleNamespace(choices=choices, settings=SearchSettings())
    start, first, second = (0,) * 7, (0, 0, 0, 0, 1, 0, 0), (0, 0, 0, 0, 1, 0, 1)
    stages = [{"current": start, "best": first}, {"current": first, "best": second}]
    around = candidates_of(setup, stages)
    words = [states.describe_change(second, digits, choices) for digits in around]
    assert words[0] == "unchanged" and "D reverted" in words and not {start, first} & set(around)


@pytest.mark.slow
@pytest.mark.parametrize("slot", ["F", "F*G"])
def test_a_planted_weakness_is_replaced_first(llvm, tmp_path, slot):
    """Materials of a GGX whose F, or whose operator F*G, is another function: of what may change here, that one."""
    few = {name: "analytic" for name in ("M", "M+S", "S", "S*D", "D", "D*F")}
    row = first_change(slot, tmp_path / "p", count=8, seed=0, epochs=150, fixed=few)
    assert row["first"] == f"[{slot}]" and row["loss"] < 0.1 * row["unchanged"]


# --- it can be stopped ------------------------------------------------------------------------------------------------


class StopError(Exception):
    pass


@pytest.mark.parametrize("after", [40, *(pytest.param(k, marks=pytest.mark.slow) for k in (1, 70, 120))])
def test_an_interrupted_search_ends_the_same(llvm, finished, tmp_path, monkeypatch, after):
    """Stopped in the middle of a candidate, after some training step; then once more."""
    folder = tmp_path / "run"
    advance, count = candidate.Trainer.advance, [0]

    def counted(self):
        count[0] += 1
        if count[0] in (after, after + 3):
            raise StopError
        return advance(self)

    monkeypatch.setattr(candidate.Trainer, "advance", counted)
    for _ in range(2):
        with pytest.raises(StopError):
            run(folder)
    same(run(folder), folder, finished)


def same(found, folder, finished):
    strip = lambda stages: [{k: v for k, v in s.items() if k not in ("seconds", "candidates")} for s in stages]  # noqa: E731
    assert strip(found.stages) == strip(finished[1].stages)
    np.testing.assert_array_equal(weights(folder), weights(finished[0]))


@pytest.mark.slow
def test_processes_find_the_same(finished, tmp_path):
    pool = ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("spawn"))
    with pool:
        same(run(tmp_path / "run", executor=pool), tmp_path / "run", finished)


@pytest.mark.slow
def test_a_killed_dask_worker_costs_only_its_candidate(finished, tmp_path):
    distributed = pytest.importorskip("distributed")
    folder = tmp_path / "run"
    with (
        distributed.LocalCluster(2, threads_per_worker=1, processes=True, dashboard_address=None) as cluster,
        distributed.Client(cluster) as client,
    ):
        pids = client.run(os.getpid)
        killed = []

        def kill(progress):
            if not killed and progress.stage == "stage 1" and progress.values:  # the stage is over
                killed.append(next(iter(pids.values())))
                os.kill(killed[0], signal.SIGKILL)

        found = search("ggx", materials(), folder, executor=client.get_executor(pure=False), progress=kill, **SMALL)
        assert killed
        same(found, folder, finished)


@pytest.mark.slow
def test_a_killed_process_loses_nothing(llvm, tmp_path):
    """kill -9 at random moments of the command, until it ends; the outcome is that of an undisturbed one."""
    data.save_table(materials(1)[0], tmp_path / "a.npz")
    data.save_table(materials(2)[1], tmp_path / "b.npz")
    defines = [f"-D{key}={json.dumps(value)}" for key, value in {**SMALL, "epochs": 150}.items()]

    def command(name):
        out = tmp_path / name / "net.bsdf"
        return [sys.executable, "-m", "mi_enhance", "search", "ggx", "--data", str(tmp_path / "*.npz"), "-o", str(out),
                "--variant", "llvm_ad_rgb", "--json", *defines]  # fmt: skip

    begun = time.perf_counter()
    subprocess.run(command("whole"), check=True, capture_output=True)
    whole = time.perf_counter() - begun  # of which the start of the process is the most: kills come around its middle
    rng, kills = np.random.default_rng(0), 0
    while True:
        process = subprocess.Popen(command("killed"), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
        try:
            assert process.wait(timeout=whole * (rng.uniform(0.4, 0.8) + kills / 10)) == 0, process.stderr.read()
            break
        except subprocess.TimeoutExpired:
            os.kill(process.pid, signal.SIGKILL)
            process.wait()
            kills += 1
        finally:
            process.stderr.close()
    assert kills
    a, b = (mlp.flatten(Material.load(tmp_path / n / "net.bsdf").brdf.modules) for n in ("whole", "killed"))
    np.testing.assert_array_equal(a, b)


# --- wrong input ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "wrong, message",
    [
        ({"epoch": 3}, 'unknown setting "epoch". Choose from: model, modules, .* Did you mean "epochs"'),
        ({"distance": 3}, "distance is 3; it must be 1 or 2"),
        ({"cost": "time"}, 'cost is \'time\'; it must be "multiply-adds" or "measured"'),
        ({"inputs": "angles"}, "inputs is 'angles'; it must be"),
        ({"n_samples": 0.5}, "n_samples is 0.5; it must be a whole number of at least 1"),
        ({"max_modules": -1}, "max_modules is -1; it must be null, or a whole number of at least 0"),
        ({"modules": 3}, "modules is 3; it must be a list"),
        ({"modules": [16, 32]}, "modules: hidden layers 16 are out of range: 1 to 8 layers"),
        ({"nodes_only": 1}, "nodes_only is 1; it must be true or false"),
        ({"epochs": 0}, "epochs is 0; it must be a number of at least 1e-06"),
        ({"epochs": "many"}, "epochs is 'many'"),
        ({"price": -1}, "price is -1; it must be a number of at least 0"),
        ({"batch": float("nan")}, "batch is nan"),
        ({"fixed": {"X": "neural"}}, '"X" is not a slot'),
    ],
)
def test_wrong_settings_are_refused(llvm, tmp_path, wrong, message):
    with pytest.raises((ValueError, KeyError), match=message):
        run(tmp_path / "run", **wrong)
    assert not list(tmp_path.rglob("*.npz"))


def test_other_wrong_input_is_refused(llvm, finished, tmp_path):
    with pytest.raises(ValueError, match="no materials to train on"):
        search("ggx", [], tmp_path / "a", **SMALL)
    with pytest.raises(ValueError, match="must all be Measurements, or all be sources"):
        search("ggx", [materials(1)[0], {"kind": "nps"}], tmp_path / "b", **SMALL)
    with pytest.raises(KeyError, match='unknown model "gxx"'):
        search("gxx", materials(), tmp_path / "c", **SMALL)
    for wrong in ({"seed": 1}, {"validation": materials(1)}):
        with pytest.raises(
            ValueError, match="is of a run with other settings .*(seed|materials).*. Choose another folder"
        ):
            run(finished[0], **wrong)


def test_a_stage_of_diverged_candidates_is_an_error(llvm, tmp_path, monkeypatch):
    monkeypatch.setattr(candidate, "judge", lambda *_: float("inf"))
    with pytest.raises(RuntimeError, match="all candidates of stage 1 diverged. Lower lr or lr_parameters"):
        run(tmp_path / "run")


def test_the_command_line_reads_patterns_and_lists(llvm, tmp_path, capsys):
    from mi_enhance.cli.main import main

    for k, m in enumerate(materials(2)):
        data.save_table(m, tmp_path / f"{k}.npz")
    (tmp_path / "unseen.json").write_text(json.dumps([{"kind": "synthetic", "count": 2}]))
    out = tmp_path / "net.bsdf"
    defines = [f"-D{key}={json.dumps(value)}" for key, value in SMALL.items()]
    arguments = ["search", "ggx", "--data", str(tmp_path / "*.npz"), "--validation", str(tmp_path / "unseen.json")]
    assert main([*arguments, "-o", str(out), "--variant", "llvm_ad_rgb", "--json", *defines]) == 0
    result = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert result["model"] == str(Material.load(out).brdf) and result["stages"][-1]["validation"] > 0
    assert (tmp_path / "net.search" / "search.png").exists()
    assert main(["search", "ggx", "--data", str(tmp_path / "*.xyz"), "-o", str(out)]) == 2
    assert "no file matches" in capsys.readouterr().err


def test_the_live_table_shows_states(finished, monkeypatch):
    """What a user sees while a stage runs, and the line after it."""
    from rich.console import Console

    from mi_enhance.cli.live_table import LiveTable

    folder, found = finished
    view = LiveTable(folder)
    view._console = Console(record=True, width=160)
    view._console.print(view.table([]))
    view(Progress("stage 1", 3, 3))
    text = view._console.export_text()
    for word in ("stage 1: 3 of 3 candidates", "[G]", "32/32", *(s["equation"] for s in found.stages)):
        assert word in text
