"""States, their neighbours, other analytic terms in a slot, and networks that see what their term sees."""

from __future__ import annotations

import lanes
import numpy as np
import pytest
import twin

import mi_enhance  # noqa: F401  (before mitsuba)

import mitsuba as mi  # isort: skip

from mi_enhance import enhance, models
from mi_enhance.analytic import alternative_terms, geometry, parameters, terms
from mi_enhance.hypercube import states
from mi_enhance.material.material import Material
from mi_enhance.neural import inputs

GGX = models.get("ggx")
SIZES = ((8, 8), (4,))
ORIGINAL = (0,) * 11


# --- states -----------------------------------------------------------------------------------------------------------


def test_the_papers_hypercube():
    """11 bits; N + 1 candidates at distance 1, 1 + N + N (N - 1) / 2 at distance 2 (section 4.2)."""
    choices = states.choices(GGX)
    assert [len(c) for c in choices.values()] == [2] * 11
    near, far = (states.neighbours(ORIGINAL, choices, distance=d) for d in (1, 2))
    assert len(near) == len(set(near)) == 12 and len(far) == len(set(far)) == 67
    assert near[0] == ORIGINAL and set(near) <= set(far)
    # and back again: a module may be reverted
    assert ORIGINAL in states.neighbours(near[3], choices)


def test_digits_count_all_choices():
    choices = states.choices(GGX, modules=SIZES, alternatives={"D": ["D_beckmann"]})
    assert choices["D"] == (None, (8, 8), (4,), "D_beckmann") and choices["F*G"] == (None, (8, 8), (4,))
    assert len(states.neighbours(ORIGINAL, choices)) == 1 + 11 * 2 + 1
    brdf = states.brdf_of(GGX, (0, 0, 0, 0, 3, 0, 1, 0, 2, 0, 0), choices, inputs="shape")
    assert str(brdf) == "M + S * D_beckmann * [F] * [G] * 1/E"
    assert [m.sizes[1:-1] for m in brdf.modules.values()] == [(8, 8), (4,)]


def test_constraints_narrow_the_hypercube():
    fixed = {"M": "analytic", "S": "analytic", "G": "neural"}
    choices = states.choices(GGX, fixed=fixed, nodes_only=True)
    assert choices["M"] == choices["F*G"] == (None,) and choices["G"] == ((16, 32, 16),)
    assert str(states.brdf_of(GGX, ORIGINAL, choices)) == "M + S * D * F * [G] * 1/E"
    around = states.neighbours(ORIGINAL, choices, distance=2, max_modules=2)
    assert {len(list(states.chosen(s, choices))) for s in around} == {1, 2}
    # what is there already may stay, however many are allowed
    assert states.neighbours(ORIGINAL, choices, max_modules=0) == [ORIGINAL]


@pytest.mark.parametrize(
    "wrong, message",
    [
        ({"fixed": {"X": "neural"}}, '"X" is not a slot'),
        ({"fixed": {"F": "nural"}}, r'fixed\["F"\] is \'nural\'; it must be "analytic" or "neural"'),
        ({"modules": [[]]}, "hidden layers .* are out of range: 1 to 8 layers of 1 to 1024"),
        ({"modules": [[16, 10**6]]}, "hidden layers .* are out of range: 1 to 8 layers of 1 to 1024"),
        ({"alternatives": {"D": ["D_phong"]}}, 'unknown term "D_phong". Choose one of: D_ggx'),
        ({"alternatives": {"F*G": ["F_schlick"]}}, "is an operator"),
    ],
)
def test_wrong_choices_are_refused(wrong, message):
    with pytest.raises((ValueError, KeyError), match=message):
        states.choices(GGX, **wrong)


# --- other analytic terms ---------------------------------------------------------------------------------------------


def random_parameters(brdf, n, seed=0):
    p = twin.parameters(n, seed=seed, tilt=0.1)
    known = {q.name for q in brdf.parameters}
    return {name: v for name, v in p.items() if name in known}


def test_terms_of_another_model_make_that_model(llvm):
    chosen = {"D": "D_beckmann", "F": "F_cook_torrance", "G": "G_v_cavity", "1/E": "inv_E_pi"}
    mixed = enhance(alternative_terms.with_terms(GGX, chosen), ())
    assert str(mixed) == "M + S * D_beckmann * F_cook_torrance * G_v_cavity * inv_E_pi"
    wi, wo = twin.pairs(2000, seed=1)
    p = random_parameters(mixed, 2000)
    expected = lanes.evaluate(enhance("cook_torrance", ()), wi, wo, p)
    np.testing.assert_array_equal(lanes.evaluate(mixed, wi, wo, p), expected)


@pytest.mark.parametrize("B, C", [(1, 0.01), (100, 1), (100, 1.999), (1e4, 2), (1e8, 3), (50, 10)])
def test_normalized_abc_integrates_to_one(llvm, B, C):
    """Against the cosine over the hemisphere; the integral in the float64 of NumPy, over 1 - cos(theta_h)."""
    x = np.concatenate([[0], np.geomspace(1e-12, 1, 400_000)])
    shape = (1 + B * x) ** -C
    peak = float(terms.D_abc_normalised(mi.Vector3f(0, 0, 1), mi.Float(B), mi.Float(C))[0])
    assert abs(2 * np.pi * np.trapezoid(peak * shape * (1 - x), x) - 1) < 2e-5


def test_abc_starts_where_ggx_is(llvm):
    """Within 10 % down to a hundredth of the peak."""
    for alpha in (0.05, 0.2):
        start = alternative_terms.start(
            alternative_terms.with_terms(GGX, {"D": "D_abc_normalised"}), "D", "D_abc_normalised",
            {"alpha_x": np.array([alpha]), "alpha_y": np.array([alpha])},
        )  # fmt: skip
        tan = np.linspace(0, 3 * alpha, 50)
        h = twin.unit(np.stack([tan, 0 * tan, np.ones(50)], 1))
        values = {name: mi.Float(float(v[0])) for name, v in start.items()}
        got = np.array(terms.D_abc_normalised(lanes.vectors(h), **values))
        np.testing.assert_allclose(got, twin.D_ggx(h, alpha, alpha), rtol=0.1)


def test_two_lobes_bring_parameters_of_their_own():
    model = alternative_terms.with_terms(models.get("ggx2"), {"D": "D_abc_normalised", "D2": "D_abc_normalised"})
    assert model.extra == ("B", "C", "B2", "C2") and "M * B + S * D_abc_normalised * F" in str(model)
    assert [p.name for p in model.parameters][-4:] == ["B", "C", "B2", "C2"]


def test_what_a_term_lacks_is_named():
    with pytest.raises(ValueError, match='D_ggx needs alpha_x, alpha_y, which model "abc" does not have'):
        alternative_terms.with_terms(models.get("abc"), {"D": "D_ggx"})


def test_a_material_with_other_terms_is_saved_loaded_and_sampled(llvm, tmp_path):
    model = alternative_terms.with_terms(GGX, {"D": "D_abc_normalised", "F": "F_dielectric"})
    brdf = enhance(model, {"G": (4, 3), "1/E": (5,)}, n_latent=3, inputs="shape", modulated=True)
    material = Material(brdf, {"B": 300.0, "C": 1.3, "ior": 1.8})
    material.save(tmp_path / "m.bsdf")
    loaded = Material.load(tmp_path / "m.bsdf")
    assert str(loaded.brdf) == "M + S * D_abc_normalised * F_dielectric * [G] * [1/E]"
    wi, wo = twin.pairs(500, seed=2)
    np.testing.assert_array_equal(loaded.evaluate(wi, wo), material.evaluate(wi, wo))
    # its density integrates to at most 1, and what sampling returns is the albedo that uniform directions see
    bsdf, si = loaded.bsdf(), mi.SurfaceInteraction3f()
    si.wi = mi.Vector3f(0.5, 0, 0.75**0.5)
    rng = np.random.default_rng(0)
    u = [rng.random((k, 200_000)).astype(np.float32) for k in (1, 2, 2)]
    _, weight = bsdf.sample(mi.BSDFContext(), si, mi.Float(u[0][0]), mi.Point2f(u[1]))
    uniform = mi.warp.square_to_uniform_hemisphere(mi.Point2f(u[2]))
    f = bsdf.eval(mi.BSDFContext(), si, uniform)
    albedo = np.array(f).mean() * 2 * np.pi
    np.testing.assert_allclose(np.array(weight).mean(), albedo, rtol=0.03)


# --- networks that see what their term sees ---------------------------------------------------------------------------


def own(slot, wi, wo, model="ggx2"):
    p = {"alpha_x": 0.2, "alpha_y": 0.4, "alpha_x2": 0.5, "alpha_y2": 0.3, "asymmetry": 1.0}
    vectors = [lanes.vectors(w) for w in (wi, wo)]
    record = {**geometry.quantities(*vectors), **{name: mi.Float(v) for name, v in p.items()}}
    node = models.get(model).graph.find(slot)
    (columns,) = inputs.of_directions(record, "own", *vectors, [node]).values()
    assert len(columns) == len(inputs.names_of_directions(models.get(model), "own", node))
    return np.stack([np.array(c) for c in columns], -1)


def pair(h, d_angle, azimuth):
    """wi and wo with half vector h, at `d_angle` from it, turned by `azimuth` about it."""
    t = twin.unit(np.cross(h, [0.3, 0.2, 0.9]))
    b = np.cross(h, t)
    side = np.cos(azimuth)[:, None] * t + np.sin(azimuth)[:, None] * b
    c, s = np.cos(d_angle)[:, None], np.sin(d_angle)[:, None]
    return c * h + s * side, c * h - s * side


def test_modules_see_what_their_terms_see(llvm):
    rng = np.random.default_rng(0)
    n = 200
    h = twin.unit(np.stack([*rng.normal(0, 0.2, (2, n)), np.ones(n)], 1))
    angle, turn = rng.uniform(0, 0.9, n), rng.uniform(0, 2 * np.pi, (2, n))
    a, b = pair(h, angle, turn[0]), pair(h, rng.uniform(0, 0.9, n), turn[1])
    same = dict(atol=2e-6, rtol=2e-5)
    np.testing.assert_allclose(own("D", *a), own("D", *b), **same)  # the same half vector
    c = pair(np.tile([[0, 0, 1.0]], (n, 1)), angle, turn[1])
    np.testing.assert_allclose(own("F", *a), own("F", *c), **same)  # the same difference angle
    turned = [w * [-1, 1, 1] for w in (a[1], a[0])]
    mirrored = [own(slot, a[0], turned[0]) - own(slot, a[0], a[1]) for slot in ("G", "1/E", "B")]
    for difference in mirrored:
        np.testing.assert_allclose(difference, 0, **same)  # G, 1/E and B do not see the azimuth between the directions
    assert np.abs(own("D2", *a) - own("D", *a)).max() > 0.01  # each lobe by its own roughness
    for one, other in (("D", c), ("F", b), ("G", b)):
        assert np.abs(own(one, *a) - own(one, *other)).max() > 0.01


def test_own_networks_are_their_twin(llvm):
    """[F] in float64: the network is handed cos and sin of theta_d, roughness, F0 and latent numbers."""
    brdf = enhance("ggx", ("F",), inputs="own", n_latent=3, hidden=(5, 4), seed=3)
    wi, wo = twin.pairs(1000, seed=4, min_cos=0.05)
    p = random_parameters(brdf, 1000) | {"asymmetry": np.zeros((1000, 1)), "norm_F": np.zeros((1000, 1))}
    p["latent"] = np.random.default_rng(1).random((1000, 3)).astype(np.float32)
    i, o, q, up = twin.local(wi, wo, p)
    cos_d = np.linalg.norm(i + o, axis=1) / 2
    x = [np.log(q["alpha_x"]) / 4, np.log(q["alpha_y"]) / 4, np.sqrt(q["F0"] + 1e-4), *q["latent"].T]
    x += [cos_d, np.sqrt(1 - np.minimum(cos_d, 1) ** 2 + 1e-4)]
    f = np.exp(twin.mlp(brdf.modules["F"].layers, np.stack(x, -1)))
    h = twin.unit(i + o)
    d, g = twin.D_ggx(h, q["alpha_x"], q["alpha_y"]), twin.G_smith_ggx(i, o, q["alpha_x"], q["alpha_y"])
    lobe = (d * f[:, 0] * g * twin.inv_E(i[:, 2], o[:, 2]))[:, None] * q["rho_s"]
    got = lanes.evaluate(brdf, wi, wo, p)
    np.testing.assert_allclose(got[up], q["rho_d"] / np.pi + lobe, rtol=1e-3)
    assert parameters.count(brdf.parameters) == 12 + 1 + 3 + 1
