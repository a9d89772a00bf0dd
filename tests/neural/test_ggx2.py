"""Models with networks that see shapes only: values and gradients by the twin, symmetries for any weights, extremes."""

from __future__ import annotations

import dataclasses

import lanes

import mi_enhance  # noqa: F401  (before mitsuba)

import drjit as dr  # isort: skip
import mitsuba as mi
import numpy as np
import pytest
import twin
import twin_networks

from mi_enhance.neural import baked, cooperative, mlp
from mi_enhance.neural.enhance import enhance
from mi_enhance.neural.trainable import Trainable

# Relative, for alpha >= 0.05: 6e-8 in h is 1e-6 of the lobe, a few such networks and their exponentials on top.
VALUE = 2e-4
GRADIENT = 1e-3  # of the largest: float32 through lobes of alpha 0.1, three networks and a sum over the pairs
ROUNDING = 1e-5  # the same float32 operations in another order

LOBES = ("B", "G", "G2")
TERMS = ("M", "B", "S", "D", "F", "G", "1/E", "S2", "D2", "F2", "G2", "1/E2")
SCALARS = tuple(t for t in TERMS if t not in twin_networks.COLOURS)
STATES = {
    "lobes": LOBES,
    "terms": TERMS,
    "everything": (*TERMS, "M*B", "M+S", "S*D", "F*G", "M+S2", "S2*D2", "G2*1/E2"),
}
OTHERS = {"ggx": ("F", "F*G", "G", "1/E"), "cook_torrance": ("F", "G"), "ward": ("D", "1/E"), "abc": ("F", "G")}


def shaken(model="ggx2", replace=LOBES, seed=0, modulated=True, n_latent=6, hidden=(8, 8)):
    """Networks with Xavier weights and biases that are not zero: a lost bias must show."""
    b = enhance(model, replace, inputs="shape", modulated=modulated, n_latent=n_latent, hidden=hidden, seed=seed)
    flat = mlp.flatten(b.modules)
    flat = flat + np.random.default_rng(seed).normal(0, 0.1, flat.shape).astype(np.float32)
    return dataclasses.replace(b, modules=mlp.unflatten(b.modules, flat))


def log_sum(f, wo, weights=(1, 2, 3)):
    """In the measure of the loss, each channel with a weight of its own, over all pairs."""
    z = mi.Float(np.ascontiguousarray(wo[:, 2], np.float32))
    return sum(dr.log(1 + c * z) * w for c, w in zip(f, weights, strict=True))


# --- values -----------------------------------------------------------------------------------------------------------


def test_slots_and_parameters():
    b = enhance("ggx2", LOBES, inputs="shape", modulated=True)
    assert str(b) == "M * [B] + S * D * F * [G] * 1/E + S2 * D2 * F2 * [G2] * 1/E2"
    assert len(b.state) == 23 and sum(b.state) == 3
    names = ["rho_s2", "alpha_x2", "alpha_y2", "asymmetry", "latent", "norm_B", "norm_G", "norm_G2"]
    assert [p.name for p in b.parameters][-8:] == names
    assert b.n_parameters == 17 + 1 + 27 + 3
    # 5 shapes and 27 latent numbers are folded; 7 features, and 2 more for each lobe, vary
    assert {(m.sizes, m.n_folded) for m in b.modules.values()} == {((32 + 11, *mlp.HIDDEN, 1), 32)}
    assert enhance("ggx2", (), inputs="shape").n_parameters == 17  # no network, nothing that only networks read


@pytest.mark.parametrize("inputs", ["symmetric", "directions"])
def test_inputs_made_for_one_lobe_are_refused(inputs):
    """They have 12 places for parameters, and ggx2 has 17; an operator reads none."""
    with pytest.raises(ValueError, match=rf'inputs="{inputs}" has no place for alpha_x2, alpha_y2, rho_s2 of model'):
        enhance("ggx2", ("G",), inputs=inputs)
    assert enhance("ggx2", ("F*G",), inputs=inputs).n_parameters == 17


@pytest.mark.parametrize("modulated", [True, False], ids=["modulated", "plain"])
@pytest.mark.parametrize("state", STATES)
def test_values_of_ggx2_are_the_twins(llvm, state, modulated):
    b = shaken(replace=STATES[state], seed=3, modulated=modulated)
    wi, wo = twin.pairs(2000, seed=1, min_cos=0.02)
    p = twin_networks.parameters(b, 2000)
    expected = twin_networks.brdf("ggx2", wi, wo, p, b.modules)
    assert (expected > 0).any(1).mean() > 0.5
    np.testing.assert_allclose(lanes.evaluate(b, wi, wo, p), expected, rtol=VALUE)


@pytest.mark.parametrize("name", OTHERS)
def test_values_of_other_models_are_the_twins(llvm, name):
    b = shaken(name, OTHERS[name], seed=4)
    wi, wo = twin.pairs(2000, seed=1, min_cos=0.02)
    p = twin_networks.parameters(b, 2000, alpha=(0.1, 1.0))
    # 1e-9: a Gaussian many roughnesses off its peak
    expected = twin_networks.brdf(name, wi, wo, p, b.modules)
    np.testing.assert_allclose(lanes.evaluate(b, wi, wo, p), expected, rtol=VALUE, atol=1e-9)


@pytest.mark.parametrize("kind", [baked.Baked, cooperative.Cooperative], ids=lambda k: k.__name__)
def test_rendering_evaluators_are_the_twin(llvm, kind):
    """One uniform material, folded: what a scene evaluates."""
    b = shaken(replace=TERMS, seed=3)
    wi, wo = twin.pairs(1000, seed=1, min_cos=0.02)
    p = twin_networks.parameters(b, 1)
    got = lanes.evaluate(b, wi, wo, p, b.evaluators(kind))
    np.testing.assert_allclose(got, twin_networks.brdf("ggx2", wi, wo, p, b.modules), rtol=VALUE)


# --- gradients --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("model, replace", [("ggx2", LOBES), ("ggx2", ("F", "F*G", "D2")), ("abc", ("F", "G"))])
def test_gradients_of_parameters_and_weights_are_central_differences(llvm, model, replace):
    """One material, 400 pairs: its parameters, asymmetry and latent numbers included, and every weight."""
    b, n = shaken(model, replace, seed=6, n_latent=3, hidden=(5, 4)), 400
    wi, wo = twin.pairs(n, seed=7, min_cos=0.1)
    p = twin_networks.parameters(b, 1, seed=8, alpha=(0.1, 0.8), tilt=0.0)
    trainable, values = Trainable(b.modules), lanes.parameters(p)
    dr.enable_grad(values)
    dr.backward(dr.sum(log_sum(b(lanes.vectors(wi), lanes.vectors(wo), values, trainable), wo)))

    def total(params, networks):
        f = twin_networks.brdf(model, wi, wo, params, networks)
        return np.sum(np.log1p(f * wo[:, 2:].astype(np.float64)) @ [1, 2, 3])

    got = np.array(trainable.gradient(), np.float64)
    flat = mlp.flatten(b.modules).astype(np.float64)
    expected = twin.central_differences(lambda x: total(p, twin_networks.unflatten(b.modules, x)), flat)
    assert (expected != 0).mean() > 0.8
    np.testing.assert_allclose(got, expected, atol=GRADIENT * np.abs(expected).max())
    for q in b.parameters:
        moved = lambda x, q=q: total({**p, q.name: x[None]}, b.modules)  # noqa: E731
        expected = twin.central_differences(moved, p[q.name][0])
        got = np.array(
            [np.array(v).ravel() for v in ([dr.grad(values[q.name])] if q.size == 1 else dr.grad(values[q.name]))]
        )
        assert np.abs(expected).max() > 1e-2, q.name  # it does matter
        np.testing.assert_allclose(got.ravel(), expected, atol=GRADIENT * np.abs(expected).max(), err_msg=q.name)


# --- symmetries that hold for any weights -----------------------------------------------------------------------------


@pytest.mark.parametrize("state", STATES)
def test_without_asymmetry_reciprocal_to_the_bit(llvm, state):
    """Every feature is made of sums and products of both directions, so their order does not even round otherwise."""
    b = shaken(replace=STATES[state], seed=9)
    wi, wo = twin.pairs(3000, seed=2)
    p = twin_networks.parameters(b, 3000, seed=5, alpha=(0.001, 1.0))
    p["asymmetry"][:] = 0
    np.testing.assert_array_equal(lanes.evaluate(b, wi, wo, p), lanes.evaluate(b, wo, wi, p))


@pytest.mark.parametrize("state", STATES)
def test_asymmetry_tells_viewer_from_light_and_its_sign_which_is_which(llvm, state):
    b = shaken(replace=STATES[state], seed=9)
    wi, wo = twin.pairs(3000, seed=2)
    p = twin_networks.parameters(b, 3000, seed=5)
    a, swapped = lanes.evaluate(b, wi, wo, p), lanes.evaluate(b, wo, wi, p)
    lit = (a + swapped).min(1) > 0
    assert np.median(np.abs(a - swapped)[lit] / (a + swapped)[lit]) > 3e-4  # rounding is 1e-6
    p["asymmetry"] *= -1
    np.testing.assert_allclose(lanes.evaluate(b, wo, wi, p), a, rtol=10 * ROUNDING)  # of log(a / b) and -log(b / a)


@pytest.mark.parametrize("state", STATES)
def test_equal_roughness_is_isotropic_whatever_the_azimuth_of_the_half_vector(llvm, state):
    """Both lobes round: turning viewer and light by 90 degrees about the normal changes nothing but rounding."""
    b = shaken(replace=STATES[state], seed=9)
    wi, wo = twin.pairs(2000, seed=3, min_cos=0.05)
    p = twin_networks.parameters(b, 1, seed=7, tilt=0)
    turn = np.float32([[0, -1, 0], [1, 0, 0], [0, 0, 1]])
    before = lanes.evaluate(b, wi, wo, p)
    assert np.abs(lanes.evaluate(b, wi @ turn, wo @ turn, p) / before - 1).max() > 0.01  # anisotropic: it matters
    for k in ("", "2"):
        p[f"alpha_y{k}"] = p[f"alpha_x{k}"]
    before = lanes.evaluate(b, wi, wo, p)
    np.testing.assert_allclose(lanes.evaluate(b, wi @ turn, wo @ turn, p), before, rtol=ROUNDING)


def test_linear_in_each_colour_for_any_weights(llvm):
    """Networks do not see colours: twice a colour is twice its term to the bit, and the three terms add up."""
    b = shaken(replace=("B", "D", "F", "G", "1/E", "D2", "F2", "G2", "1/E2", "F*G"), seed=9)
    wi, wo = twin.pairs(2000, seed=3)
    p = twin_networks.parameters(b, 2000, seed=7)
    colours, total = ("rho_d", "rho_s", "rho_s2"), 0
    for name in colours:
        p["rho_d"] = p["rho_d"] / 2  # half of it: twice that is no more than allowed
        alone = {**p, **{c: np.zeros_like(p[c]) for c in colours if c != name}}
        f = lanes.evaluate(b, wi, wo, alone)
        assert f.max() > 0
        np.testing.assert_array_equal(lanes.evaluate(b, wi, wo, {**alone, name: 2 * p[name]}), 2 * f)
        p["rho_d"] = p["rho_d"] * 2
        total = total + (2 * f if name == "rho_d" else f)
    np.testing.assert_allclose(lanes.evaluate(b, wi, wo, p), total, rtol=ROUNDING)


@pytest.mark.parametrize("name", ["ggx2", "ward", "abc"])
def test_folded_inputs_hold_neither_colours_nor_frame(llvm, name):
    b = shaken(name, LOBES if name == "ggx2" else OTHERS[name])
    p, q = (lanes.parameters(twin_networks.parameters(b, 1, seed=s)) for s in (1, 2))
    seen = [*twin_networks.SHAPES[name], "latent"]
    edited = {key: p[key] if key in seen else q[key] for key in p}
    folded = [[np.array(v) for biases in b.fold(x, b.evaluators()).values() for v in biases] for x in (p, edited, q)]
    assert np.array_equal(folded[0], folded[1]) and not np.array_equal(folded[0], folded[2])


# --- extremes ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("replace", [LOBES, SCALARS], ids=["lobes", "scalars"])
def test_corners_of_the_ranges_stay_finite_with_all_gradients(llvm, replace):
    """Mirrors of roughness 1e-4, cosines down to 1e-6, no second lobe, asymmetry at its bounds, F0 of 0 and 1.

    Without S: five networks in a row at their largest, exp(20) each, are beyond float32.
    """
    b, n = shaken(replace=replace, seed=10), 6000
    rng = np.random.default_rng(11)
    middle = {"asymmetry": 0.0, "latent": 0.5}
    p = {}
    for q in b.parameters:
        between = middle.get(q.name, np.sqrt(q.low * q.high) if q.log else (q.low + q.high) / 2)
        p[q.name] = rng.choice([q.low, between, q.high], (n, q.size))
    wi, wo = twin.awkward_pairs(n, seed=12)
    values, trainable = lanes.parameters(p), Trainable(b.modules)
    dr.enable_grad(values)
    f = b(lanes.vectors(wi), lanes.vectors(wo), values, trainable)
    a = np.array(f)
    assert np.isfinite(a).all() and a.min() >= 0 and a.max() > 1
    dr.backward(dr.sum(log_sum(f, wo)))
    weights, gradients = trainable.gradient(), {name: dr.grad(v) for name, v in values.items()}
    dr.eval(gradients)
    assert np.isfinite(np.array(weights)).all()
    for name, v in gradients.items():
        assert np.isfinite(np.array(v)).all(), name


@pytest.mark.parametrize("grazing", [1e-4, 1e-2, 1.0])
def test_second_lobe_of_no_strength_is_not_there(llvm, grazing):
    """rho_s2 = 0 leaves nothing of it, however narrow: no 0 times infinity. Networks still see its roughness."""
    b, n = shaken(seed=10), 500
    wi, wo = (twin.unit(w * [1, 1, grazing]).astype(np.float32) for w in twin.pairs(n, seed=13, min_cos=0.1))
    p = twin_networks.parameters(b, n, seed=14, tilt=0)
    p["rho_s2"][:] = 0
    for alpha in (1e-4, 1.0):
        p["alpha_x2"][:] = p["alpha_y2"][:] = alpha
        one = twin_networks.brdf("ggx2", wi, wo, p, {k: b.modules[k] for k in ("B", "G")})
        # a cosine of 1e-4 that passed through a frame has lost three of its digits
        np.testing.assert_allclose(lanes.evaluate(b, wi, wo, p), one, rtol=VALUE if grazing == 1 else 5e-3)


def test_below_either_horizon_is_exactly_zero(llvm):
    b = shaken(seed=10)
    wi, wo = twin.unit(np.random.default_rng(15).normal(size=(2, 4000, 3))).astype(np.float32)
    p = twin_networks.parameters(b, 1, seed=16, tilt=0)
    f = lanes.evaluate(b, wi, wo, p)
    above = (wi[:, 2] > 0) & (wo[:, 2] > 0)
    assert not f[~above].any() and (f[above] > 0).all()
