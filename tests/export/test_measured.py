"""Measured files: what is written is what was meant, for our readers, for Mitsuba alone, and for a reader of others."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import mitsuba as mi
import numpy as np
import pytest

from mi_enhance import Material, data
from mi_enhance.cli.main import main
from mi_enhance.data import functions, rgl_table
from mi_enhance.data.directions import sample_pairs
from mi_enhance.data.measurements import Measurements, split
from mi_enhance.data.scattered import interpolated
from mi_enhance.evaluation.reflectance import reflectance
from mi_enhance.export.measured import write_binary, write_bsdf
from mi_enhance.fitting.losses import log_l1

ROOT = Path(__file__).resolve().parents[2]
RGL = ROOT / "mi_enhance/bundled/rgl/satin_rosaline_rgb.bsdf"
MERL = ROOT / "mi_enhance/bundled/nbrdf/merl.npz"
ISOTROPIC = {"alpha_x": 0.1, "alpha_y": 0.1, "rho_d": (0.3, 0.1, 0.05)}
STRETCHED = {"alpha_x": 0.1, "alpha_y": 0.3, "rho_d": 0.1}
TURNED = {**STRETCHED, "t_theta": 0.4}
TILTED = {**STRETCHED, "n_x": 0.1, "n_y": 0.05}
# log-L1; a good fit of a measured material has 0.01. Below 80 degrees; above, where 1/cos grows, up to ten times that.
TABULATED = 1.5e-3


def ggx(**values):
    return Material.analytic("ggx").edit(**values)


def error(f, g, n=5000):
    """log-L1 of two functions where both directions are within 80 degrees of the normal."""
    wi, wo = sample_pairs(n, seed=5)
    low = np.minimum(wi[:, 2], wo[:, 2]) > np.cos(np.deg2rad(80))
    a, b = (np.asarray(h(wi[low], wo[low]), np.float64) for h in (f, g))
    return log_l1(a, b, wo[low, 2].astype(np.float64))


def measured(path):
    bsdf = mi.load_dict({"type": "measured", "filename": str(path)})
    return lambda wi, wo: reflectance(bsdf, wi, wo)


@pytest.mark.parametrize(
    "values, symmetry",
    [(ISOTROPIC, "isotropic"), (STRETCHED, "quarter"), (TURNED, "half"), (TILTED, "full")],
    ids=["isotropic", "stretched", "turned", "tilted"],
)
def test_rgl_file_is_the_material_within_its_error(llvm, tmp_path, values, symmetry):
    m = ggx(**values)
    assert rgl_table.symmetry_of(m.evaluate) == symmetry
    path = tmp_path / "x.bsdf"
    facts = write_bsdf(m, path)
    assert facts["symmetry"] == symmetry and facts["bytes"] == path.stat().st_size
    assert error(measured(path), m.evaluate) == pytest.approx(facts["log_l1_below_80"], rel=0.3)
    assert facts["log_l1_below_80"] < TABULATED and facts["log_l1"] < 10 * TABULATED
    assert error(functions.function_of(path), m.evaluate) < TABULATED  # our reader


def test_a_material_that_is_nearly_isotropic_is_written_as_the_mean_of_its_azimuths(llvm, tmp_path):
    m = ggx(**ISOTROPIC).edit(n_x=0.002)
    assert functions.asymmetry(m.evaluate) > 1e-5
    assert write_bsdf(m, tmp_path / "x.bsdf")["symmetry"] == "isotropic"


@pytest.mark.parametrize(
    "values",
    [{"rho_d": 0, "rho_s": 0}, {"rho_d": 0, "alpha_x": 1e-4, "alpha_y": 1e-4}, {"alpha_x": 1e-3, "alpha_y": 1.0}],
    ids=["black", "mirror", "hair"],
)
def test_extremes_are_files_that_can_be_read_and_sampled(llvm, tmp_path, values):
    path = tmp_path / "x.bsdf"
    facts = write_bsdf(ggx(**values), path)
    assert np.isfinite(facts["log_l1"])
    assert data.load(path, n_samples=500).clamped_fraction == 0  # our reader checks every number
    si = mi.SurfaceInteraction3f()
    si.wi = mi.Vector3f(0.6, 0, 0.8)
    u = np.random.default_rng(0).random((3, 2000))
    bsdf = mi.load_dict({"type": "measured", "filename": str(path)})
    bs, weight = bsdf.sample(mi.BSDFContext(), si, mi.Float(u[0]), mi.Point2f(u[1:]))
    assert np.isfinite(np.array(weight)).all() and (np.array(bs.pdf) >= 0).all() and np.array(bs.pdf).max() > 0


def test_stock_mitsuba_samples_the_file_as_it_says(llvm, tmp_path):
    """Weight times density is the value, and the mean weight the albedo."""
    m = ggx(**ISOTROPIC)
    write_bsdf(m, tmp_path / "x.bsdf")
    bsdf = mi.load_dict({"type": "measured", "filename": str(tmp_path / "x.bsdf")})
    n = 100_000
    rng = np.random.default_rng(0)
    si = mi.SurfaceInteraction3f()
    si.wi = mi.Vector3f(0.6, 0, 0.8)
    bs, weight = bsdf.sample(mi.BSDFContext(), si, mi.Float(rng.random(n)), mi.Point2f(rng.random((2, n))))
    wi = np.broadcast_to([0.6, 0, 0.8], (n, 3)).astype(np.float32)
    wo, weight, pdf = np.array(bs.wo).T, np.array(weight).T, np.array(bs.pdf)
    above = wo[:, 2] > 0.01
    value = m.evaluate(wi[above], wo[above]) * wo[above, 2:]
    # the tables as they are: 5 % of a pair on average
    assert np.mean(np.abs(weight[above] * pdf[above, None] - value)) < 0.05 * value.mean()
    u = rng.random((2, n))
    cos, sin = np.sqrt(u[0]), np.sqrt(1 - u[0])
    even = np.stack((sin * np.cos(2 * np.pi * u[1]), sin * np.sin(2 * np.pi * u[1]), cos), 1)
    albedo = np.pi * m.evaluate(wi, even.astype(np.float32)).mean(0)
    np.testing.assert_allclose(weight.mean(0), albedo, rtol=0.03)  # 1 % is noise of the quadrature
    assert above.mean() > 0.9 and (weight.std(0) < 0.5 * weight.mean(0)).all()  # colours differ, one density


@pytest.mark.slow
def test_spectra_of_a_grey_material_are_grey(llvm, tmp_path):
    """What pbrt-v4 needs: `spectra` over `wavelengths`, no fold of azimuths; read by Mitsuba's spectral variant."""
    m = ggx(**{**STRETCHED, "rho_d": 0.1})
    facts = write_bsdf(m, tmp_path / "x.bsdf", spectral=True)
    wi, wo = sample_pairs(500, seed=3)
    expected = (m.evaluate(wi, wo) * wo[:, 2:])[:, 0]
    assert facts["symmetry"] == "full" and facts["log_l1_below_80"] < TABULATED
    if "llvm_ad_spectral" not in mi.variants():
        pytest.skip("this Mitsuba has no spectral variant with LLVM")
    mi.set_variant("llvm_ad_spectral")
    bsdf = mi.load_dict({"type": "measured", "filename": str(tmp_path / "x.bsdf")})
    si = mi.SurfaceInteraction3f()
    si.wi, si.wavelengths = mi.Vector3f(wi.T), mi.Spectrum(400.0, 500.0, 600.0, 700.0)
    f = np.array(bsdf.eval(mi.BSDFContext(), si, mi.Vector3f(wo.T)))
    np.testing.assert_allclose(f, np.broadcast_to(f[0], f.shape), rtol=1e-4)
    assert np.mean(np.abs(np.log1p(f[0]) - np.log1p(expected))) < 10 * TABULATED


def test_a_process_without_this_package_renders_the_same(llvm, tmp_path):
    m = ggx(**ISOTROPIC)
    m_file, image = tmp_path / "x.bsdf", tmp_path / "image.npy"
    write_bsdf(m, m_file)
    code = f"""
import os, sys
import mitsuba as mi, numpy as np
mi.set_variant("llvm_ad_rgb")
scene = mi.load_dict({{"type": "scene", "integrator": {{"type": "direct"}},
    "sensor": {{"type": "perspective", "to_world": mi.ScalarTransform4f().look_at([0, 0, 4], [0, 0, 0], [0, 1, 0]),
        "film": {{"type": "hdrfilm", "width": 32, "height": 32, "rfilter": {{"type": "box"}}}}}},
    "light": {{"type": "constant"}}, "lamp": {{"type": "point", "position": [3, 3, 5], "intensity": 30.0}},
    "ball": {{"type": "sphere", "bsdf": {{"type": "measured", "filename": {str(m_file)!r}}}}}}})
assert "mi_enhance" not in sys.modules
np.save({str(image)!r}, np.array(mi.render(scene, spp=256)))
"""
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60)
    scene = mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "direct"},
            "sensor": {
                "type": "perspective",
                "to_world": mi.ScalarTransform4f().look_at([0, 0, 4], [0, 0, 0], [0, 1, 0]),
                "film": {"type": "hdrfilm", "width": 32, "height": 32, "rfilter": {"type": "box"}},
            },
            "light": {"type": "constant"},
            "lamp": {"type": "point", "position": [3, 3, 5], "intensity": 30.0},
            "ball": {"type": "sphere", "bsdf": m.bsdf()},
        }
    )
    ours, stock = np.array(mi.render(scene, spp=256)), np.load(image)
    assert abs(stock.mean() / ours.mean() - 1) < 0.005
    assert np.mean(np.abs(stock - ours)) < 0.02 * ours.mean()  # mostly noise: two renders of one file differ by half


def merl_by_hand(path, wi, wo):
    """Nearest cell, from the description that MERL's own program gives of its file; float64."""
    raw = np.fromfile(path, "<f8", offset=12).reshape(3, 90, 90, 180)
    h = wi + wo
    h /= np.linalg.norm(h, axis=1, keepdims=True)
    theta_h, phi_h = np.arccos(h[:, 2]), np.arctan2(h[:, 1], h[:, 0])
    x = np.cos(-phi_h) * wo[:, 0] - np.sin(-phi_h) * wo[:, 1]
    y = np.sin(-phi_h) * wo[:, 0] + np.cos(-phi_h) * wo[:, 1]
    x, z = np.cos(-theta_h) * x + np.sin(-theta_h) * wo[:, 2], -np.sin(-theta_h) * x + np.cos(-theta_h) * wo[:, 2]
    theta_d, phi_d = np.arccos(np.clip(z, -1, 1)), np.mod(np.arctan2(y, x), np.pi)
    cell = [np.sqrt(theta_h / (np.pi / 2)) * 90, theta_d / (np.pi / 2) * 90, phi_d / np.pi * 180]
    i, j, k = (np.minimum(c.astype(int), n - 1) for c, n in zip(cell, (90, 90, 180), strict=True))
    return raw[:, i, j, k].T * np.array([1, 1.15, 1.66]) / 1500


def test_merl_file_is_the_material_for_ours_and_for_an_independent_reader(llvm, tmp_path):
    m = ggx(**ISOTROPIC)
    facts = write_binary(m, tmp_path / "x.binary")
    assert facts["bytes"] == 12 + 3 * 8 * 90 * 90 * 180
    assert facts["log_l1_below_80"] < TABULATED
    assert error(functions.function_of(tmp_path / "x.binary"), m.evaluate) < TABULATED
    # the nearest cell instead of the eight around: the steps of the table
    by_hand = error(lambda wi, wo: merl_by_hand(tmp_path / "x.binary", wi.astype(float), wo.astype(float)), m.evaluate)
    assert by_hand < 5 * TABULATED


@pytest.mark.slow
def test_what_merl_cannot_hold_is_averaged(llvm, tmp_path):
    m = ggx(**TURNED)
    facts = write_binary(m, tmp_path / "x.binary")
    mean = functions.isotropic(m.evaluate)
    assert functions.asymmetry(mean) < 0.1 * functions.asymmetry(m.evaluate)
    assert error(functions.function_of(tmp_path / "x.binary"), mean) < 2 * TABULATED < facts["log_l1_below_80"]


@pytest.mark.slow
def test_files_become_one_another(llvm, tmp_path, capsys):
    """RGL to MERL to RGL to a table and back."""
    facts = {}
    for source, target in ((RGL, "a.binary"), ("a.binary", "b.bsdf"), ("b.bsdf", "c.npz"), ("c.npz", "d.binary")):
        command = ["convert", str(tmp_path / source), "-o", str(tmp_path / target), "--samples", "2e4", "--json"]
        assert main(command) == 0
        facts[target] = json.loads(capsys.readouterr().out.splitlines()[-1])
    mean = functions.reciprocal(functions.function_of(RGL))  # the file is not reciprocal; a MERL file is
    assert facts["a.binary"]["log_l1"] < 1.2 * facts["a.binary"]["log_l1_of_average"]
    assert facts["b.bsdf"]["log_l1_below_80"] < TABULATED and facts["b.bsdf"]["symmetry"] == "isotropic"
    # b: both steps; c and d: 20,000 samples and what lies between them
    for name, most in (("a.binary", 2 * TABULATED), ("b.bsdf", 3 * TABULATED), ("c.npz", 0.01), ("d.binary", 0.01)):
        assert error(functions.function_of(tmp_path / name), mean) < most
    assert facts["d.binary"]["log_l1_between_samples"] < 0.02


def test_one_of_a_collection_is_converted(llvm, tmp_path):
    output = tmp_path / "x.bsdf"
    assert main(["convert", str(MERL), "--material", "blue-acrylic", "-o", str(output)]) == 0
    truth = functions.function_of(MERL, material="blue-acrylic")
    assert error(measured(output), truth) < 2 * TABULATED
    assert data.load(output, n_samples=10).name == "x"


def test_samples_of_a_table_are_passed_through(llvm):
    """Where it was measured an interpolation gives what was measured, elsewhere something between."""
    m = data.load(MERL, material="green-latex", n_samples=20_000)
    known, aside = split(m, 2000)
    f = interpolated(known)
    cos = known.wo[:2000, 2].astype(np.float64)
    at = log_l1(f(known.wi[:2000], known.wo[:2000]), known.f[:2000].astype(np.float64), cos)
    between = log_l1(f(aside.wi, aside.wo), aside.f.astype(np.float64), aside.wo[:, 2].astype(np.float64))
    assert at < between < 5e-3
    with pytest.raises(ValueError, match="has 3 samples; at least 4"):
        interpolated(Measurements(m.wi[:3], m.wo[:3], m.f[:3], "few"))


def test_a_failed_export_leaves_the_old_file(llvm, tmp_path):
    path = tmp_path / "x.bsdf"
    path.write_text("old")
    with pytest.raises(ValueError, match="not finite"):
        rgl_table.write_rgl(path, lambda wi, wo: np.full((len(wi), 3), np.nan))
    assert path.read_text() == "old" and list(tmp_path.iterdir()) == [path]


def test_a_table_of_few_rows_is_refused(tmp_path):
    (tmp_path / "t.csv").write_text("theta_i,phi_i,theta_o,phi_o,f\n" + "0.1,0,0.2,0,1\n" * 4)
    with pytest.raises(ValueError, match=r"t\.csv\"\): the table has 4 rows above the horizon; at least 5 are needed"):
        write_binary(tmp_path / "t.csv", tmp_path / "x.binary")


def test_own_materials_are_refused_by_convert_and_written_by_export(llvm, tmp_path, capsys):
    own = tmp_path / "own.bsdf"
    ggx(**ISOTROPIC).save(own)
    assert main(["convert", str(own), "-o", str(tmp_path / "x.binary")]) == 2
    assert "is a material of mi_enhance, not a measurement" in capsys.readouterr().err
    assert main(["export", str(own), "-o", str(tmp_path / "x.csv"), "-D", "samples=50"]) == 0
    assert len(data.load(tmp_path / "x.csv").f) == 50
