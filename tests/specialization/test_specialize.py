"""Specialized materials: the error they state, what stays editable, files, and going back."""

from __future__ import annotations

import dataclasses
import functools
import json

import mitsuba as mi
import numpy as np
import pytest
from plugin_scenes import close, directions, evaluate

from mi_enhance import data
from mi_enhance.cli.main import main
from mi_enhance.data import synthetic
from mi_enhance.data.directions import sample_pairs
from mi_enhance.fitting.fit import fit
from mi_enhance.fitting.losses import log_l1
from mi_enhance.material.material import Material
from mi_enhance.neural import distilled_network
from mi_enhance.neural.enhance import enhance
from mi_enhance.specialization import distillation, pruning
from mi_enhance.specialization.specialize import specialize

N = 4000


@functools.lru_cache
def exact() -> Material:
    """The shipped network, satin, with all three terms."""
    mi.set_variant("llvm_ad_rgb")
    values = {"rho_d": (0.3, 0.2, 0.1), "rho_s": 0.3, "rho_s2": 0.1, "F0": 0.3, "alpha_x2": 0.3, "alpha_y2": 0.3}
    return Material.pretrained("ggx2").edit(**values)


@functools.lru_cache
def fast() -> Material:
    return specialize(exact(), max_error=3e-3)


def pairs(seed=7):
    return sample_pairs(N, seed=seed)


def difference(a: Material, b: Material) -> float:
    wi, wo = pairs()
    return log_l1(rendered(a, wi, wo), rendered(b, wi, wo), wo[:, 2])


def rendered(m: Material, wi, wo):
    """f_r by the plugin, which compiles baked weights in a second."""
    return evaluate(m.bsdf(), wi, wo) / wo[:, 2:]


def test_error_is_the_one_it_states_and_below_the_one_asked_for(llvm):
    report = fast().report
    assert report["specialize_error"] <= report["specialize_max_error"] == 3e-3
    # other pairs of directions: a mean over 4,000 of them
    np.testing.assert_allclose(difference(fast(), exact()), report["specialize_error"], rtol=0.1)


def test_a_tenth_of_the_work(llvm):
    report = fast().report
    assert report["specialize_multiply_adds"] == fast().brdf.multiply_adds <= 500
    assert report["specialize_multiply_adds_exact"] == exact().brdf.multiply_adds == 4320
    assert report["specialize_seconds"] < 120  # a busy machine; 10 s are meant on a quiet one


@pytest.mark.slow
def test_a_smaller_error_takes_a_larger_network_in_the_end_the_exact_one(llvm):
    pruned = specialize(exact(), max_error=1e-9)
    assert pruned.report["specialize_network"] == "exact, without linear units"
    assert fast().brdf.multiply_adds < pruned.brdf.multiply_adds < exact().brdf.multiply_adds
    assert pruned.report["specialize_error"] < 1e-6 and difference(pruned, exact()) < 1e-6


def test_colours_keep_their_meaning(llvm):
    """f is linear in every colour, and a specialized one with other colours is the exact one with other colours."""
    edits = {"rho_d": (0.1, 0.5, 0.9), "rho_s": 0.1, "rho_s2": 0.3}
    assert difference(fast().edit(**edits), exact().edit(**edits)) < 3 * 3e-3
    wi, wo = pairs()
    one, two = (rendered(fast().edit(rho_s=0, rho_s2=0, rho_d=v), wi, wo) for v in (0.25, 0.5))
    close(2 * one, two)


@pytest.mark.slow
def test_symmetric_where_asymmetry_is_0(llvm):
    m = specialize(exact().edit(asymmetry=0.5), max_error=1e-2)
    assert "difference" in m.brdf.distilled[0].inputs
    wi, wo = pairs()
    m = m.edit(asymmetry=0)
    close(rendered(m, wi, wo), rendered(m, wo, wi), rel=1e-4)


def test_file_keeps_the_exact_material(llvm, tmp_path):
    fast().save(tmp_path / "fast.bsdf")
    again = Material.load(tmp_path / "fast.bsdf")
    wi, wo = pairs()
    np.testing.assert_array_equal(rendered(again, wi, wo), rendered(fast(), wi, wo))
    back = again.unspecialized
    assert not back.brdf.distilled and not [key for key in back.report if key.startswith("specialize")]
    close(rendered(back, wi, wo), rendered(exact(), wi, wo))
    assert exact().unspecialized.brdf == exact().brdf
    by_name = mi.load_dict({"type": "enhanced", "filename": str(tmp_path / "fast.bsdf")})
    np.testing.assert_array_equal(evaluate(by_name, wi, wo), evaluate(fast().bsdf(), wi, wo))


def test_plugin_exposes_what_still_does_something(llvm):
    keys = set(mi.traverse(fast().bsdf()).keys())
    assert {"rho_d", "rho_s", "alpha_x", "F0", "n_x", "asymmetry"} <= keys
    assert not {"latent", "norm_B"} & keys


def test_plugin_and_material_evaluate_the_same(llvm):
    wi, wo = directions(N), directions(N, seed=1)
    close(evaluate(fast().bsdf(), wi, wo), fast().evaluate(wi, wo) * wo[:, 2:])


def test_lobe_without_colour_is_left_out_of_the_small_network(llvm):
    wi, wo = directions(N), directions(N, seed=1)
    m = fast().edit(rho_s2=0, asymmetry=0)
    close(evaluate(m.bsdf(), wi, wo), m.evaluate(wi, wo) * wo[:, 2:])


@pytest.mark.slow
def test_measurements_are_followed(llvm):
    """What the networks got wrong everywhere, here by a factor, the small one can learn."""
    wi, wo = sample_pairs(20_000, seed=3)
    f = rendered(exact(), wi, wo) * 1.2
    truth = data.Measurements(wi, wo, f.astype(np.float32), "brighter", "test")
    report = specialize(exact(), truth, max_error=3e-3).report
    assert report["specialize_log_l1"] < 0.3 * report["specialize_log_l1_exact"]


@pytest.mark.slow
def test_small_shared_network_for_textured_materials(llvm):
    """Close to the exact material for a fifth of the multiply-adds, and everything can still vary over a surface."""
    m = specialize(exact(), textured=True)
    assert not m.brdf.distilled and "latent" in m.params
    assert m.brdf.multiply_adds == m.report["specialize_multiply_adds"] < 0.25 * exact().brdf.multiply_adds
    analytic = fit(Material.analytic("ggx"), own_samples(exact())).report["log_l1"]
    assert m.report["specialize_error"] < 0.25 * analytic
    np.testing.assert_allclose(difference(m, exact()), m.report["specialize_error"], rtol=0.1)


def own_samples(m: Material) -> data.Measurements:
    wi, wo = pairs(seed=11)
    return data.Measurements(wi, wo, rendered(m, wi, wo).astype(np.float32), "itself", "test")


@pytest.mark.slow
def test_fit_goes_on_from_the_exact_material(llvm):
    m, _ = synthetic.ggx_anisotropic(3, n_samples=300, noise=0)
    small = enhance("ggx2", ("B", "G", "G2"), inputs="shape", modulated=True, n_latent=4, hidden=(8, 8), seed=1)
    start = specialize(Material(small, {}), max_error=0.1)
    assert start.brdf.distilled and not fit(start, m).brdf.distilled


@pytest.mark.parametrize(
    "make, message",
    [
        (
            lambda: (Material.analytic("ggx"), 1e-3),
            r"M \+ S \* D \* F .* has no network of the directions",
        ),
        (lambda: (exact(), 0.0), "max_error must be above 0; got 0.0"),
        (lambda: (Material(enhance("ggx", ("S*D",)), {}), 1e-3), r"sees colours \(S\*D\)"),
    ],
)
def test_what_it_refuses(llvm, make, message):
    m, error = make()
    with pytest.raises(ValueError, match=message):
        specialize(m, max_error=error)


@pytest.mark.slow
def test_the_papers_state_is_one_factor(llvm):
    m = Material(enhance("ggx", seed=1), {})
    s = specialize(m, max_error=10.0)
    assert s.brdf.distilled[0].slots == ("F*G",) and not s.brdf.evaluated


def test_damaged_networks_are_refused(llvm, tmp_path):
    c = fast().brdf.distilled[0]
    for description, flat in (
        ({**c.describe(), "hidden": [10**9]}, c.flat),
        ({**c.describe(), "inputs": ["colour"]}, c.flat),
        (c.describe(), c.flat[:-1]),
        (c.describe(), np.append(c.flat, np.float32(0))),
    ):
        with pytest.raises(ValueError, match="distilled network"):
            distilled_network.restore([description], flat)
    (again,) = distilled_network.restore([c.describe()], c.flat)
    assert dataclasses.astuple(again)[:2] == (c.slots, c.inputs)
    tensors = fast().to_dict()
    with pytest.raises(ValueError, match="Specialize it again"):
        Material.from_arrays(tensors["description"], tensors["params"], np.array(tensors["weights"])[:-1])


# --- the parts it is made of ------------------------------------------------------------------------------------------


def test_jacobian_is_the_difference_quotient():
    rng = np.random.default_rng(0)
    x, slopes = rng.normal(size=(40, 3)), rng.normal(size=(40, 3, 2))
    layers = distillation.first((3, 4, 5, 2), np.zeros(2), rng)
    shapes, u = [w.shape for w, _ in layers], np.concatenate([v.ravel() for layer in layers for v in layer])
    got = distillation._jacobian(layers, distillation._forward(layers, x)[1], slopes)
    for k in range(len(u)):
        sides = [
            distillation.forward(distillation._unflatten(u + s * 1e-6 * (np.arange(len(u)) == k), shapes), x)
            for s in (1, -1)
        ]
        expected = np.einsum("nrm,nm->rn", slopes, (sides[0] - sides[1]) / 2e-6).ravel()
        np.testing.assert_allclose(got[:, k], expected, atol=1e-5)


def test_pruned_network_is_the_same_function():
    rng = np.random.default_rng(0)
    sizes = (3, 16, 16, 16, 1)
    layers = [(rng.normal(size=(m, n)) / 2, 2 * rng.normal(size=m)) for n, m in zip(sizes, sizes[1:], strict=False)]
    inputs = {name: rng.random(5000) for name in ("sin2_h", "cos_d", "product")}
    small = pruning.prune("B", layers, inputs)
    x = a = np.stack(list(inputs.values()), 1)
    for k, (w, b) in enumerate(layers):
        z = a @ w.T + b
        a = np.where(z > 0, z, 0.01 * z) if k < 3 else z
    np.testing.assert_allclose(distillation.forward(small.layers, x), a, atol=1e-4 * np.abs(a).max())
    assert small.multiply_adds < 0.7 * sum(w.size for w, _ in layers)


# --- on the command line ----------------------------------------------------------------------------------------------


def test_network_without_any_kink_is_an_affine_function_that_can_be_kept():
    """All units positive: no layer is left but the last, and the file is read again."""
    rng = np.random.default_rng(0)
    layers = [(rng.random((4, 2)), np.ones(4)), (rng.random((3, 4)), np.ones(3)), (rng.random((1, 3)), np.zeros(1))]
    x = {"cos_d": rng.random(50), "product": rng.random(50)}
    small = pruning.prune("B", layers, x)
    assert small.sizes == (2, 1)
    (again,) = distilled_network.restore(json.loads(json.dumps([small.describe()])), small.flat)
    y = np.stack(list(x.values()), 1)
    wanted = y
    for w, b in layers:
        wanted = wanted @ w.T + b
    np.testing.assert_allclose(distillation.forward(again.layers, y), wanted, rtol=1e-5)


@pytest.mark.slow
def test_command_line_and_back(llvm, tmp_path, capsys):
    exact().save(tmp_path / "gold.bsdf")
    gold, small, back = (str(tmp_path / name) for name in ("gold.bsdf", "fast.bsdf", "back.bsdf"))
    assert main(["specialize", gold, "-o", small, "--max-error", "0.01", "--json", "--variant", "llvm_ad_rgb"]) == 0
    report = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert report["specialize_error"] < report["specialize_max_error"] == 0.01 and report["output"] == small
    assert main(["specialize", small, "-o", back, "--undo", "--variant", "llvm_ad_rgb"]) == 0
    assert Material.load(back).brdf.multiply_adds == exact().brdf.multiply_adds
    capsys.readouterr()
    assert main(["specialize", gold, "-o", back, "--undo", "--variant", "llvm_ad_rgb"]) == 2
    assert 'gold.bsdf" keeps no exact material to go back to. Nothing was written.' in capsys.readouterr().err
