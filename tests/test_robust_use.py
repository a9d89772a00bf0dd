"""Use that is not a straight line: two networks side by side, threads, modules loaded again, copies, pickles."""

from __future__ import annotations

import copy
import gc
import importlib
import pickle
import threading

import mitsuba as mi
import numpy as np
import pytest
from plugin_scenes import SUMMATION, analytic, ball, material

from mi_enhance import bsdfs
from mi_enhance.material.material import Material


def image(scene):
    return np.array(mi.render(scene, spp=16, seed=1))


def test_scenes_of_different_networks_do_not_disturb_each_other(llvm):
    """Rendered in turn, and again after the other one is gone."""
    makes = {
        "paper": lambda: material(),
        "ggx": lambda: Material.pretrained("ggx").edit(rho_d=0.3),
        "none": lambda: analytic(rho_d=0.2),
    }
    alone = {name: image(ball(make().to_dict())) for name, make in makes.items()}
    scenes = {name: ball(make().to_dict()) for name, make in makes.items()}
    for name in (*makes, *makes):
        np.testing.assert_allclose(image(scenes[name]), alone[name], rtol=SUMMATION, atol=1e-6)
    del scenes["ggx"]
    gc.collect()
    for name in scenes:
        np.testing.assert_allclose(image(scenes[name]), alone[name], rtol=SUMMATION, atol=1e-6)


def test_threads_of_one_process_render(llvm):
    """Each with a material of its own, taking turns: at once, Dr.Jit ends the process with Mitsuba's own BSDFs, too."""
    wanted = [image(ball(analytic(rho_d=v).to_dict())) for v in (0.1, 0.4, 0.8)]
    got, problems, turn = [None] * len(wanted), [], threading.Lock()

    def work(k, value):
        try:
            for _ in range(3):
                with turn:
                    got[k] = image(ball(analytic(rho_d=value).to_dict()))
        except Exception as error:  # would be lost with the thread
            problems.append(error)

    threads = [threading.Thread(target=work, args=(k, v)) for k, v in enumerate((0.1, 0.4, 0.8))]
    for t in threads:
        t.start()
    for t in threads:
        t.join()
    assert not problems
    for a, b in zip(got, wanted, strict=True):
        np.testing.assert_allclose(a, b, rtol=SUMMATION, atol=1e-6)


def test_plugin_module_may_be_loaded_again(llvm):
    """As an editor or a notebook does; the new class takes the place of the old one, old scenes go on."""
    old = ball(analytic(rho_d=0.3).to_dict())
    before = image(old)
    importlib.reload(importlib.import_module("mi_enhance.bsdfs.enhanced"))
    importlib.reload(bsdfs)
    np.testing.assert_allclose(image(ball(analytic(rho_d=0.3).to_dict())), before, rtol=SUMMATION, atol=1e-6)
    np.testing.assert_allclose(image(old), before, rtol=SUMMATION, atol=1e-6)


def test_a_material_is_copied_and_not_pickled(llvm):
    m = analytic(rho_d=0.3)
    for other in (copy.copy(m), copy.deepcopy(m)):
        assert other is not m and (other.as_vector() == m.as_vector()).all()
    with pytest.raises(
        TypeError, match=r"not to be pickled.*material\.save\(path\) here, Material\.load\(path\) there"
    ):
        pickle.dumps(m)
