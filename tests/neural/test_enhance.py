"""The enhanced BRDF: values against the twin, symmetries that hold for any weights, and hostile inputs."""

from __future__ import annotations

import drjit as dr
import lanes
import mitsuba as mi
import numpy as np
import pytest
import twin

from mi_enhance.neural import baked, cooperative
from mi_enhance.neural.enhance import enhance

# Relative, for alpha >= 0.05: 6e-8 in h is 1e-6 of the lobe, four such networks and their exponentials on top.
VALUE = 1e-4
ROUNDING = 1e-5  # two orders of the same float32 operations

FINAL = ("F", "F*G", "G", "1/E")  # the paper's final state
TERMS = ("M", "S", "D", "F", "G", "1/E")
STATES = {
    "analytic": (),
    "1/E": ("1/E",),
    "final": FINAL,
    "colours": ("M", "S"),
    "operators on colours": ("M+S", "S*D"),
    "operators": ("M+S", "S*D", "D*F", "F*G", "G*1/E"),
    "everything": twin.SLOTS,
}


def layers(brdf):
    return {slot: mlp.layers for slot, mlp in brdf.modules.items()}


def with_latent(brdf, n, seed=0, **settings):
    return twin.parameters(n, seed, latent=27 if any(m.n_folded for m in brdf.modules.values()) else 0, **settings)


def test_final_state_prints_as_in_the_paper():
    brdf = enhance("ggx")
    assert str(brdf) == "M + S * D * [F] [*] [G] * [1/E]"
    assert brdf.state == (0, 0, 0, 0, 0, 0, 1, 1, 1, 0, 1)


def test_unknown_inputs_are_refused():
    with pytest.raises(
        ValueError, match=r'enhance\(\): inputs="angles" is unknown. Choose one of: shape, own, symmetric, directions'
    ):
        enhance("ggx", inputs="angles")


@pytest.mark.parametrize("inputs", ["symmetric", "directions"])
@pytest.mark.parametrize("state", STATES)
def test_values_are_the_twins(llvm, state, inputs):
    brdf = enhance("ggx", STATES[state], inputs=inputs, seed=3)
    wi, wo = twin.pairs(2000, seed=1, min_cos=0.02)
    p = with_latent(brdf, 2000)
    expected = twin.brdf(wi, wo, p, layers(brdf), inputs)
    assert (expected > 0).any(1).mean() > 0.5
    np.testing.assert_allclose(lanes.evaluate(brdf, wi, wo, p), expected, rtol=VALUE)


@pytest.mark.parametrize("kind", [baked.Baked, cooperative.Cooperative], ids=lambda k: k.__name__)
def test_rendering_evaluators_are_the_twin(llvm, kind):
    """One uniform material, folded: what a scene evaluates."""
    brdf = enhance("ggx", FINAL, seed=3)
    wi, wo = twin.pairs(2000, seed=1, min_cos=0.02)
    p = with_latent(brdf, 1)
    got = lanes.evaluate(brdf, wi, wo, p, brdf.evaluators(kind))
    np.testing.assert_allclose(got, twin.brdf(wi, wo, p, layers(brdf)), rtol=VALUE)


@pytest.mark.parametrize("state", ["analytic", "final", "everything"])
def test_symmetric_inputs_are_reciprocal_for_any_weights(llvm, state):
    brdf = enhance("ggx", STATES[state], seed=4)
    wi, wo = twin.pairs(3000, seed=2)
    p = with_latent(brdf, 3000, seed=5, alpha=(0.001, 1.0))
    np.testing.assert_allclose(lanes.evaluate(brdf, wi, wo, p), lanes.evaluate(brdf, wo, wi, p), rtol=ROUNDING)


def test_raw_directions_are_not_reciprocal(llvm):
    brdf = enhance("ggx", FINAL, inputs="directions", seed=4)
    wi, wo = twin.pairs(1000, seed=2)
    p = with_latent(brdf, 1000, tilt=0)
    a, b = lanes.evaluate(brdf, wi, wo, p), lanes.evaluate(brdf, wo, wi, p)
    assert np.median(np.abs(a - b) / (a + b)) > 1e-3  # rounding is 1e-6


@pytest.mark.parametrize("state", ["analytic", "final", "everything"])
@pytest.mark.parametrize("angle", [np.pi / 2, 1.0], ids=["90 degrees", "1 radian"])
def test_equal_roughness_is_isotropic(llvm, state, angle):
    """Turning both directions about the material's own normal changes nothing."""
    brdf = enhance("ggx", STATES[state], seed=6)
    wi, wo = twin.pairs(1000, seed=3, min_cos=0.05)
    p = {k: v[:1] for k, v in with_latent(brdf, 1, seed=7).items()}
    p["alpha_y"] = p["alpha_x"] = np.array([[0.25]])
    n = twin.frame(p["n_x"][0, 0], p["n_y"][0, 0], 0)[2]
    turned = [twin.rotate(w, n, np.full(len(w), angle)) for w in (wi, wo)]
    keep = np.minimum(turned[0][:, 2], turned[1][:, 2]) > 0.01  # the surface's horizon does not turn with n
    keep &= np.minimum(wi @ n, wo @ n) > 0.01
    a, b = lanes.evaluate(brdf, wi, wo, p)[keep], lanes.evaluate(brdf, *turned, p)[keep]
    assert keep.sum() > 300
    np.testing.assert_allclose(a, b, rtol=VALUE)  # the turned directions are rounded anew


@pytest.mark.parametrize("state", ["analytic", "final"])
def test_rotating_the_tangent_rotates_the_brdf(llvm, state):
    brdf = enhance("ggx", STATES[state], seed=6)
    wi, wo = twin.pairs(1000, seed=3, min_cos=0.05)
    p = with_latent(brdf, 1, seed=8)
    p["alpha_x"], p["alpha_y"] = np.array([[0.1]]), np.array([[0.5]])
    angle = 0.7
    n = twin.frame(p["n_x"][0, 0], p["n_y"][0, 0], 0)[2]
    turned = [twin.rotate(w, n, np.full(len(w), angle)) for w in (wi, wo)]
    keep = np.minimum(turned[0][:, 2], turned[1][:, 2]) > 0.01
    keep &= np.minimum(wi @ n, wo @ n) > 0.01
    a = lanes.evaluate(brdf, wi, wo, p)[keep]
    assert np.abs(a / lanes.evaluate(brdf, *turned, p)[keep] - 1).max() > 0.1  # anisotropic: it does matter
    p["t_theta"] = p["t_theta"] + angle
    np.testing.assert_allclose(a, lanes.evaluate(brdf, *turned, p)[keep], rtol=VALUE)


@pytest.mark.parametrize("state", ["analytic", "final", "everything"])
def test_below_either_horizon_is_exactly_zero(llvm, state):
    brdf = enhance("ggx", STATES[state], seed=3)
    rng = np.random.default_rng(9)
    wi, wo = twin.unit(rng.normal(size=(2, 4000, 3))).astype(np.float32)
    p = with_latent(brdf, 1)
    p["n_x"], p["n_y"] = np.array([[0.4]]), np.array([[0.3]])
    n = twin.frame(0.4, 0.3, 0)[2]
    f = lanes.evaluate(brdf, wi, wo, p)
    surface = (wi[:, 2] > 0) & (wo[:, 2] > 0)
    material = np.minimum(wi @ n, wo @ n)
    assert not f[~surface].any() and not f[surface & (material < -1e-6)].any()
    assert (surface & (material < -1e-6)).sum() > 100
    assert (f[surface & (material > 1e-6)] > 0).all()


def extreme(n, latent, seed):
    """Materials at the corners of their ranges."""
    rng = np.random.default_rng(seed)
    corner = lambda *values, size=1: rng.choice(values, (n, size))  # noqa: E731
    return {
        "n_x": corner(-0.5, 0, 0.5),
        "n_y": corner(-0.5, 0, 0.5),
        "t_theta": corner(-np.pi, 0, np.pi),
        "rho_d": corner(0, 1, size=3),
        "rho_s": corner(0, 10, size=3),
        "alpha_x": corner(1e-4, 1e-2, 1),
        "alpha_y": corner(1e-4, 1e-2, 1),
        "F0": corner(0, 1),
        "latent": corner(-16, 16, size=latent),
    }


@pytest.mark.parametrize("inputs", ["symmetric", "directions"])
@pytest.mark.parametrize("state", ["analytic", "final", "terms", "everything"])
def test_hostile_materials_stay_finite_with_their_gradients(llvm, state, inputs):
    replace = {**STATES, "terms": TERMS}[state]
    brdf = enhance("ggx", replace, inputs=inputs, seed=11)
    n = 4000
    wi, wo = twin.awkward_pairs(n, seed=12)
    p = extreme(n, 27, seed=13)
    if not replace:
        del p["latent"]
    values, evaluators = lanes.parameters(p), lanes.fused(brdf.modules)
    dr.enable_grad(values)
    f = brdf(lanes.vectors(wi), lanes.vectors(wo), values, evaluators)
    a = np.array(f)
    assert np.isfinite(a).all() and a.min() >= 0
    # in the measure of the loss: the derivative of f itself may well be beyond float32
    dr.backward(dr.sum(sum(dr.log(1 + c * wo_z) for c, wo_z in zip(f, [mi.Float(wo[:, 2])] * 3, strict=True))))
    gradients = {name: dr.grad(v) for name, v in values.items()}
    dr.eval(gradients)  # one kernel, not one for each parameter
    for name, v in gradients.items():
        assert np.isfinite(np.array(v)).all(), name


def test_no_network_means_no_latent_parameter():
    assert enhance("ggx", ()).n_parameters == 12
    assert enhance("ggx", ("F*G",)).n_parameters == 12  # an operator looks at its operands only
    assert enhance("ggx", ("F",), n_latent=5).n_parameters == 17
    assert enhance("ggx", ("F",), n_latent=0).n_parameters == 12


def test_multiply_adds_of_the_papers_network_after_folding():
    # three modules 6-16-32-16-1, 39 further inputs folded away, and one operator 2-16-32-16-1
    expected = 3 * (6 * 16 + 16 * 32 + 32 * 16 + 16) + 2 * 16 + 16 * 32 + 32 * 16 + 16
    assert enhance("ggx").multiply_adds == expected
    assert enhance("ggx", ()).multiply_adds == 0


def test_operators_of_colours_count_three_times_and_constant_networks_not_at_all():
    one = 2 * 4 + 4 * 3 + 3
    assert enhance("ggx", ("F*G",), hidden=(4, 3)).multiply_adds == one
    assert enhance("ggx", ("S*D", "M+S"), hidden=(4, 3)).multiply_adds == 6 * one
    assert enhance("ggx", ("M",), hidden=(4, 3), inputs="shape").multiply_adds == 0
