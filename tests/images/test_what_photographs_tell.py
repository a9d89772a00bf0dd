"""What photographs tell: standard deviations that hold, numbers without effect left open, a prior that keeps those."""

from __future__ import annotations

import dataclasses

import mitsuba as mi
import numpy as np
import pytest
from plugin_scenes import ball

from mi_enhance.images import image_loss, pictures, unknowns
from mi_enhance.images.cameras import around, render_views
from mi_enhance.images.descent import Descent
from mi_enhance.images.material_prior import MaterialPrior
from mi_enhance.images.scene_materials import find
from mi_enhance.images.survey import survey
from mi_enhance.images.uncertainty import of_fit
from mi_enhance.material.material import Material

PAINT = Material.analytic("ggx").edit(rho_d=(0.4, 0.2, 0.1), rho_s=0.5, alpha_x=0.3, alpha_y=0.3, F0=0.1)


def told(material, photographs, sought=None, seed=0):
    scene = ball(material.to_dict())
    found = unknowns.enhanced(scene, sought)
    placed = find(mi.traverse(scene))
    prior = MaterialPrior(placed, mi.traverse(scene), [u.key for u in found], 100)
    book = survey(photographs, [(1, 16, 1)], 1024, 0, seed)
    descent = Descent(scene, found, None, image_loss.Measure("log", book.scale), 2, seed)
    return of_fit(descent, placed, prior, book.looks[0], seed)


@pytest.fixture(scope="module")
def photographs():
    """With 5 % noise: what is left of them when the fit is right."""
    mi.set_variant("llvm_ad_rgb")
    views = around(2, target=(0, 0, 0), distance=5, fov=25, resolution=16)
    views = render_views(ball(PAINT.to_dict()), views, spp=256, max_depth=2)
    rng = np.random.default_rng(0)
    return [dataclasses.replace(v, image=(v.image * rng.normal(1, 0.05, v.image.shape)).astype("f4")) for v in views]


def test_photographs_tell_the_colour_and_not_the_turn_of_an_isotropic_highlight(photographs, tmp_path):
    found = told(PAINT, photographs)
    share = dict(zip(found.names, found.share, strict=True))
    assert share["rho_d.R"] < 0.05 and share["t_theta"] > 0.9 and share["rho_s.R"] < share["t_theta"]
    assert "Told by the photographs: rho_d" in found.words() and "t_theta" in found.words().partition("open")[2]
    (std,) = found.reflectance.values()
    assert std.shape == (24, 24) and np.isfinite(std).all() and std.min() >= 0
    assert std[:, -3:].mean() > std[:, :12].mean()  # grazing angles, against all others
    pictures.draw_uncertainty(found, tmp_path / "a.png")
    assert (tmp_path / "a.png").read_bytes()[:4] == b"\x89PNG"
    assert found.report()["numbers"]["F0"].keys() == {"std", "share"}


def test_more_photographs_tell_more_and_a_matte_material_no_roughness(photographs):
    one, both = (told(PAINT, views, ["rho_d", "alpha_x"]) for views in (photographs[:1], photographs))
    assert (both.std[:3] < one.std[:3]).all() and both.std[3] < 1.1 * one.std[3]  # of the roughness both tell little
    matte = told(PAINT.edit(rho_s=0.0), photographs, ["rho_d", "alpha_x"])
    assert dict(zip(matte.names, matte.share, strict=True))["alpha_x"] == pytest.approx(1, abs=0.01)


def test_prior_pulls_towards_the_training_materials_by_its_own_derivative(llvm):
    """Against differences; colours and frame stay free. Its weight is the loss over the pixels that are seen."""
    network = Material.pretrained("ggx2_small")
    scene = ball(network.to_dict())
    params = mi.traverse(scene)
    placed = find(params, {name: network for name in find(params)})
    (one,) = placed.values()
    free = [one.keys[name] for name in ("alpha_x", "latent", "rho_d")]
    prior = MaterialPrior(placed, params, free, 50)
    values = {key: np.array(params[key], np.float64).ravel() for key in free}
    gradient = prior.gradients(values, 0.1)
    assert not gradient[free[2]].any()
    assert np.abs(prior.gradients(values, 0.2)[free[0]]) == pytest.approx(np.abs(2 * gradient[free[0]]))
    (_, space, gaussian, vector) = prior._parts[0]

    def loss(key, k, step):
        moved = vector.copy()
        moved[prior._parts[0][0][key]] = values[key] + step * (np.arange(values[key].size) == k)
        return gaussian.loss(space.to_free(moved)[None])[0] * 0.1 / 50

    for key, k in ((free[0], 0), (free[1], 3)):
        difference = (loss(key, k, 1e-5) - loss(key, k, -1e-5)) / 2e-5
        assert gradient[key][k] == pytest.approx(difference, rel=1e-3, abs=1e-9)
