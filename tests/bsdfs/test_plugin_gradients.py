"""Gradients through the plugin: those of ``prb`` against differences of renders, for every parameter; optimization."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from plugin_scenes import VALUES, bitmap, material, scene

from mi_enhance.material.material import Material

PRB = {"type": "prb", "max_depth": 2, "hide_emitters": True}
# Differences of two renders see the sampling change too, which `prb` rightly leaves out: noise of 500,000 paths.
MANY, FEW = 2048, 64  # samples per pixel
NOISE = 0.03
SMALL = 2e-3  # of the brightness: a derivative below it drowns in that noise
STEPS = {"n_x": 0.02, "n_y": 0.02, "t_theta": 0.05, "alpha_x": 0.02, "alpha_y": 0.02, "latent": 0.05}  # others: 0.03
ENTRIES = {"latent": (0, 9, 26)}  # others: all
KEYS = [f"m.{name}" for name in VALUES]


def start(**values):
    """The normal is not tilted: a tilted one has a horizon of its own, and `prb` does not follow edges that move."""
    return material(n_x=0.0, n_y=0.0, **values)


@pytest.fixture
def quad(llvm):
    """A rectangle in one-sided light: its parameters, and a function that renders its (weighted) brightness."""
    return _quad(start().to_dict())


def _quad(bsdf):
    s = scene({"m": bsdf, "quad": {"type": "rectangle", "bsdf": {"type": "ref", "id": "m"}}}, integrator=PRB)
    p = mi.traverse(s)
    # Each pixel another weight: what is opposite left and right does not cancel.
    weight = mi.TensorXf(np.linspace(0.5, 1.5, 16 * 16 * 3, dtype=np.float32).reshape(16, 16, 3))
    return p, lambda spp=FEW: dr.mean(weight * mi.render(s, p, seed=1, spp=spp), axis=None)


def _numbers(p, key):
    return np.array(p[key], np.float64)


def _put(p, key, values):
    p[key] = type(p[key])(np.asarray(values, np.float32))
    p.update()


def _differences(p, brightness, key, step, entries):
    """Central differences for some entries of a parameter."""
    before, result = _numbers(p, key), []
    for k in entries:
        sides = []
        for sign in (1, -1):
            moved = before.copy()
            moved.reshape(-1)[k] += sign * step
            _put(p, key, moved)
            sides.append(float(brightness(MANY).array[0]))
        result.append((sides[0] - sides[1]) / (2 * step))
    _put(p, key, before)
    return np.array(result)


def _gradients(p, brightness, keys, spp=FEW, update=True):
    for key in keys:
        dr.enable_grad(p[key])
        if update:
            p[key] = p[key]
    if update:
        p.update()
    dr.backward(brightness(spp))
    return {key: np.array(dr.grad(p[key]), np.float64).ravel() for key in keys}


def _check(gradient, differences, brightness):
    scale = np.abs(differences).max() + SMALL / NOISE * float(brightness().array[0])
    np.testing.assert_allclose(gradient, differences, atol=NOISE * scale)


@pytest.mark.slow
def test_gradient_of_every_parameter_is_that_of_the_render(quad):
    p, brightness = quad
    gradient = _gradients(p, brightness, KEYS, MANY)
    dr.disable_grad([p[key] for key in KEYS])
    for name, key in zip(VALUES, KEYS, strict=True):
        entries = ENTRIES.get(name, range(np.size(VALUES[name])))
        differences = _differences(p, brightness, key, STEPS.get(name, 0.03), entries)
        _check(gradient[key][list(entries)], differences, brightness)
        assert np.abs(gradient[key]).max() > 0


def test_gradients_need_no_update_and_do_not_wear_off(quad):
    """Switched on after the last update, asked for twice: always the same."""
    p, brightness = quad
    expected = _gradients(p, brightness, KEYS)
    for key in KEYS:
        dr.disable_grad(p[key])
        p[key] = p[key]
    p.update()
    for _ in range(2):
        gradient = _gradients(p, brightness, KEYS, update=False)
        for key in KEYS:
            np.testing.assert_allclose(gradient[key], expected[key], rtol=1e-3, atol=1e-5)
            dr.set_grad(p[key], 0)


def test_gradients_of_some_do_not_lean_on_those_of_others(quad):
    """One parameter had gradients at the last update, another has them now."""
    p, brightness = quad
    expected = _gradients(p, brightness, KEYS)
    dr.disable_grad([p[key] for key in KEYS])
    _gradients(p, brightness, ["m.rho_d"])
    dr.disable_grad(p["m.rho_d"])
    gradient = _gradients(p, brightness, ["m.F0"], update=False)
    np.testing.assert_allclose(gradient["m.F0"], expected["m.F0"], rtol=1e-3)


def test_gradients_reach_what_a_parameter_is_computed_from(quad):
    p, brightness = quad
    values = {key: _numbers(p, key).ravel() for key in KEYS}
    expected = _gradients(p, brightness, KEYS)
    x = mi.Float(1.0)
    dr.enable_grad(x)
    for key in KEYS:
        p[key] = dr.detach(p[key]) * x
    p.update()
    dr.backward(brightness())
    np.testing.assert_allclose(dr.grad(x).numpy(), sum(values[key] @ expected[key] for key in KEYS), rtol=1e-3)


@pytest.mark.parametrize("zero", [("A",), ("rho_d",), ("A", "rho_d")])
@pytest.mark.parametrize("bound_energy", [False, True])
def test_colours_that_are_zero_take_their_lobes_along(llvm, zero, bound_energy):
    m = Material.analytic("abc")
    bsdf = (m.bounded() if bound_energy else m).bsdf()
    p = mi.traverse(bsdf)
    for name in zero:
        p[name] = mi.Color3f(0)
    p.update()
    si, ctx = dr.zeros(mi.SurfaceInteraction3f), mi.BSDFContext()
    si.wi, wo = mi.Vector3f(0.6, 0, 0.8), mi.Vector3f(0, 0.6, 0.8)
    expected = m.edit(**{name: 1e-6 if name == "A" else 0.0 for name in zero}).evaluate(
        [[0.6, 0, 0.8]], [[0, 0.6, 0.8]]
    )
    value, pdf = bsdf.eval_pdf(ctx, si, wo)
    np.testing.assert_allclose(np.array(value).ravel(), 0.8 * expected[0], rtol=1e-3, atol=1e-5)
    assert pdf[0] > 0
    bs, weight = bsdf.sample(ctx, si, mi.Float(0.3), mi.Point2f(0.2, 0.3))
    assert bs.pdf[0] > 0 and np.isfinite(np.array(weight)).all()


def test_diffuse_reflectance_has_a_gradient_of_every_parameter(llvm):
    bsdf = Material.analytic("ggx").bsdf()
    p = mi.traverse(bsdf)
    for name in ("rho_d", "rho_s", "F0"):
        dr.enable_grad(p[name])
    p.update()
    dr.backward(dr.sum(bsdf.eval_diffuse_reflectance(dr.zeros(mi.SurfaceInteraction3f)), axis=None))
    assert np.array(dr.grad(p["rho_d"])).ravel() == pytest.approx([1, 1, 1], abs=1e-6)
    assert not np.array(dr.grad(p["rho_s"])).any() and not np.array(dr.grad(p["F0"])).any()


def test_forward_mode_is_the_reverse_mode(quad):
    p, brightness = quad
    gradient = _gradients(p, brightness, KEYS)
    expected = sum(g.sum() for g in gradient.values())
    for key in KEYS:
        dr.set_grad(p[key], 1)
    value = brightness()
    dr.forward_to(value)
    np.testing.assert_allclose(dr.grad(value).numpy(), expected, rtol=1e-3)


@pytest.mark.slow
def test_gradients_of_textures_are_those_of_the_render(llvm):
    texels = {"rho_d": np.array([[[0.3, 0.2, 0.1], [0.5, 0.6, 0.2]], [[0.1, 0.4, 0.8], [0.7, 0.7, 0.6]]])}
    texels["alpha_x"] = np.array([[[0.2], [0.4]], [[0.5], [0.3]]])
    p, brightness = _quad({**start().to_dict(), **{name: bitmap(v) for name, v in texels.items()}})
    keys = [f"m.{name}.data" for name in texels] + ["m.latent", "m.F0"]
    gradient = _gradients(p, brightness, keys, MANY)
    dr.disable_grad([p[key] for key in keys])
    for key, entries in zip(keys, ((0, 4, 11), (0, 3), (9,), (0,)), strict=True):
        differences = _differences(p, brightness, key, STEPS["latent"] if key == "m.latent" else 0.03, entries)
        _check(gradient[key][list(entries)], differences, brightness)


@pytest.mark.slow
def test_optimizer_recovers_roughness_and_albedo_from_an_image(llvm):
    sought, first = {"alpha_x": 0.3, "rho_d": (0.3, 0.2, 0.1)}, {"alpha_x": 0.45, "rho_d": (0.5, 0.5, 0.5)}
    shipped = Material.pretrained("ggx").edit(rho_s=2.0, F0=0.5, alpha_y=0.3, **sought)
    shapes = {"m": shipped.to_dict(), "ball": {"type": "sphere", "bsdf": {"type": "ref", "id": "m"}}}
    lamp = {"type": "point", "position": [2.0, -3.0, 4.0], "intensity": 30.0}  # a highlight shows the roughness
    s = scene(shapes, integrator=PRB, emitter=lamp)
    p = mi.traverse(s)
    target = mi.render(s, spp=256, seed=99)
    optimizer = mi.ad.Adam(lr=0.06)
    for name, value in first.items():
        optimizer[f"m.{name}"] = type(p[f"m.{name}"])(value)
    p.update(optimizer)
    losses = []
    for k in range(40):
        loss = dr.mean(dr.square(mi.render(s, p, seed=k) - target), axis=None)
        dr.backward(loss)
        optimizer.set_learning_rate(0.08 * 0.92**k)
        optimizer.step()
        for key in optimizer.keys():
            optimizer[key] = dr.clip(optimizer[key], 0.02, 1)
        p.update(optimizer)
        losses.append(float(loss.array[0]))
    assert losses[9] < 0.5 * losses[0] and losses[-1] < 0.02 * losses[0]
    for name in sought:
        np.testing.assert_allclose(_numbers(p, f"m.{name}").ravel(), sought[name], atol=0.05)
