"""Materials that read out a shared trunk: constants of their function, or data."""

import dataclasses

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from mi_enhance import Material


def _material(seed: int) -> Material:
    material = Material.pretrained()
    read_out = np.random.default_rng(seed).normal(0, 0.05, material.brdf.trunk.size)
    return dataclasses.replace(material, params={**material.params, "read_out": read_out})


def _scene(materials):
    spheres = {
        f"s{k}": {"type": "sphere", "center": [2.2 * k, 0, 0], "bsdf": {**m.to_dict(), "id": f"m{k}"}}
        for k, m in enumerate(materials)
    }
    to_world = mi.ScalarTransform4f().look_at([len(spheres), -30, 5], [len(spheres), 0, 0], [0, 0, 1])
    film = {"type": "hdrfilm", "width": 64, "height": 16, "rfilter": {"type": "box"}}
    sensor = {"type": "perspective", "fov": 40, "to_world": to_world, "film": film}
    light = {"type": "point", "position": [10, -20, 20], "intensity": 1e3}
    scene = {"type": "scene", "integrator": {"type": "direct"}, "sensor": sensor, "light": light, **spheres}
    return mi.load_dict(scene, optimize=False)


def test_constants_and_data_render_alike(llvm):
    """Of many living materials some have their read-outs as constants, the rest as data; 1e-4: fused or not."""
    scene = _scene([_material(1)] * 12)
    literal = [bool(s.bsdf().m_parameters.literal) for s in scene.shapes()]
    assert any(literal) and not all(literal)
    up, light = mi.Vector3f(0.6, 0, 0.8), mi.Vector3f(-0.48, 0.36, 0.8)
    si = dr.zeros(mi.SurfaceInteraction3f)
    si.wi = up
    values = [np.ravel(s.bsdf().eval(mi.BSDFContext(), si, light)) for s in scene.shapes()]
    np.testing.assert_allclose(values, [values[0]] * 12, rtol=1e-4)


@pytest.mark.parametrize("freeze", [False, True])
def test_a_change_is_rendered(llvm, freeze):
    """What stands in the compiled function must not outlive the numbers it came from, in frozen functions neither."""
    scene = _scene([_material(1)])
    params = mi.traverse(scene)
    (key,) = [k for k in params.keys() if k.endswith("read_out")]
    render = lambda scene: mi.render(scene, spp=4, seed=0)  # noqa: E731
    render = dr.freeze(render) if freeze else render
    before = [np.array(render(scene)) for _ in range(2)]
    params[key] = mi.Float(_material(2).params["read_out"].tolist())
    params.update()
    expected = np.array(mi.render(_scene([_material(2)]), spp=4, seed=0))
    after = [np.array(render(scene)) for _ in range(2)]
    np.testing.assert_allclose(after, [expected] * 2, rtol=1e-4, atol=1e-6)
    assert np.abs(after[0] - before[0]).max() > 0.01
