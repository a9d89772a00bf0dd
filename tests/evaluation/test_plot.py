"""Figures of a BRDF: their numbers are right, and every kind of input gives a picture."""

from __future__ import annotations

import json

import mi_enhance as me  # before mitsuba

import mitsuba as mi  # isort: skip
import numpy as np
import pytest

from mi_enhance import Material, data
from mi_enhance.cli.main import main
from mi_enhance.data.directions import sample_pairs
from mi_enhance.evaluation.lobe_curves import INCIDENCES, curves_of
from mi_enhance.evaluation.plot_picture import draw

MERL = "mi_enhance/bundled/nbrdf/merl.npz"


def grey(wi, wo):
    return np.full((len(wi), 3), [0.3, 0.2, 0.1]) / np.pi


def test_albedo_of_a_diffuse_surface_is_its_colour():
    np.testing.assert_allclose(curves_of(grey).albedo, np.broadcast_to([0.3, 0.2, 0.1], (18, 3)), rtol=5e-3)


def test_albedo_of_a_sharp_lobe_is_that_of_sampling(llvm):
    """A highlight of half a degree, which a sum over directions would miss."""
    m = Material.analytic("ggx").edit(alpha_x=0.01, alpha_y=0.01, rho_d=0, rho_s=1)
    bsdf = m.bsdf()
    curves = curves_of(m.evaluate)
    rng = np.random.default_rng(0)
    for k in (0, 9):
        si = mi.SurfaceInteraction3f()
        t = np.deg2rad(curves.albedo_angles[k])
        si.wi = mi.Vector3f(float(np.sin(t)), 0, float(np.cos(t)))
        u = mi.Point2f(rng.random((2, 20_000)))
        _, weight = bsdf.sample(mi.BSDFContext(), si, mi.Float(rng.random(20_000)), u)
        np.testing.assert_allclose(curves.albedo[k], np.array(weight).mean(1), rtol=0.02)  # 1 %: noise of the samples


def test_curves_have_their_peak_at_the_mirror(llvm):
    curves = curves_of(Material.analytic("ggx").edit(alpha_x=0.02, alpha_y=0.02).evaluate)
    for theta, angles, values in zip(INCIDENCES, curves.angles, curves.plane, strict=True):
        assert abs(angles[np.argmax(values)] - theta) < 0.5  # degrees
    assert np.argmax(curves.slice[10].mean(-1)) == 0  # theta_h


def test_slices_are_of_reflectance_with_the_cosine():
    """theta_h = theta_d = 0: both along the normal."""
    np.testing.assert_allclose(curves_of(grey).slice[0, 0], np.log1p(np.array([0.3, 0.2, 0.1]) / np.pi), rtol=1e-6)


@pytest.mark.slow
def test_material_ancestor_and_measurements_in_one_picture(llvm, tmp_path):
    wi, wo = sample_pairs(500, seed=0)
    m = data.Measurements(wi, wo, grey(wi, wo), "grey")
    material = Material.pretrained("ggx")
    picture = me.plot(material, m, path=tmp_path / "plot.png")
    assert picture.size == (1650, 1265) and np.array(picture)[..., :3].std() > 20
    assert np.array_equal(np.array(picture), np.array(mi.Bitmap(str(tmp_path / "plot.png"))))


@pytest.mark.parametrize("n_measured, n", [(0, 1), (3, 5)])
def test_every_number_of_curves_is_drawn(tmp_path, n_measured, n):
    curves = curves_of(grey)
    draw({str(k): curves for k in range(n)}, n_measured, tmp_path / "x.png", title="grey")
    assert (tmp_path / "x.png").stat().st_size > 20_000


def test_command(llvm, tmp_path, capsys):
    Material.analytic("ggx").save(tmp_path / "m.bsdf")
    output = tmp_path / "new" / "plot.png"
    command = ["plot", str(tmp_path / "m.bsdf"), MERL, "--material", "blue-acrylic", "-o", str(output), "--json"]
    assert main([*command, "--set", "rho_d=0.1,0.2,0.3"]) == 0
    assert json.loads(capsys.readouterr().out.splitlines()[-1]) == {"output": str(output)}
    assert output.exists()
    assert main(["plot", str(tmp_path / "m.bsdf"), "-o", str(tmp_path / "plot.jpg")]) == 2
    assert "must end in .png" in capsys.readouterr().err
