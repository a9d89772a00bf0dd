"""Error against run time: the rivals are what they say, times are those of one thing alone, results are whole."""

from __future__ import annotations

import json
from pathlib import Path

import mi_enhance as me  # before mitsuba

import mitsuba as mi  # isort: skip
import numpy as np
import pytest
from mi_enhance.bsdfs.function import function_bsdf

from mi_enhance import Material, data
from mi_enhance.benchmark import mitsuba_bsdfs, residual_network
from mi_enhance.benchmark.nbrdf import nbrdf_function
from mi_enhance.data import nbrdf
from mi_enhance.data.directions import sample_pairs
from mi_enhance.evaluation import scenes
from mi_enhance.evaluation.reflectance import reflectance
from mi_enhance.fitting.losses import log_l1

ROOT = Path(__file__).resolve().parents[2]
FILE = ROOT / "mi_enhance/bundled/rgl/satin_rosaline_rgb.bsdf"


def measurements(f, n=3000):
    wi, wo = sample_pairs(n, seed=0)
    return data.Measurements(wi, wo, f(wi, wo), "made up")


def test_nbrdf_in_drjit_is_the_reader_s(llvm):
    names, networks = nbrdf.read_networks(ROOT / "mi_enhance/bundled/nbrdf/merl.npz")
    network = {k: w[names.index("gold-metallic-paint")] for k, w in networks.items()}
    wi, wo = sample_pairs(2000, seed=1)
    ours = reflectance(function_bsdf(nbrdf_function(network, 1e4), Material.analytic("ggx")), wi, wo)
    np.testing.assert_allclose(ours, nbrdf.decode(network, wi, wo), rtol=2e-3, atol=1e-4)


@pytest.mark.slow
def test_a_residual_network_is_better_than_what_it_is_added_to(llvm):
    m = data.load(FILE, n_samples=6000)
    unseen = data.load(FILE, n_samples=3000, seed=1)
    lobe = me.fit(Material.analytic("ggx"), m)
    layers, _ = residual_network.train_residual(lobe, m)
    both = reflectance(function_bsdf(residual_network.residual_function(lobe, layers), lobe), unseen.wi, unseen.wo)
    alone = reflectance(lobe.bsdf(), unseen.wi, unseen.wo)
    errors = [log_l1(f, unseen.f, unseen.wo[:, 2]) for f in (both, alone)]
    assert (both >= 0).all() and errors[0] < 0.8 * errors[1]


def test_a_bsdf_of_mitsuba_is_found_again(llvm):
    truth = {"type": "roughconductor", "distribution": "ggx", "material": "none", "alpha": 0.23}
    truth["specular_reflectance"] = {"type": "rgb", "value": [0.7, 0.4, 0.2]}
    spec, _ = mitsuba_bsdfs.fit_mitsuba(
        "roughconductor", measurements(lambda wi, wo: reflectance(mi.load_dict(truth), wi, wo))
    )
    assert spec["alpha"] == pytest.approx(0.23, abs=2e-3)
    np.testing.assert_allclose(spec["specular_reflectance"]["value"], [0.7, 0.4, 0.2], atol=5e-3)


@pytest.mark.slow
def test_principled_fits_paint_better_than_a_conductor(llvm):
    m = data.load(FILE, n_samples=4000)
    errors = {}
    for plugin in mitsuba_bsdfs.MITSUBA:
        spec, _ = mitsuba_bsdfs.fit_mitsuba(plugin, m)
        errors[plugin] = log_l1(reflectance(mi.load_dict(spec), m.wi, m.wo), m.f, m.wo[:, 2])
    assert errors["principled"] < 0.5 * errors["roughconductor"]


def test_the_evaluators_can_be_chosen(llvm):
    wi, wo = sample_pairs(500, seed=0)
    spec = Material.pretrained("ggx").to_dict()
    values = [reflectance(mi.load_dict({**spec, "evaluators": kind}), wi, wo) for kind in ("baked", "cooperative")]
    np.testing.assert_allclose(*values, rtol=1e-3, atol=1e-5)
    with pytest.raises(Exception, match="baked, cooperative"):
        mi.load_dict({**spec, "evaluators": "fast"})


def test_spheres(llvm):
    grey = [{"type": "diffuse", "reflectance": {"type": "rgb", "value": v}} for v in (0.1, 0.5, 0.9)]
    image = np.array(mi.render(scenes.spheres(grey, resolution=32, spp=4)))
    assert np.isfinite(image).all() and image.std() > 0


@pytest.mark.slow
def test_specialized_of_a_given_size(llvm):
    m = me.specialize(Material.pretrained("ggx").edit(rho_s=0.5), size=4)
    assert m.brdf.distilled[0].sizes[1:-1] == (4, 4)
    with pytest.raises(ValueError, match="1 to 64"):
        me.specialize(Material.pretrained("ggx"), size=0)


def test_settings_of_another_run_are_refused(llvm, tmp_path):
    from mi_enhance.benchmark.benchmark import bench

    (tmp_path / "settings.json").write_text('{"samples": 7, "seed": 0}')
    with pytest.raises(ValueError, match="other settings"):
        bench([FILE], tmp_path, n_samples=1000)
    with pytest.raises(ValueError, match="other settings"):
        bench([FILE], tmp_path, model=Material.pretrained("ggx"))
    with pytest.raises(ValueError, match="has no networks. Give an enhanced model"):
        bench([FILE], tmp_path / "new", model=Material.analytic("ggx"))
    with pytest.raises(ValueError, match="all different"):
        bench([FILE, FILE], tmp_path)


def rows():
    base = {"error_ratio": 1.0, "fit_seconds": None, "multiply_adds": 0, "n_bytes": 48, "shared_bytes": 0}
    for label, loss, ns, ratio in (
        ("GGX <b>", 0.04, 7.0, 1.0),
        ("enhanced", 0.02, 40.0, 0.8),
        ("measured", 0, 9.0, 1.0),
    ):
        yield {"label": label, "log_l1": loss, "eval_ns": ns, "ball_ratio": ratio, **base}


def test_plot_and_page(tmp_path):
    from mi_enhance.benchmark.benchmark import COLUMNS, BenchReport
    from mi_enhance.benchmark.growth import GROWTH_COLUMNS
    from mi_enhance.benchmark.page import draw_pareto, write_page

    draw_pareto(list(rows()), tmp_path / "pareto.png", title="x")
    report = BenchReport({"cpu": "c"}, ["felt"], list(rows()), [], {})
    write_page(report, tmp_path / "index.html", COLUMNS, {k: GROWTH_COLUMNS[k] for k in ("what", "value")})
    text = (tmp_path / "index.html").read_text()
    assert "GGX &lt;b&gt;" in text and "felt/comparison.png" in text and "data:image/png;base64," in text


@pytest.mark.slow
@pytest.mark.parametrize("material", [None, "blue-acrylic"], ids=["rendered truth", "truth of samples only"])
def test_bench(llvm, tmp_path, material):
    from mi_enhance.cli.main import main

    source = [str(ROOT / "mi_enhance/bundled/nbrdf/merl.npz"), "--material", material] if material else [str(FILE)]
    assert main(["bench", *source, "-o", str(tmp_path), "--samples", "2000", "--resolution", "32", "--spp", "4"]) == 0
    result = json.loads((tmp_path / "bench.json").read_text())
    by_label = {row["label"]: row for row in result["rows"]}
    if material:
        assert "measured" not in by_label and not any("ssim" in row for row in result["rows"])
    else:
        assert by_label["measured"]["log_l1"] < 1e-4
    assert by_label["enhanced, exact"]["log_l1"] < by_label["GGX in Python"]["log_l1"]
    assert all(row["cold"] > 0 and row["ball"] > 0 for row in result["rows"])
    assert (tmp_path / "pareto.png").exists() and (tmp_path / "index.html").exists()
