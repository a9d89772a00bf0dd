"""The contract that every model keeps with every kind of replacement: one table, the same checks for each row.

A row names a model, the slots that modules replace, and the inputs that they see. The twins compute
the same in float64. Modules are small and have random weights and biases: nothing here depends on how good they are.
"""

from __future__ import annotations

import dataclasses
import functools

import lanes
import mitsuba as mi
import numpy as np
import pytest
import twin
import twin_networks
from any_material import USUAL, given, materials, pairs
from plugin_scenes import render_attached

import drjit as dr  # isort: skip
from mi_enhance import models
from mi_enhance.material.material import Material
from mi_enhance.neural import baked, cooperative, mlp
from mi_enhance.neural.enhance import enhance
from mi_enhance.neural.trainable import Trainable


@dataclasses.dataclass(frozen=True)
class Row:
    model: str
    replace: tuple[str, ...] = ()
    inputs: str = "shape"
    modulated: bool = False


FINAL = ("F", "F*G", "G", "1/E")  # the paper's final state
LOBES = ("B", "G", "G2")
TERMS = ("M", "B", "S", "D", "F", "G", "1/E", "S2", "D2", "F2", "G2", "1/E2")
OPERATORS = ("M*B", "M+S", "S*D", "F*G", "M+S2", "S2*D2", "G2*1/E2")
TABLE = {name: Row(name) for name in sorted(models.MODELS)} | {
    "ggx final": Row("ggx", FINAL, "symmetric"),
    "ggx final, directions": Row("ggx", FINAL, "directions"),
    "ggx everything": Row("ggx", twin.SLOTS, "symmetric"),
    "ggx everything, directions": Row("ggx", twin.SLOTS, "directions"),
    "ggx colours": Row("ggx", ("M", "S"), "symmetric"),
    "ggx operators": Row("ggx", ("M+S", "S*D", "D*F", "F*G", "G*1/E"), "symmetric"),
    "ggx shape": Row("ggx", FINAL),
    "cook_torrance shape": Row("cook_torrance", ("F", "G")),
    "ward shape": Row("ward", ("D", "1/E")),
    "abc shape": Row("abc", ("F", "G")),
    "ggx2 lobes": Row("ggx2", LOBES, modulated=True),
    "ggx2 lobes, plain": Row("ggx2", LOBES),
    "ggx2 lobes, reciprocal": Row("ggx2", LOBES, "reciprocal", modulated=True),
    "ggx2 terms": Row("ggx2", TERMS, modulated=True),
    "ggx2 everything": Row("ggx2", TERMS + OPERATORS, modulated=True),
    "ggx2 own": Row("ggx2", ("D", "F", "G", "D2", "1/E2"), "own", modulated=True),
}
ENHANCED = [name for name, row in TABLE.items() if row.replace]

# Relative: 6e-8 in h is 1e-4 in a Gaussian of 20 roughnesses; some such networks and their exponentials on top.
VALUE = 2e-4
DARK = 1e-9  # absolute: what such a Gaussian is many roughnesses off its peak
ROUNDING = 1e-5  # two orders of the same float32 operations
GRADIENT = 1e-3  # of the derivative and of its mean: derivatives of those exponents
N = 1500

_WITH_MODULES = {"alpha_x": (0.1, 1), "alpha_y": (0.1, 1), "B": (3, 1e3), "latent": (-0.5, 1.5), "norm": (-1, 1)}
_SMOOTH = (
    _WITH_MODULES
    | {"alpha_x2": (0.1, 1), "alpha_y2": (0.1, 1), "F0": (0.01, 0.95), "n_u": (1, 200)}
    | {"n_v": (1, 200)}
)


@functools.lru_cache
def brdf_of(name, hidden=(6, 5)):
    """Xavier weights, and biases that are not zero: a lost bias must show."""
    row = TABLE[name]
    if not row.replace:
        return enhance(row.model, ())
    b = enhance(row.model, row.replace, inputs=row.inputs, modulated=row.modulated, n_latent=3, hidden=hidden, seed=3)
    flat = mlp.flatten(b.modules)
    flat = flat + np.random.default_rng(3).normal(0, 0.1, flat.shape).astype(np.float32)
    return dataclasses.replace(b, modules=mlp.unflatten(b.modules, flat))


def expected(name, wi, wo, p, modules=None):
    row, modules = TABLE[name], brdf_of(name).modules if modules is None else modules
    if not row.replace:
        return twin.analytic(row.model, wi, wo, p)
    if row.inputs in ("symmetric", "directions"):
        return twin.brdf(wi, wo, p, {slot: m.layers for slot, m in modules.items()}, row.inputs)
    return twin_networks.brdf(row.model, wi, wo, p, modules, row.inputs)


def parameters(name, n=N, seed=0, usual=None):
    ranges = _WITH_MODULES if TABLE[name].replace else {}
    return materials(brdf_of(name), n, seed, {**USUAL, **ranges} if usual is None else usual)


def gradients(name, wi, wo, p, evaluators=None):
    """f_r (N, 3), and the derivatives of the loss's log(1 + f cos) for each lane's own parameters."""
    values, b = lanes.parameters(p), brdf_of(name)
    dr.enable_grad(values)
    f = b(lanes.vectors(wi), lanes.vectors(wo), values, lanes.fused(b.modules) if evaluators is None else evaluators)
    z = mi.Float(np.ascontiguousarray(wo[:, 2]))
    dr.backward(sum(dr.log(1 + c * z) * weight for c, weight in zip(f, (1, 2, 3), strict=True)))
    result = {key: dr.grad(v) for key, v in values.items()}
    dr.eval(f, result)  # one kernel, not one for each parameter
    return np.array(f, np.float64).T, {k: np.array(v, np.float64).reshape(-1, len(wi)) for k, v in result.items()}


def loss(f, wo):
    return np.log1p(f * wo[:, 2:].astype(np.float64)) @ [1, 2, 3]


@pytest.mark.parametrize("name", TABLE)
def test_values_are_the_twins(llvm, name):
    p = parameters(name)
    p["rho_d"][::2] = 0  # the lobe alone
    wi, wo = twin.pairs(N, seed=1, min_cos=0.02)
    want = expected(name, wi, wo, p)
    assert (want > DARK).mean() > 0.5
    np.testing.assert_allclose(lanes.evaluate(brdf_of(name), wi, wo, p), want, rtol=VALUE, atol=DARK)


@pytest.mark.parametrize("name", TABLE)
def test_both_directions_may_be_exchanged(llvm, name):
    """Unless a parameter asks for asymmetry, or the modules see raw directions."""
    p = parameters(name, usual={"latent": (-0.5, 1.5)})
    if "asymmetry" in p:
        p["asymmetry"][:] = 0
    wi, wo = pairs(N)
    a, b = (lanes.evaluate(brdf_of(name), *w, p) for w in ((wi, wo), (wo, wi)))
    if TABLE[name].inputs == "directions":
        lit = (a + b).min(1) > 0
        assert np.quantile(np.abs(a - b)[lit] / (a + b)[lit], 0.9) > 1e-3  # rounding is 1e-6
    else:  # inputs of shapes are sums and products of both directions: their order does not even round otherwise
        np.testing.assert_allclose(a, b, rtol=0 if "ggx2 " in name else ROUNDING)


@pytest.mark.parametrize("name", TABLE)
def test_below_either_horizon_is_exactly_zero(llvm, name):
    """That of the surface, and that of the material, whose normal is tilted."""
    p = parameters(name)
    wi, wo = twin.unit(np.random.default_rng(9).normal(size=(2, N, 3))).astype(np.float32)
    height = np.minimum(wi[:, 2], wo[:, 2])
    if "n_x" in p:
        p["n_x"][:], p["n_y"][:], n = 0.4, 0.3, twin.frame(0.4, 0.3, 0)[2]
        height = np.minimum(height, np.minimum(wi @ n, wo @ n))
    f = lanes.evaluate(brdf_of(name), wi, wo, p)
    assert not f[height < -1e-6].any() and (f[height > 1e-6].max(1) > 0).mean() > 0.9
    assert (height > 1e-6).sum() > 100


@pytest.mark.parametrize("name", TABLE)
def test_gradient_of_every_parameter_is_the_twins(llvm, name):
    """Each lane is a material of its own."""
    n = 400
    p = parameters(name, n, seed=2, usual={**USUAL, **_SMOOTH})
    wi, wo = twin.pairs(n, seed=3, min_cos=0.1)
    _, got = gradients(name, wi, wo, p)
    for key, v in p.items():
        largest = 0
        for k in range(v.shape[1]):
            step = np.zeros_like(v)
            step[:, k] = 1e-6 * np.maximum(np.abs(v[:, k]), 1e-2)
            up, down = (loss(expected(name, wi, wo, {**p, key: v + sign * step}), wo) for sign in (1, -1))
            want = (up - down) / (2 * step[:, k])
            # n_x and n_y move pairs over the horizon and over the edge of G: a step, for a lane or two
            wrong = np.abs(got[key][k] - want) > GRADIENT * (np.abs(want) + np.abs(want).mean())
            assert wrong.sum() <= (3 if key in ("n_x", "n_y") else 0), (key, k, wrong.sum())
            largest = max(largest, np.abs(want).max())
        assert largest > 1e-3, key  # it does matter


@pytest.mark.parametrize("name", ["ggx final", "abc shape", "ggx2 lobes"])
def test_gradient_of_every_weight_is_the_twins(llvm, name):
    b, n = brdf_of(name), 60
    p = parameters(name, n, seed=2, usual={**USUAL, **_SMOOTH})
    wi, wo = twin.pairs(n, seed=3, min_cos=0.1)
    trainable = Trainable(b.modules)
    gradients(name, wi, wo, p, trainable)

    def total(flat):
        return loss(expected(name, wi, wo, p, twin_networks.unflatten(b.modules, flat)), wo).sum()

    want = twin.central_differences(total, mlp.flatten(b.modules).astype(np.float64))
    assert (want != 0).mean() > 0.8
    np.testing.assert_allclose(np.array(trainable.gradient()), want, atol=GRADIENT * np.abs(want).max())


@pytest.mark.parametrize("name", TABLE)
def test_corners_of_the_ranges_stay_finite_with_their_gradients(llvm, name):
    """Mirrors, cosines down to 1e-7, no lobe, asymmetry at its bounds, F0 of 0 and 1, latent numbers far outside."""
    rng, p = np.random.default_rng(4), {}
    for q in brdf_of(name).parameters:
        middle = np.sqrt(q.low * q.high) if q.log else (q.low + q.high) / 2
        p[q.name] = rng.choice([q.low, middle, q.high], (4000, q.size))
    wi, wo = pairs(4000, seed=5)
    wi[1::9, 2] *= 1e-3
    wo[::7], wo[::11] = wi[::7], -wi[::11]
    f, derivatives = gradients(name, wi, wo, p)
    assert np.isfinite(f).all() and f.min() >= 0 and f.max() > 1
    for key, v in derivatives.items():
        assert np.isfinite(v).all(), key


@pytest.mark.parametrize("name", TABLE)
def test_file_brings_the_material_back(llvm, tmp_path, name):
    old = Material(brdf_of(name), given(parameters(name, 1, seed=6)))
    old.save(tmp_path / "m.bsdf")
    new = Material.load(tmp_path / "m.bsdf")
    assert str(new.brdf) == str(old.brdf) and new.brdf.model.name == TABLE[name].model
    np.testing.assert_array_equal(new.as_vector(), old.as_vector())
    p, (wi, wo) = parameters(name), twin.pairs(N, seed=7)
    np.testing.assert_array_equal(*(lanes.evaluate(m.brdf, wi, wo, p) for m in (new, old)))


@pytest.mark.parametrize("kind", [baked.Baked, cooperative.Cooperative], ids=lambda k: k.__name__)
@pytest.mark.parametrize("name", ["ggx final", "ggx2 terms"])
def test_evaluators_of_a_scene_are_the_twin(llvm, name, kind):
    """One uniform material, folded."""
    b, p = brdf_of(name), parameters(name, 1)
    wi, wo = twin.pairs(N, seed=1, min_cos=0.02)
    got = lanes.evaluate(b, wi, wo, p, b.evaluators(kind))
    np.testing.assert_allclose(got, expected(name, wi, wo, p), rtol=VALUE)


@pytest.mark.parametrize("name", ["abc", "ashikhmin_shirley", "cook_torrance", "ward", "ggx2 lobes"])
def test_renders_with_finite_gradients(llvm, name):
    p = parameters(name, 1, seed=8, usual={**USUAL, "B": (3, 100), "latent": (0, 1), "norm": (-1, 1)})
    image, attached, keys = render_attached(Material(brdf_of(name), given(p)))
    assert np.isfinite(np.array(image)).all() and np.array(image).max() > 0.01
    dr.backward(dr.mean(dr.square(image), axis=None))
    for key in keys:
        gradient = np.array(dr.grad(attached[key]))
        assert np.isfinite(gradient).all() and np.abs(gradient).max() > 0, key
