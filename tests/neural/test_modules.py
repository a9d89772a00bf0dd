"""The networks: sizes, initial weights, three evaluators that agree, and their gradients."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
import twin
import twin_networks
from lanes import floats

from mi_enhance import enhance
from mi_enhance.neural import baked, cooperative
from mi_enhance.neural.mlp import HIDDEN, MLP, flatten, unflatten, xavier
from mi_enhance.neural.trainable import Trainable

FORWARD = 3e-6  # relative to the largest output; four float32 layers of up to 45 terms
GRADIENT = 1e-5  # the same, back and forth
N = 64  # lanes

SMALL = (8, 12, 8)  # compiles in a fraction of the time of HIDDEN; the code is the same
SHAPES = {
    "node": ((45, *SMALL, 1), 39),
    "colour": ((39, *SMALL, 3), 39),
    "operator": ((2, *SMALL, 1), 0),
    "modulated": ((45, *SMALL, 1), 39, True),
    "modulated colour": ((39, *SMALL, 3), 39, True),
}


def network(kind, seed=0):
    """Xavier weights, and biases that are not zero: a lost bias must show."""
    rng = np.random.default_rng(seed)
    sizes, n_folded, *modulated = SHAPES[kind]
    mlp = xavier(sizes, n_folded, rng, *modulated)
    layers = tuple((w, (b + rng.normal(0, 0.3, b.shape)).astype(np.float32)) for w, b in mlp.layers)
    return MLP(layers, mlp.n_folded, mlp.modulated)


def inputs(mlp, n=N, seed=1):
    """(n, in) float64 that float32 holds."""
    rng = np.random.default_rng(seed)
    return rng.normal(0, 1, (n, mlp.sizes[0])).astype(np.float32).astype(np.float64)


def evaluator(kind, mlp):
    return Trainable({"F": mlp})["F"] if kind is Trainable else kind(mlp)


def run(net, mlp, x):
    bias = net.fold(floats(x[:, : mlp.n_folded])) if mlp.n_folded else net.fold([])
    return np.stack([np.array(v) for v in net(floats(x[:, mlp.n_folded :]), bias)], -1)


# ---------------------------------------------------------------------- sizes and initial weights


def test_paper_model_has_6612_weights():
    brdf = enhance("ggx")
    assert brdf.n_weights == 6612 and 4 * brdf.n_weights == 26448
    assert {slot: m.n_weights for slot, m in brdf.modules.items()} == {"F": 1825, "F*G": 1137, "G": 1825, "1/E": 1825}
    assert brdf.n_parameters == 12 + 27


@pytest.mark.parametrize(
    "slot, sizes, n_folded",
    [
        *((s, (45, 16, 32, 16, 1), 39) for s in ("D", "F", "G", "1/E")),
        *((s, (39, 16, 32, 16, 3), 39) for s in ("M", "S")),
        *((s, (2, 16, 32, 16, 1), 0) for s in ("M+S", "S*D", "D*F", "F*G", "G*1/E")),
    ],
    ids=str,
)
def test_module_sizes_are_the_papers(slot, sizes, n_folded):
    mlp = enhance("ggx", [slot]).modules[slot]
    assert (mlp.sizes, mlp.n_folded) == (sizes, n_folded)


def test_xavier_fills_its_range_and_nothing_else():
    """Uniform within sqrt(6 / (in + out)): standard deviation is the limit over sqrt(3)."""
    mlp = xavier((45, *HIDDEN, 1), 39, np.random.default_rng(3))
    for (w, b), n_in, n_out in zip(mlp.layers, mlp.sizes, mlp.sizes[1:], strict=False):
        limit = np.sqrt(6 / (n_in + n_out))
        assert w.dtype == np.float32 and w.shape == (n_out, n_in) and not b.any()
        assert np.abs(w).max() <= np.float32(limit)
        assert np.abs(w).max() > 0.8 * limit
        if w.size > 100:  # few weights scatter more than 10 %
            assert w.std() == pytest.approx(limit / np.sqrt(3), rel=0.1)


def test_modulated_last_layer_starts_as_xaviers_and_moves_as_far_with_the_material():
    """Folded inputs of 0 leave what Xavier draws without modulation; inputs of size 1 add about as much again."""
    sizes, n_folded = (45, *HIDDEN, 1), 39
    plain, own = (xavier(sizes, n_folded, np.random.default_rng(5), m) for m in (False, True))
    assert own.sizes == plain.sizes and own.n_weights == plain.n_weights - 17 + 17 * (39 + 1)
    (w, b), (matrix, offset) = plain.layers[-1], own.layers[-1]
    assert np.array_equal(offset, np.append(w, b)) and offset.dtype == matrix.dtype == np.float32
    change = matrix @ np.random.default_rng(6).choice([-1, 1], (39, 1000))
    assert 0.4 < change.std() / np.abs(w).max() < 0.7  # sqrt(39) entries uniform within max / sqrt(39): 1 / sqrt(3)


def test_operators_are_never_modulated():
    """They are folded into nothing: all of a material that they see is their operands."""
    brdf = enhance("ggx", ["F", "F*G"], modulated=True)
    assert {slot: m.modulated for slot, m in brdf.modules.items()} == {"F": True, "F*G": False}


def test_same_seed_gives_the_same_weights():
    a, b, c = (flatten(enhance("ggx", seed=s).modules) for s in (5, 5, 6))
    assert np.array_equal(a, b) and not np.array_equal(a, c)


def test_flatten_and_unflatten_are_inverse():
    kinds = [("M", "colour"), ("F", "node"), ("F*G", "operator"), ("S", "modulated colour"), ("G", "modulated")]
    networks = {slot: network(kind) for slot, kind in kinds}
    flat = flatten(networks)
    assert flat.dtype == np.float32 and len(flat) == sum(m.n_weights for m in networks.values())
    template = {slot: network(kind, 9) for slot, kind in kinds}
    back = unflatten(template, flat)
    for slot, mlp in networks.items():
        assert (back[slot].n_folded, back[slot].modulated) == (mlp.n_folded, mlp.modulated)
        for (w, b), (w2, b2) in zip(mlp.layers, back[slot].layers, strict=True):
            assert np.array_equal(w, w2) and np.array_equal(b, b2)
    for slot, mlp in twin_networks.unflatten(template, flat).items():  # the order as the twin knows it
        for ours, theirs in zip(networks[slot].layers, mlp.layers, strict=True):
            assert all(np.array_equal(v, v2) for v, v2 in zip(ours, theirs, strict=True))
    assert flatten({}).shape == (0,)


# ---------------------------------------------------------------------- values


@pytest.mark.parametrize("kind", [baked.Baked, cooperative.Cooperative, Trainable], ids=lambda k: k.__name__)
@pytest.mark.parametrize("shape", SHAPES)
def test_evaluators_are_the_twin(llvm, kind, shape):
    mlp = network(shape)
    x = inputs(mlp)
    expected = twin_networks.mlp(mlp, x)
    np.testing.assert_allclose(run(evaluator(kind, mlp), mlp, x), expected, atol=FORWARD * np.abs(expected).max())


@pytest.mark.parametrize("shape", SHAPES)
def test_half_precision_is_near_the_twin(llvm, shape):
    """What a GPU computes, computed here: ten bits of mantissa, a few layers."""
    mlp = network(shape)
    x = inputs(mlp)
    expected = twin_networks.mlp(mlp, x)
    got = run(cooperative.Cooperative(mlp, half=True), mlp, x)
    np.testing.assert_allclose(got, expected, atol=5e-3 * np.abs(expected).max())


@pytest.mark.parametrize("shape", SHAPES)
def test_half_precision_stays_in_its_range(llvm, shape):
    """Weights and parameters that take a layer beyond 65504, both signs at once: no infinity less infinity."""
    mlp = network(shape)
    large = MLP(tuple((30 * w, 30 * b) for w, b in mlp.layers), mlp.n_folded, mlp.modulated)
    assert np.abs(twin_networks.mlp(large, 100 * inputs(mlp))).max() > 65504
    assert np.isfinite(run(cooperative.Cooperative(large, half=True), large, 100 * inputs(mlp))).all()


@pytest.mark.parametrize("shape", ["node", "modulated"])
def test_folding_is_exact_for_a_uniform_material(llvm, shape):
    """One lane of constants folded, many lanes of directions: the same as 45 inputs in every lane."""
    mlp = network(shape)
    x = inputs(mlp)
    x[:, :39] = x[0, :39]
    net = baked.Baked(mlp)
    bias = net.fold([mi.Float(v) for v in x[0, :39]])
    assert all(len(b) == 1 for b in bias)
    got = np.array(net(floats(x[:, 39:]), bias)[0])
    assert np.array_equal(got, run(net, mlp, x)[:, 0])  # to the last bit
    np.testing.assert_allclose(got, twin_networks.mlp(mlp, x)[:, 0], atol=FORWARD * np.abs(got).max())


# ---------------------------------------------------------------------- gradients


def smooth_enough(mlp, x, margin=1e-3):
    """Rows of `x` at which no hidden neuron sits in its kink, where a derivative means nothing."""
    keep = np.ones(len(x), bool)
    for w, b in mlp.layers[:-1]:
        x = x @ w.T.astype(np.float64) + b
        keep &= np.abs(x).min(1) > margin
        x = np.where(x > 0, x, twin.SLOPE * x)
    return keep


def jacobian(mlp, x):
    """d out / d in of the twin, (n, out, in)."""
    return np.array([twin.central_differences(lambda v: twin_networks.mlp(mlp, v[None])[0], row) for row in x])


@pytest.mark.parametrize("shape", ["node", "operator", "modulated"])
@pytest.mark.parametrize("kind", [baked.Baked, Trainable], ids=lambda k: k.__name__)
def test_reverse_mode_is_central_differences(llvm, kind, shape):
    mlp = network(shape)
    x = inputs(mlp, 80)
    x = x[smooth_enough(mlp, x)]
    values = floats(x)
    dr.enable_grad(values)
    net = evaluator(kind, mlp)
    (y,) = net(values[mlp.n_folded :], net.fold(values[: mlp.n_folded]))
    dr.backward(dr.sum(y))
    got = np.stack([np.array(dr.grad(v)) for v in values], -1)
    expected = jacobian(mlp, x)[:, 0]
    assert len(x) > 20
    np.testing.assert_allclose(got, expected, atol=GRADIENT * np.abs(expected).max())


@pytest.mark.parametrize("shape", ["node", "modulated"])
@pytest.mark.parametrize("wrt", ["x", "bias", "both"])
def test_baked_forward_mode_is_central_differences(llvm, wrt, shape):
    mlp = network(shape)
    x = inputs(mlp, 80)
    x = x[smooth_enough(mlp, x)]
    rng = np.random.default_rng(2)
    tangent = rng.normal(0, 1, x.shape).astype(np.float32).astype(np.float64)
    if wrt == "x":
        tangent[:, :39] = 0
    elif wrt == "bias":
        tangent[:, 39:] = 0
    net, values, directions = baked.Baked(mlp), floats(x), floats(tangent)
    moving = {"x": values[39:], "bias": values[:39], "both": values}[wrt]
    dr.enable_grad(moving)
    (y,) = net(values[39:], net.fold(values[:39]))
    dr.set_grad(moving, {"x": directions[39:], "bias": directions[:39], "both": directions}[wrt])
    dr.enqueue(dr.ADMode.Forward, moving)
    dr.traverse(dr.ADMode.Forward)
    expected = np.einsum("ni,ni->n", jacobian(mlp, x)[:, 0], tangent)
    np.testing.assert_allclose(np.array(dr.grad(y)), expected, atol=GRADIENT * np.abs(expected).max())


@pytest.mark.parametrize("shape", ["node", "modulated"])
def test_baked_gradient_of_what_is_folded_is_summed_over_the_lanes(llvm, shape):
    mlp = network(shape)
    x = inputs(mlp, 80)
    x[:, :39] = x[0, :39]
    x = x[smooth_enough(mlp, x)]
    net, one = baked.Baked(mlp), [mi.Float(v) for v in x[0, :39]]
    dr.enable_grad(one)
    (y,) = net(floats(x[:, 39:]), net.fold(one))
    dr.backward(dr.sum(y))
    expected = jacobian(mlp, x)[:, 0, :39].sum(0)
    np.testing.assert_allclose([dr.grad(v)[0] for v in one], expected, atol=GRADIENT * np.abs(expected).max())


@pytest.mark.parametrize("shape", SHAPES)
def test_trainable_weight_gradient_is_central_differences(llvm, shape):
    """Two networks over one vector; only the second is evaluated, so the first has gradient zero."""
    mlp = network(shape)
    x = inputs(mlp, 300)
    x = x[smooth_enough(mlp, x)][:40]
    seeds = np.random.default_rng(4).normal(0, 1, (len(x), mlp.sizes[-1])).astype(np.float32).astype(np.float64)
    both = {"other": network("operator", 7), "F": mlp}
    trainable = Trainable(both)
    net = trainable["F"]
    y = net(floats(x[:, mlp.n_folded :]), net.fold(floats(x[:, : mlp.n_folded])))
    dr.backward(dr.sum(sum(v * s for v, s in zip(y, floats(seeds), strict=True))))
    got = np.array(trainable.gradient())
    other = both["other"].n_weights
    assert not got[:other].any()

    def total(flat):
        return np.sum(twin_networks.mlp(twin_networks.unflatten({"F": mlp}, flat)["F"], x) * seeds)

    expected = twin.central_differences(total, flatten({"F": mlp}).astype(np.float64))
    np.testing.assert_allclose(got[other:], expected, atol=GRADIENT * np.abs(expected).max())


def test_trainable_sums_all_backward_passes_once(llvm):
    mlp = network("operator")
    x = inputs(mlp, 32)
    trainable = Trainable({"F": mlp})

    def backward():
        (y,) = trainable["F"](floats(x), [])
        dr.backward(dr.sum(y))

    backward()
    once = np.array(trainable.gradient())
    backward()
    backward()
    np.testing.assert_allclose(trainable.gradient(), 2 * once, rtol=GRADIENT, atol=GRADIENT * np.abs(once).max())
    assert not np.array(trainable.gradient()).any()


def test_trainable_gives_its_weights_back(llvm):
    networks = {"F": network("node"), "F*G": network("operator")}
    assert np.array_equal(flatten(Trainable(networks).modules()), flatten(networks))
