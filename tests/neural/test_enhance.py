"""The enhanced BRDF: how it prints and counts, and rotations that hold for any weights; tests/contract has the rest."""

from __future__ import annotations

import lanes
import numpy as np
import pytest
import twin

from mi_enhance.neural.enhance import enhance

# Relative, for alpha >= 0.05: 6e-8 in h is 1e-6 of the lobe, four such networks and their exponentials on top.
VALUE = 1e-4

STATES = {"analytic": (), "final": ("F", "F*G", "G", "1/E"), "everything": twin.SLOTS}


def with_latent(brdf, n, seed=0, **settings):
    return twin.parameters(n, seed, latent=27 if any(m.n_folded for m in brdf.modules.values()) else 0, **settings)


def test_final_state_prints_as_in_the_paper():
    brdf = enhance("ggx")
    assert str(brdf) == "M + S * D * [F] [*] [G] * [1/E]"
    assert brdf.state == (0, 0, 0, 0, 0, 0, 1, 1, 1, 0, 1)


def test_unknown_inputs_are_refused():
    with pytest.raises(
        ValueError, match=r'inputs="angles" is unknown. Choose one of: shape, reciprocal, own, symmetric, directions'
    ):
        enhance("ggx", inputs="angles")


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
