"""What a program may do with materials and scenes besides rendering one: several at once, again, elsewhere."""

from __future__ import annotations

import copy
import gc
import json
import pickle
from concurrent.futures import ThreadPoolExecutor

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from plugin_scenes import SUMMATION, analytic, ball, directions, evaluate, material, scene

import mi_enhance
from mi_enhance.data import tensor_file
from mi_enhance.enhance import enhance
from mi_enhance.material import FORMAT, Material


def other():
    """Of another model, with other networks and inputs than `material`."""
    return Material(enhance("ggx2", ("B", "G"), inputs="shape", n_latent=4, hidden=(8, 8), seed=3), {})


def picture(s, **settings):
    return np.array(mi.render(s, **{"seed": 0, "spp": 16, **settings}))


def same(a, b):
    np.testing.assert_allclose(a, b, rtol=SUMMATION, atol=1e-6)


def test_scenes_of_different_networks_do_not_disturb_each_other(llvm):
    alone = []
    for make in (material, other):
        alone.append(picture(ball(make().to_dict())))
        gc.collect()
    assert np.abs(alone[0] - alone[1]).max() > 0.01
    scenes = [ball(make().to_dict()) for make in (material, other)]
    for _ in range(3):
        for s, expected in zip(scenes, alone, strict=True):
            same(picture(s), expected)
    del scenes[0]  # one goes, the other stays
    gc.collect()
    same(picture(scenes[0]), alone[1])


def test_both_networks_in_one_scene_are_what_they_are_alone(llvm):
    wi, wo = directions(200), directions(200, seed=1)
    expected = [m.evaluate(wi, wo) * wo[:, 2:] for m in (material(), other())]
    shapes = {f"s{k}": {"type": "sphere", "bsdf": m.to_dict()} for k, m in enumerate((material(), other()))}
    s = scene(shapes)
    for shape, f in zip(sorted(s.shapes(), key=lambda v: v.id()), expected, strict=True):
        np.testing.assert_allclose(evaluate(shape.bsdf(), wi, wo), f, rtol=1e-4, atol=1e-5)


def test_variants_switched_under_living_scenes(llvm):
    """A scene of one variant still renders after others were used, and so does what was loaded in between."""
    first = ball(material().to_dict())
    expected = picture(first)
    for _ in range(2):
        mi.set_variant("llvm_ad_mono")
        grey = picture(ball(material().to_dict()))
        assert grey.shape[2] == 1 and np.isfinite(grey).all()
        mi.set_variant("scalar_rgb")
        with pytest.raises(RuntimeError, match="cannot run the networks"):
            mi.load_dict({"type": "enhanced", "description": "{}"})
        mi.set_variant("llvm_ad_rgb")
        same(picture(first), expected)
        same(picture(ball(material().to_dict())), expected)


def test_threads_of_a_program_may_evaluate_and_load(llvm, tmp_path):
    m = material()
    m.save(tmp_path / "m.bsdf")
    wi, wo = directions(500), directions(500, seed=1)
    expected = m.evaluate(wi, wo)

    def work(k):
        mi.set_variant("llvm_ad_rgb")  # the variant belongs to the thread
        loaded = Material.load(tmp_path / "m.bsdf")
        return evaluate(loaded.bsdf(), wi, wo) / wo[:, 2:]

    with ThreadPoolExecutor(4) as pool:
        for f in pool.map(work, range(12)):
            np.testing.assert_allclose(f, expected, rtol=1e-4, atol=1e-5)


MODES = {
    "wavefront": {dr.JitFlag.SymbolicLoops: False, dr.JitFlag.SymbolicCalls: False},
    "wavefront, unoptimised": {
        dr.JitFlag.SymbolicLoops: False,
        dr.JitFlag.SymbolicCalls: False,
        dr.JitFlag.OptimizeCalls: False,
        dr.JitFlag.OptimizeLoops: False,
    },
    "symbolic, not merged": {dr.JitFlag.MergeFunctions: False, dr.JitFlag.OptimizeCalls: False},
    "literals": {dr.JitFlag.ConstantPropagation: False},
    "debug": {dr.JitFlag.Debug: True},
}


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("make", [other, analytic], ids=["networks", "analytic"])
def test_modes_of_drjit_give_the_same_picture_and_gradient(llvm, mode, make):
    s = ball(make().to_dict(), integrator={"type": "prb", "max_depth": 3})
    p = mi.traverse(s)
    key = "ball.bsdf.rho_d"

    def both():
        dr.enable_grad(p[key])
        p.update()
        image = mi.render(s, p, spp=16, seed=0, seed_grad=1)
        dr.backward(dr.mean(image, axis=None))
        gradient = np.array(dr.grad(p[key])).ravel()
        p[key] = dr.detach(p[key])
        return np.array(dr.detach(image)), gradient

    expected = both()
    old = {flag: dr.flag(flag) for flag in MODES[mode]}
    try:
        for flag, value in MODES[mode].items():
            dr.set_flag(flag, value)
        got = both()
    finally:
        for flag, value in old.items():
            dr.set_flag(flag, value)
    np.testing.assert_allclose(got[0], expected[0], rtol=1e-3, atol=1e-4)  # a path may take another turn
    np.testing.assert_allclose(got[1], expected[1], rtol=1e-3)
    assert (got[1] > 0).all()


def test_frozen_render_of_one_scene_does_not_hold_for_another_network(llvm):
    frozen = dr.freeze(lambda s: mi.render(s, spp=16, seed=0))
    scenes = [ball(m.to_dict()) for m in (material(), other())]
    expected = [picture(s) for s in scenes]
    for _ in range(2):
        for s, image in zip(scenes, expected, strict=True):
            same(np.array(frozen(s)), image)


def test_a_file_that_changed_is_read_again(llvm, tmp_path):
    path = tmp_path / "m.bsdf"
    for rho_d in (0.1, 0.8, 0.1):
        material(rho_d=rho_d).save(path)
        image = picture(ball({"type": "enhanced", "filename": str(path)}))
        same(image, picture(ball(material(rho_d=rho_d).to_dict())))


def test_a_thousand_reloads_do_not_pile_up(llvm):
    """Instances that are gone are gone for Dr.Jit, too: else each would be compiled into every later kernel."""
    wi, wo = directions(50), directions(50, seed=1)
    expected = evaluate(material().bsdf(), wi, wo)
    m = analytic()
    for _ in range(1000):
        m.bsdf()
    gc.collect()
    assert dr.detail.registry_bound if hasattr(dr.detail, "registry_bound") else True
    same(evaluate(material().bsdf(), wi, wo), expected)


# --- other processes --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("make", [material, other, analytic])
def test_pickling_a_material_is_refused_with_what_to_do(make):
    with pytest.raises(TypeError, match=r"Material: not to be pickled.*material.save\(path\) here, Material.load"):
        pickle.dumps(make())


def test_pickling_a_plugin_is_refused(llvm):
    with pytest.raises((TypeError, RuntimeError), match="Enhanced"):
        pickle.dumps(other().bsdf())


def test_copies_are_materials_of_their_own():
    m = other()
    for duplicate in (copy.copy(m), copy.deepcopy(m), copy.deepcopy([m])[0]):
        duplicate.params["rho_d"][:] = 0.9
        assert m.params["rho_d"][0] == 0.5 and str(duplicate.brdf) == str(m.brdf)


def test_spawned_workers_load_fit_and_evaluate(run_child, tmp_path):
    other().save(tmp_path / "m.bsdf")
    code = f"""
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
import sys; sys.path.insert(0, {str(tmp_path)!r})
from work import work
if __name__ == "__main__":
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        print(*pool.map(work, [0.1, 0.9]))
"""
    (tmp_path / "work.py").write_text(f"""
import mi_enhance, mitsuba as mi
def work(rho_d):
    mi.set_variant("llvm_ad_rgb")
    m = mi_enhance.Material.load({str(tmp_path / "m.bsdf")!r}).edit(rho_d=rho_d)
    return m.evaluate([[0, 0, 1]], [[0, 0.6, 0.8]]).mean()
""")
    child = run_child(code, DRJIT_LIBLLVM_PATH=mi_enhance._llvm.found.path)
    dark, bright = map(float, child.stdout.split())
    assert 0 < dark < bright, child.stderr


# --- newer files ------------------------------------------------------------------------------------------------------


def test_material_of_a_newer_format_is_refused_with_a_sentence(llvm, tmp_path):
    m, path = other(), tmp_path / "new.bsdf"
    m.save(path)
    tensors = {k: tensor_file.values(path, f) for k, f in tensor_file.fields(path, "test").items()}
    description = json.loads(tensors.pop("description").tobytes()) | {"format": FORMAT + 1}
    tensor_file.write(path, {"description": json.dumps(description), **tensors})
    message = f"file format {FORMAT + 1} is newer than this package reads \\({FORMAT}\\). Upgrade mi_enhance"
    with pytest.raises(ValueError, match=message):
        Material.load(path)
    with pytest.raises(RuntimeError, match=message):
        mi.load_dict({"type": "enhanced", "filename": str(path)})
