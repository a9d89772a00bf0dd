"""The edge of what is allowed: values and gradients against the twin, and whatever hypothesis comes up with."""

from __future__ import annotations

import mi_enhance  # noqa: F401  (before mitsuba)

import drjit as dr  # isort: skip
import extreme_cases as cases
import lanes
import mitsuba as mi
import numpy as np
import pytest
import twin
from hypothesis import given, settings
from hypothesis import strategies as st

from mi_enhance import models, terms
from mi_enhance.analytic import alternative_terms
from mi_enhance.neural.enhance import enhance

N, N_GRADIENTS = 2000, 40
VALUE = 1e-4  # relative; what float32 gives wherever the rounding of its inputs is not magnified
MODULES = 2e-4  # pretrained modules add up hundreds of products to a logarithm: its last digits are the value's
GRADIENT = 1e-3
# Where it is: directions, normal and tangent are known to 6e-8, and a lobe of alpha 1e-4 turned with them moves by a
# thousandth of its width; latent numbers of 16 make units of some hundreds, whose last digit the exponential shows.
MAGNIFIED = {
    "near mirror, tilted": (1e-2, 5e-2),
    "alpha 1e-4 against 1": (2e-2, 5e-2),
    "albedos 1e-30 and 10": (2e-2, 5e-2),
    "latent far outside": (5e-3, 5e-3),
    "all at their bounds": (5e-2, 1e-1),
}
# The back vector of two directions that graze on the same side is made of differences of equals.
BACK = {"h on the horizon": (0.3, 0.6)}
# Sums over 64 units, of factors in RGB.
READ_OUT = {"wi = wo": (2e-3, 5e-3)}
OVER_ROUNDING = 8  # error over what half a unit in the last place of the inputs changes; 4 tries find most of it

MATERIALS = ["own features, random", *sorted(models.MODELS)]
SLOW = ["[paper]", "[ggx2]", "[ggx2_rgb]", "[ggx2_small]", "[ggx]", "[ward]", "[cook_torrance]"]
SATURATED = "[S] [D] [F] [G] [1/E] saturated"


@pytest.fixture(scope="module")
def materials():
    mi.set_variant("llvm_ad_rgb")
    return cases.materials()


def test_all_materials_are_in_the_lists(materials):
    assert {*MATERIALS, *SLOW, SATURATED} == set(materials)


@pytest.mark.parametrize("name", [*MATERIALS, *(pytest.param(name, marks=pytest.mark.slow) for name in SLOW)])
def test_values_and_gradients_are_the_twins(llvm, materials, name):
    for case in cases.CASES:
        e = cases.errors(materials[name], cases.CASES[case], N, N_GRADIENTS, seed=1)
        known = MAGNIFIED | {"ggx_retro": BACK, "[ggx2_rgb]": READ_OUT}.get(name, {})
        value, gradient = known.get(case, (MODULES if name in SLOW else VALUE, GRADIENT))
        assert e.value.max() < value, case
        assert (e.value / (VALUE + e.rounding)).max() < OVER_ROUNDING, case
        assert e.gradient.max() < gradient, case
        assert len(e.gradient) > 2, case


@pytest.mark.parametrize("name", [pytest.param(SATURATED, marks=pytest.mark.slow), "ashikhmin_shirley"])
def test_nothing_is_infinite_or_negative(llvm, materials, name):
    brdf, n = materials[name].brdf, 20_000
    evaluators, largest = lanes.fused(brdf.networks), 0
    for case in cases.CASES.values():
        wi, wo, params = cases.draw(case, brdf, n, seed=2)
        f, gradients = cases.gradients(brdf, evaluators, wi, wo, params)
        assert cases.n_bad(f, gradients)[0] == 0
        largest = max(largest, np.array(f).max())
    if name == SATURATED:
        assert largest > 1e30  # the limits were reached, and hold


def test_the_hunt_finds_what_it_hunts():
    mi.set_variant("llvm_ad_rgb")
    f = mi.Color3f(mi.Float([1, -1, 0, 1]), 1, mi.Float([1, 1, float("inf"), 1]))
    assert cases.n_bad(f, {"latent": [mi.Float([0, 0, 0, float("nan")])]})[0] == 3
    assert cases.n_bad(f, {})[0] == 2


# --- terms of no model of the package ---------------------------------------------------------------------------------


def test_normalized_abc_is_the_twins_over_its_range(llvm):
    n = 20_000
    random = cases.Random(n, 3)
    b, c = dr.exp(random() * np.log(1e8).item()), dr.exp(random() * np.log(1e3).item()) * 0.01
    theta = dr.exp((random() - 1) * np.log(1e6).item()) * (np.pi / 2)
    h = mi.Vector3f(dr.sin(theta), 0, dr.cos(theta))
    values = {"B": b, "C": c}
    dr.enable_grad(values)
    d = terms.D_abc_normalised(h, **values)
    dr.backward(dr.log(1 + d))
    got, h, b, c = (
        np.array(dr.detach(d), np.float64),
        np.array(h, np.float64).T,
        *(np.array(dr.detach(v), np.float64) for v in (b, c)),
    )
    expected = twin.D_abc_normalised(h, b, c)
    # the rounding of the exponent, up to 10 log(1e8), counts in full; the integral's difference loses two digits
    np.testing.assert_allclose(got, expected, rtol=1e-4, atol=1e-30)
    assert all(np.isfinite(np.array(dr.grad(v))).all() for v in values.values())


@pytest.mark.parametrize("name", alternative_terms.ALTERNATIVES)
def test_models_with_other_terms_stay_finite(llvm, name):
    """In both lobes of ggx2, in all cases, with all derivatives."""
    slot = "1/E" if name.startswith("inv_E") else name.partition("_")[0]
    slots = [s for s in (slot, f"{slot}2") if s in models.get("ggx2").graph.slots]
    brdf = enhance(alternative_terms.with_terms(models.get("ggx2"), dict.fromkeys(slots, name)), ())
    for case in cases.CASES.values():
        wi, wo, params = cases.draw(case, brdf, 5000, seed=4)
        assert cases.n_bad(*cases.gradients(brdf, {}, wi, wo, params))[0] == 0


# --- anything ---------------------------------------------------------------------------------------------------------


def numbers(low, high):
    """Any float32 of a range, its bounds often."""
    low, high = (float(np.float32(v)) for v in (low, high))
    return st.one_of(st.sampled_from([low, high]), st.floats(low, high, width=32))


def directions():
    """Polar and azimuthal angles: anything, straight up, grazing to the last bit."""
    cos = st.one_of(numbers(0, 1), st.sampled_from([1.0, 1e-6, 1e-7, 1e-4]))
    return st.tuples(cos, st.one_of(numbers(-np.pi, np.pi), st.sampled_from([0.0, np.pi, np.pi / 2])))


def vector(cos, phi):
    sin = np.sqrt(1 - cos * cos)
    return np.array([sin * np.cos(phi), sin * np.sin(phi), cos]).astype(np.float32)


@pytest.mark.parametrize("name", sorted(models.MODELS))
@settings(max_examples=20)
@given(data=st.data())
def test_any_material_and_any_pair_give_a_reflectance(name, data):
    """Finite, not negative, the same both ways, 0 below the horizon, with finite derivatives; one lane an example."""
    mi.set_variant("llvm_ad_rgb")
    brdf = enhance(name, ())
    p = {
        q.name: np.array([[data.draw(numbers(q.low, q.high), label=q.name) for _ in range(q.size)]])
        for q in brdf.parameters
    }
    wi, wo = (vector(*data.draw(directions(), label=label))[None] for label in ("wi", "wo"))
    wo = data.draw(st.sampled_from([wo, wi, wi * [-1, -1, 1], -wi]), label="pair")
    f, gradients = cases.gradients(brdf, {}, lanes.vectors(wi), lanes.vectors(wo), lanes.parameters(p))
    assert cases.n_bad(f, gradients)[0] == 0
    f = np.array(f, np.float64).T
    back = np.array(brdf(lanes.vectors(wo), lanes.vectors(wi), lanes.parameters(p)), np.float64).T
    np.testing.assert_allclose(f, back, rtol=1e-5)
    if min(wi[0, 2], wo[0, 2]) <= 0:
        assert not f.any()
