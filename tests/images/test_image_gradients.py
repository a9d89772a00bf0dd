"""Gradients of all parameters of a shipped network in a rendered scene, as fits to images use them."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from plugin_scenes import ball

from mi_enhance.analytic import parameters
from mi_enhance.images import targets, unknowns
from mi_enhance.images.cameras import around
from mi_enhance.images.scene_materials import get, put
from mi_enhance.material.material import Material
from mi_enhance.neural.enhance import enhance

MANY = 1024  # samples per pixel
# Both sides are noisy: a render sees its sampling change with the parameter, which `prb` leaves out, and float32
# adds up 262,144 paths. In units of the largest derivative of all components of the same parameter.
NOISE = 0.05
STEPS = {"t_theta": 0.05, "latent": 0.1, "asymmetry": 0.1}  # others: 0.03
# Light and views from all sides, no parameter at an end of its range or at a symmetric point.
VALUES = {
    "t_theta": 0.4, "rho_d": (0.3, 0.2, 0.1), "rho_s": (0.5, 0.8, 0.6), "alpha_x": 0.3, "alpha_y": 0.5, "F0": 0.2,
    "rho_s2": (0.3, 0.2, 0.4), "alpha_x2": 0.6, "alpha_y2": 0.4, "asymmetry": 0.1,
}  # fmt: skip


@pytest.mark.slow
def test_all_parameters_of_ggx2_against_differences_of_renders(llvm):
    """64 of its 69 numbers: three only scale others, and the tilt of the normal, which moves the horizon, is held."""
    shipped = Material.pretrained("ggx2")
    latent = np.asarray(shipped.library[5], np.float64)[18:66]
    scene = ball(
        {**shipped.edit(**VALUES, latent=latent).to_dict(), "id": "m"}, integrator={"type": "prb", "max_depth": 2}
    )
    params = mi.traverse(scene)
    (target,) = targets.targets(around(1, target=(0, 0, 0), distance=5, fov=25, resolution=16))
    # each pixel and channel another weight: what is opposite left and right does not cancel
    weight = mi.TensorXf(np.linspace(0.5, 1.5, 16 * 16 * 3, dtype=np.float32).reshape(16, 16, 3))

    def brightness(spp):
        return dr.mean(weight * mi.render(scene, params, sensor=target.sensor, spp=spp, seed=3), axis=None)

    sought = unknowns.enhanced(scene)
    assert sum(get(params, u.key).size for u in sought) == 64
    for u in sought:
        put(params, u.key, get(params, u.key))
        dr.enable_grad(params[u.key])
    params.update()
    dr.backward(brightness(MANY))
    gradients = {u.key: np.array(dr.grad(params[u.key]), np.float64).ravel() for u in sought}
    for u in sought:
        put(params, u.key, get(params, u.key))
    params.update()
    with dr.suspend_grad():
        level = float(brightness(MANY).array[0])
        for u in sought:
            name, before = u.parameter.name, get(params, u.key)
            step = STEPS.get(name, 0.03)
            differences = np.zeros_like(before)
            for k in range(before.size):
                sides = []
                for sign in (1, -1):
                    moved = before.copy()
                    moved[k] += sign * step
                    put(params, u.key, moved)
                    params.update()
                    sides.append(float(brightness(MANY).array[0]))
                differences[k] = (sides[0] - sides[1]) / (2 * step)
            put(params, u.key, before)
            # 2e-3 of the brightness: a derivative below it drowns in the noise of both renders
            allowed = NOISE * np.abs(differences).max() + 2e-3 * level
            np.testing.assert_allclose(gradients[u.key], differences, atol=allowed, err_msg=name)
            assert np.abs(gradients[u.key]).max() > 0, name


def test_gradients_that_arrive_at_what_is_folded_are_those_of_the_parameters(llvm):
    """The same paths; float32 adds them up in another order."""
    network = enhance("ggx", ("F", "G"), hidden=(4, 4), seed=3)
    scene = ball(
        {**Material(network, parameters.initial(network.parameters)).to_dict(), "id": "m"},
        integrator={"type": "prb", "max_depth": 2},
    )
    params, prb = mi.traverse(scene), scene.integrator()
    (target,) = targets.targets(around(1, target=(0, 0, 0), distance=5, fov=25, resolution=8))
    (bsdf,) = (node for node in params.hierarchy if hasattr(node, "set_folded_apart"))
    found = []
    for is_apart in (False, True):
        for u in unknowns.enhanced(scene):
            put(params, u.key, get(params, u.key))
            dr.enable_grad(params[u.key])
        params.update()
        if is_apart:
            assert bsdf.set_folded_apart() is not None
        prb.render_backward(scene, params, dr.full(mi.TensorXf, 1.0, (8, 8, 3)), target.sensor, seed=1, spp=16)
        bsdf.hand_on_gradients()
        found.append({u.key: np.array(dr.grad(params[u.key])) for u in unknowns.enhanced(scene)})
    for key, expected in found[0].items():
        np.testing.assert_allclose(found[1][key], expected, atol=1e-4 * np.abs(expected).max() + 1e-9, err_msg=key)
    assert max(np.abs(g).max() for key, g in found[1].items() if key.endswith("latent")) > 0
