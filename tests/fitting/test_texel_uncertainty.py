"""What samples tell about texels: more where there are more, nothing where a parameter has no effect."""

from __future__ import annotations

import mitsuba as mi
import numpy as np
import pytest

from mi_enhance.data.directions import sample_pairs
from mi_enhance.data.measurements import Measurements
from mi_enhance.fitting.texel_uncertainty import draw, uncertainty_of_texels
from mi_enhance.fitting.uncertainty import determined
from mi_enhance.material.material import Material
from mi_enhance.material.material_maps import MaterialMaps

PAINT = Material.analytic("ggx").edit(rho_d=(0.4, 0.2, 0.1), rho_s=0.5, alpha_x=0.3, alpha_y=0.3)


@pytest.fixture(scope="module")
def surface():
    """Four texels: with and without a highlight, each with clean and with noisy samples."""
    mi.set_variant("llvm_ad_rgb")
    wi, wo = sample_pairs(64)
    rho_s = np.array([[[0.5] * 3, [0.0] * 3]] * 2)
    maps = MaterialMaps(PAINT, {"rho_s": rho_s})
    f = np.stack([[maps.at(y, x).evaluate(wi, wo) for x in range(2)] for y in range(2)])
    noise = np.random.default_rng(0).normal(1, 0.1, f.shape)
    return maps, wi, wo, (f * np.stack([np.ones_like(noise[0]), noise[1]])).astype(np.float32)


def test_what_samples_say_nothing_about_is_open(surface):
    maps, *samples = surface
    told = uncertainty_of_texels(maps, *samples)
    assert told["rho_d"].max() < 0.1 and told["alpha_x"][:, 0].max() < 0.3
    np.testing.assert_allclose(told["alpha_x"][:, 1], 1, atol=1e-3)  # no highlight, no roughness
    assert all(v.min() >= 0 and v.max() <= 1 for v in told.values())
    assert (told["rho_d"][1] > 3 * told["rho_d"][0]).all()  # noise of 10 %, against none


def test_a_texel_is_as_uncertain_as_a_material_of_the_same_samples(surface):
    """Both up to float32: `determined` adds up the samples in another order."""
    maps, wi, wo, f = surface
    told = uncertainty_of_texels(maps, wi, wo, f)
    cos = wo[:, 2:]
    error = float(np.abs(np.log1p(f[1, 0] * cos) - np.log1p(PAINT.evaluate(wi, wo) * cos)).mean())
    std, _ = determined(PAINT, Measurements(wi, wo, f[1, 0]), error)
    assert told["F0"][1, 0, 0] == pytest.approx(std["F0"][0] * np.sqrt(12), rel=0.01)


def test_samples_that_repeat_others_tell_nothing(surface):
    maps, *samples = surface
    counts = np.ones(samples[2].shape[:-1], bool)
    counts[:, :, 16:] = False
    all_of_them, few = (uncertainty_of_texels(maps, *samples, counts=c)["rho_d"] for c in (None, counts))
    np.testing.assert_allclose(few, 2 * all_of_them, rtol=0.1)  # a quarter of the samples
    with pytest.raises(ValueError, match="counts has shape"):
        uncertainty_of_texels(maps, *samples, counts=counts[..., :3])


def test_pictures_are_written(surface, tmp_path):
    maps, *samples = surface
    draw(uncertainty_of_texels(maps, *samples), tmp_path / "a.png")
    assert (tmp_path / "a.png").read_bytes()[:4] == b"\x89PNG"
