"""The figures of the paper: each command draws its picture, from fits that are kept."""

from __future__ import annotations

import json
from pathlib import Path

import mi_enhance as me  # noqa: F401  (before mitsuba)

import mitsuba as mi  # isort: skip
import numpy as np
import pytest

from mi_enhance import Material
from mi_enhance.benchmark import figure_renders, figure_slices, figure_variants, variants
from mi_enhance.benchmark.contenders import ANALYTIC, REFERENCE, contenders
from mi_enhance.benchmark.odd_samples import in_plane, retro_reflective
from mi_enhance.benchmark.residual_model import SMALL, with_residual
from mi_enhance.cli.main import main
from mi_enhance.data.directions import half_difference, sample_pairs
from mi_enhance.data.loading import load
from mi_enhance.system.bundled_files import demo_data

FILE = demo_data("satin_rosaline_rgb.bsdf")
SMALL_SIZE = ["--samples", "1000", "--resolution", "24", "--spp", "4"]


def test_contenders_that_are_asked_for(llvm, tmp_path):
    """The analytic rivals, each with a file of its fit; a second call reads it."""
    only = (REFERENCE, *ANALYTIC)
    told = []
    fitted = contenders(None, load(FILE, n_samples=1000), tmp_path, only=only, progress=told.append)
    assert set(fitted) == set(only) and len(told) == len(list(tmp_path.glob("*.bsdf"))) == 4
    contenders(None, load(FILE, n_samples=1000), tmp_path, only=only, progress=told.append)
    assert len(told) == 4
    assert all(c.multiply_adds == 0 and 32 < c.n_bytes < 60 for c in fitted.values())
    with pytest.raises(ValueError, match='fits to "satin_rosaline".*other settings \\(samples\\)'):
        contenders(None, load(FILE, n_samples=1000, seed=1), tmp_path, only=only)  # measured once more


def test_odd_samples_are_what_they_say():
    m = retro_reflective(FILE, 200)
    assert np.degrees(np.arccos(np.minimum((m.wi * m.wo).sum(1), 1))).max() < 3.01
    m = in_plane(FILE, 200)
    # float32 directions
    assert np.abs(m.wi[:, 0] * m.wo[:, 1] - m.wi[:, 1] * m.wo[:, 0]).max() < 1e-5
    assert half_difference(m.wi, m.wo)[0].max() > 0.5


def test_a_slice_holds_the_hemisphere(llvm):
    """Of a Lambert surface: f cos is the height of the light over the disc, whatever the viewer."""
    grey = mi.load_dict({"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.5}})
    image = figure_slices._slice(grey)
    n = len(image)
    assert np.isnan(image[0, 0]).all()
    np.testing.assert_allclose(image[n // 2, n // 2], 0.5 / np.pi, rtol=1e-4)
    np.testing.assert_allclose(image[n // 2, round(0.8 * n)], 0.5 / np.pi * 0.8, rtol=0.01)


def test_a_residual_network_is_zero_at_first(llvm):
    wi, wo = sample_pairs(200, seed=0)
    both = Material(with_residual("ggx", SMALL, n_latent=4), {})
    np.testing.assert_allclose(both.evaluate(wi, wo), Material.analytic("ggx").evaluate(wi, wo), rtol=1e-5)


def test_variants_differ_in_one_thing():
    weights = [variants._BUILD[variants.size_label(s)]().n_weights for s in variants.SIZES]
    assert weights == sorted(weights) and len(set(weights)) == 4
    brdfs = {label: build() for label, build in variants._BUILD.items()}
    assert str(brdfs[variants.ENHANCED]) == "M + S * D * [F] [*] [G] * [1/E]"
    assert str(brdfs[variants.NODES]) == "M + S * D * [F] * [G] * [1/E]"
    assert all(brdfs[variants.ALL].state)


@pytest.mark.parametrize(
    "arguments, message",
    [
        (["9", str(FILE)], "Name no file"),
        (["8", "-m", "ggx"], "Leave -m out"),
        (["5", "mi_enhance/bundled/nps/merl.npz"], "is no RGL file"),
    ],
)
def test_what_a_figure_cannot_show_is_refused(llvm, tmp_path, capsys, arguments, message):
    assert main(["figure", *arguments, "-o", str(tmp_path)]) == 2
    assert message in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize("number", [5, 7, 14, 16])
def test_figures_of_fits(llvm, tmp_path, capsys, number):
    assert main(["figure", str(number), str(FILE), "-o", str(tmp_path), "--json", *SMALL_SIZE]) == 0
    result = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert Path(result["output"]).stat().st_size > 10_000
    labels = {row["label"] for row in result["rows"]}
    assert "enhanced" in labels and len(labels) == {5: 6, 7: 2, 14: 4, 16: 8}[number]
    assert all(0 < row["log_l1"] < 1 for row in result["rows"])


@pytest.mark.slow
def test_figures_of_variants(llvm, tmp_path):
    """Trained for a moment: residual networks are 0 at first, so they begin as GGX."""
    few = {"steps": 4, "scale": 0.01}
    rows = figure_variants.sizes(tmp_path, **few)
    assert len(rows) == 6 and (tmp_path / "figure_9.png").exists()
    again = figure_variants.sizes(tmp_path, **few)
    assert rows == again
    size = {"n_samples": 500, "resolution": 24, "spp": 1}
    rows = figure_variants.fitted_variants(11, [FILE], tmp_path, **few, **size)
    assert [row["label"] for row in rows] == ["GGX", "nodes and operators", "nodes only"]
    assert (tmp_path / "figure_11.png").exists()
    with pytest.raises(ValueError, match="other settings"):
        figure_variants.sizes(tmp_path, steps=5, scale=0.01)


def test_stack(tmp_path):
    for k in range(2):
        mi.Bitmap(np.full((4, 6, 3), 100 * k, np.uint8)).write(str(tmp_path / f"{k}.png"))
    figure_renders.stack([tmp_path / "0.png", tmp_path / "1.png"], tmp_path / "both.png")
    both = np.array(mi.Bitmap(str(tmp_path / "both.png")))
    assert both.shape == (8, 6, 3) and both[0].max() == 0 and both[-1].min() == 100
