"""Every registered model: its equation, grazing angles, fits and colours; tests/contract has the rest."""

from __future__ import annotations

from pathlib import Path

import lanes
import mitsuba as mi
import numpy as np
import pytest
import twin
from any_material import ROUGHNESSES, USUAL, given, materials, pairs
from plugin_scenes import ball

import mi_enhance  # noqa: F401  (before mitsuba)
from mi_enhance import data, enhance, models
from mi_enhance.analytic import parameters
from mi_enhance.data.directions import sample_pairs
from mi_enhance.fitting.analytic_fit import objective
from mi_enhance.fitting.fit import fit
from mi_enhance.material.material import Material

ROOT = Path(__file__).resolve().parents[2]

# Relative: 6e-8 in h is 1e-4 in a Gaussian of 20 roughnesses, and in (1 - cos_theta_h)^C where that is 1e-5.
VALUE = 2e-4
DARK = 1e-9  # absolute: what such a Gaussian is there
RECOVERED = 1e-3  # log-L1 of a fit to samples of the model itself

NAMES = sorted(models.MODELS)
EQUATIONS = {
    "ggx": "M + S * D * F * G * 1/E",
    "ggx2": "M * B + S * D * F * G * 1/E + S2 * D2 * F2 * G2 * 1/E2",
    "ggx_retro": "M * B + S * D * F * G * 1/E + S2 * D_retro_ggx * F_retro_schlick * G2 * 1/E2",
    "cook_torrance": "M + S * D * F * G * 1/E",
    "ward": "M + S * D * 1/E",
    "abc": "M + S * D * F * G * 1/E",
    "ashikhmin_shirley": "M * B + S * D * F * 1/E",
}


@pytest.mark.parametrize("name", NAMES)
def test_prints_its_equation_and_names_what_it_reads(name):
    model = models.get(name)
    assert str(model) == EQUATIONS[name] and model.name == name
    directions = {"wi", "wo", "h", "cos_theta_i", "cos_theta_o", "cos_theta_h", "cos_theta_d"}
    read = {i for node in model.graph.walk() for i in node.inputs} - directions
    assert read == {p.name for p in model.parameters} - {"n_x", "n_y", "t_theta"}
    assert {p.name for p in model.parameters} >= {"rho_d"}  # what sampling and editing rely on


@pytest.mark.parametrize("name", NAMES)
def test_starts_are_within_the_ranges(name):
    model = models.get(name)
    assert 1 <= len(model.starts) <= 8
    for start in model.starts:
        parameters.check(model.parameters, {**parameters.initial(model.parameters), **start}, name)


@pytest.mark.parametrize("name", NAMES)
def test_values_at_extreme_angles_are_the_twins(llvm, name):
    """Wide lobes, whose value at a grazing or mirrored pair does not hang on the last bit of h."""
    brdf = enhance(name, ())
    frame = {"n_x": (0, 0), "n_y": (0, 0)}  # a tilt moves a cosine of 1e-4 by the rounding of the frame
    wide = {name: (0.3, 1) for name in ROUGHNESSES} | {"B": (1, 100), "n_u": (1, 20), "n_v": (1, 20)}
    p = materials(brdf.model, 6000, usual={**USUAL, **frame, **wide})
    wi, wo = pairs(6000)
    # 1e-3: a cosine of 1e-4 that passed through a frame has lost three of its digits
    np.testing.assert_allclose(lanes.evaluate(brdf, wi, wo, p), twin.analytic(name, wi, wo, p), rtol=1e-3, atol=DARK)


# --- fits -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", NAMES)
def test_fit_recovers_samples_of_the_model_itself(llvm, name, seed):
    model = models.get(name)
    flat = {
        "n_x": (-0.05, 0.05),
        "n_y": (-0.05, 0.05),
        "rho_d": (0, 0.5),
        "rho_s": (0.1, 2),
        "rho_s2": (0.1, 2),
        "C": (0.5, 2),
    }
    truth = given(materials(model, 1, seed + 20, {**USUAL, **flat}))
    wi, wo = sample_pairs(3000, seed=seed, min_cos=0.05)
    m = data.Measurements(wi, wo, twin.analytic(name, wi, wo, truth))
    fitted = fit(Material.analytic(name), m)
    assert fitted.report["log_l1"] < RECOVERED
    assert fitted.report["model"] == EQUATIONS[name] and np.isfinite(fitted.lobe_albedo)


PUBLISHED = {  # Low et al. 2012, as in dj_brdf (public domain): rho_d, A, B, C, ior
    "aventurnine": ((0.052933, 0.060724, 0.052465), (1835.5913, 1594.7158, 1585.084), 324913.375, 1.110341, 1.403899),
    "black-oxidized-steel": (
        (0.012978, 0.011743, 0.011219),
        (1.100971, 1.057305, 1.015528),
        30.661,
        1.869546,
        1.660413,
    ),
    "chrome": ((0.002692, 0.00252, 0.003088), (986.846741, 771.035522, 696.134583), 64661.258, 1.90542, 99.999413),
    "red-fabric2": ((0.116616, 0.012705, 0.002205), (0.586502, 0.141217, 0.134042), 8092575.0, 0.084146, 1.976978),
}


@pytest.mark.parametrize("name", PUBLISHED)
def test_abc_fits_measured_materials_at_least_as_well_as_published(llvm, name):
    m = data.load(ROOT / "mi_enhance/bundled/nps/merl.npz", material=name, n_samples=4000)
    material = Material.analytic("abc")
    published = material.edit(**dict(zip(("rho_d", "A", "B", "C", "ior"), PUBLISHED[name], strict=True)))
    problem = objective(material.brdf, m)
    loss = problem.loss(problem.space.to_free(published.as_vector())[None])[0]
    assert fit(material, m).report["log_l1"] <= loss


# --- variants and networks ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("variant", ["llvm_ad_spectral", "llvm_ad_mono"])
def test_colour_of_the_abc_lobe_is_one_in_every_variant(llvm, variant):
    """Above 1, where a reflectance could not be upsampled as it is; under white light."""
    if variant not in mi.variants():
        pytest.skip(f"{variant} is not part of this Mitsuba")
    given = Material.analytic("abc").edit(A=(30.0, 10.0, 5.0), B=300.0, rho_d=0.1).to_dict()
    images = []
    for name in ("llvm_ad_rgb", variant):
        mi.set_variant(name)
        image = np.array(mi.render(ball(given, emitter={"type": "constant"}), spp=256))
        images.append(image if image.shape[-1] == 1 else image @ np.array([[0.2126], [0.7152], [0.0722]]))
    ball_only = (slice(5, 11), slice(5, 11))
    np.testing.assert_allclose(images[1][ball_only].mean(), images[0][ball_only].mean(), rtol=0.05)  # noise, spectra


@pytest.mark.parametrize("name, missing", [("ward", "F0"), ("abc", "F0, alpha_x, alpha_y, rho_s")])
def test_networks_that_would_read_what_is_not_there_are_refused(name, missing):
    with pytest.raises(
        ValueError, match=rf'modules read {missing}, which model "{name}" does not have. Use inputs="shape", or the'
    ):
        enhance(name, ["1/E"])


def test_networks_of_cook_torrance_are_those_of_ggx(llvm):
    """The same 12 parameters, so the same inputs."""
    brdf = enhance("cook_torrance", ["F", "G"], hidden=(4,))
    assert str(brdf) == "M + S * D * [F] * [G] * 1/E" and brdf.n_parameters == 39
    wi, wo = twin.pairs(100)
    p = {**materials(brdf.model, 100), "latent": np.full((100, 27), 0.5)}
    assert np.isfinite(lanes.evaluate(brdf, wi, wo, p)).all()
