"""`check` finds what is wrong with a material, and nothing where nothing is."""

from __future__ import annotations

import dataclasses
import json

import mitsuba as mi
import numpy as np
import pytest

from mi_enhance.cli.main import main
from mi_enhance.evaluation.check import check
from mi_enhance.evaluation.chi_square import chi_square
from mi_enhance.material.material import Material
from mi_enhance.sampling import importance


def verdicts(material):
    return {row["check"]: row["verdict"] for row in check(material).rows}


def test_a_textbook_model_passes_and_the_figures_are_its_own(llvm):
    """Lambert of albedo 0.5 below a lobe too weak to be seen: f = 0.5 / pi, albedo 0.5, weights near 0.5."""
    result = check(Material.analytic("ggx").edit(rho_d=0.5, rho_s=1e-6))
    rows = {row["check"]: row["value"] for row in result.rows}
    assert result.ok and result.files == {}
    assert rows["largest albedo"] == pytest.approx(0.5, rel=1e-3)  # an average of 8,192 even samples
    assert rows["largest f, 1/sr"] == pytest.approx(0.5 / np.pi, rel=5e-3)  # the lobe still shows at the horizon
    assert rows["density over its integral"] == pytest.approx(1, abs=5e-3)  # cells cut by the horizon
    assert rows["reciprocity, relative"] < 1e-6


def test_what_is_not_claimed_is_information(llvm):
    """Ward's lobe makes energy towards the horizon and never said that it would not."""
    result = check(Material.analytic("ward").edit(rho_s=1.0))
    rows = {row["check"]: row for row in result.rows}
    assert rows["largest albedo"]["value"] > 1.5 and rows["largest albedo"]["verdict"] == ""
    assert rows["reciprocity, relative"]["verdict"] == "ok" and result.ok


def test_a_density_that_is_not_the_samples_is_found(llvm, monkeypatch):
    """One off by 10 % where the lobe is."""
    true = importance.pdf
    monkeypatch.setattr(importance, "pdf", lambda *a, **k: true(*a, **k) * (1 + 0.1 * (a[1].x < 0)))
    found = verdicts(Material.analytic("ggx").edit(alpha_x=0.3, alpha_y=0.3))
    assert found["chi-square at 30°, p at least"] == "off"


def test_nan_and_negative_values_are_found(llvm, monkeypatch):
    from mi_enhance.neural.enhanced_brdf import EnhancedBRDF

    true = EnhancedBRDF.__call__

    def broken(self, wi, wo, *rest):
        f = true(self, wi, wo, *rest)
        return mi.Color3f(f.x + 0 / mi.Float(wo.z > 1e-3), f.y - 0.5, f.z)  # 0 / 0 towards the horizon

    monkeypatch.setattr(EnhancedBRDF, "__call__", broken)
    found = verdicts(Material.analytic("ggx").edit(rho_d=0.2))
    assert found["NaN or infinite"] == "off" and found["negative"] == "off"


def test_a_claim_that_is_missed_is_found(llvm, monkeypatch):
    from mi_enhance.neural.enhanced_brdf import EnhancedBRDF

    true = EnhancedBRDF.__call__
    monkeypatch.setattr(EnhancedBRDF, "__call__", lambda self, wi, wo, *rest: true(self, wi, wo, *rest) * (1 + wi.x**2))
    found = verdicts(Material.analytic("ggx"))
    assert found["reciprocity, relative"] == "off"


@pytest.mark.parametrize("alpha", [(1e-3, 1e-3), (0.01, 0.5)], ids=str)
@pytest.mark.parametrize("degrees", [0, 60, 89])
def test_chi_square_resolves_narrow_lobes(llvm, alpha, degrees):
    """Lobes far narrower than a cell of Mitsuba's spherical domain; the density integrates to what is drawn."""
    m = Material.analytic("ggx").edit(alpha_x=alpha[0], alpha_y=alpha[1], t_theta=0.7, n_x=0.1)
    theta = np.deg2rad(degrees)
    wi = [-np.sin(theta), 0, np.cos(theta)]  # away from the tilted normal's side
    result = chi_square(m.bsdf(), wi, m.as_drjit(), m.brdf.model, test_count=6)
    if wi @ np.array([0.1, 0, np.sqrt(0.99)]) <= 0:
        assert result is None  # below the horizon of the normal: nothing is sampled
    else:
        assert result["passed"], result["message"]
        assert result["normalization"] == pytest.approx(1, abs=0.01)  # 16 points across a cell that the horizon cuts


def test_command_writes_what_it_found_and_fails_where_something_is_off(llvm, tmp_path, capsys, monkeypatch):
    path = tmp_path / "m.bsdf"
    Material.analytic("ggx").save(path)
    arguments = ["check", str(path), "-o", str(tmp_path / "out"), "--variant", "llvm_ad_rgb", "--json"]
    assert main(arguments) == 0
    result = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert result["ok"] and {p.name for p in (tmp_path / "out").iterdir()} == {
        "check.csv", "check.json", "check.md", "check.png",
    }  # fmt: skip
    assert np.array(mi.Bitmap(result["files"]["png"])).std() > 1  # not an empty picture
    true = importance.pdf
    monkeypatch.setattr(importance, "pdf", lambda *a, **k: 2 * true(*a, **k))
    assert main(arguments[:2] + arguments[4:]) == 1


def test_check_needs_a_variant_with_colours():
    mi.set_variant("scalar_rgb")
    with pytest.raises(RuntimeError, match='check.*"scalar_rgb" is active'):
        check(dataclasses.replace(Material.analytic("ggx")))
