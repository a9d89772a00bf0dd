"""Modules that see shapes only: symmetries for any weights, what is folded, and a second lobe that is not there."""

from __future__ import annotations

import dataclasses

import lanes
import numpy as np
import pytest
import twin
import twin_networks

import mi_enhance  # noqa: F401  (before mitsuba)
from mi_enhance.neural import mlp
from mi_enhance.neural.enhance import enhance

# Relative, for alpha >= 0.05: 6e-8 in h is 1e-6 of the lobe, a few such networks and their exponentials on top.
VALUE = 2e-4
ROUNDING = 1e-5  # the same float32 operations in another order

LOBES = ("B", "G", "G2")
TERMS = ("M", "B", "S", "D", "F", "G", "1/E", "S2", "D2", "F2", "G2", "1/E2")
STATES = {
    "lobes": LOBES,
    "everything": (*TERMS, "M*B", "M+S", "S*D", "F*G", "M+S2", "S2*D2", "G2*1/E2"),
}
OTHERS = {"ward": ("D", "1/E"), "abc": ("F", "G")}


def shaken(model="ggx2", replace=LOBES, seed=0, modulated=True, n_latent=6, hidden=(8, 8)):
    """Networks with Xavier weights and biases that are not zero: a lost bias must show."""
    b = enhance(model, replace, inputs="shape", modulated=modulated, n_latent=n_latent, hidden=hidden, seed=seed)
    flat = mlp.flatten(b.modules)
    flat = flat + np.random.default_rng(seed).normal(0, 0.1, flat.shape).astype(np.float32)
    return dataclasses.replace(b, modules=mlp.unflatten(b.modules, flat))


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


# --- symmetries that hold for any weights -----------------------------------------------------------------------------


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
