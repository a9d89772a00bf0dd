"""The Python file of a material says what the material says."""

from __future__ import annotations

import drjit as dr
import extreme_cases
import materials
import mitsuba as mi
import numpy as np
import pytest
from any_material import pairs
from materials import KINDS

from mi_enhance import Material, models
from mi_enhance.analytic import alternative_terms
from mi_enhance.analytic.terms import registry
from mi_enhance.neural.enhance import enhance

TOLERANCE = 1e-4  # relative: both are float32; measured up to 6e-6, where a narrow lobe magnifies the last digits more
DARK = 1e-6  # 1/sr: errors count relative to f, or to this where f is darker


def error(value, reference):
    assert np.isfinite(value).all()
    return (np.abs(value - reference) / np.maximum(np.abs(reference), DARK)).max()


CONSTANT = ("ggx", "abc", "text", "specialized", "mixture", "trunk", "edited")


@pytest.mark.parametrize("kind, editable", [*((kind, True) for kind in KINDS), *((kind, False) for kind in CONSTANT)])
def test_values_are_those_of_the_material(llvm, kind, editable):
    material = KINDS[kind]()
    wi, wo = pairs(3000)
    written = materials.module(material, editable=editable).evaluate(wi, wo)
    assert error(written, material.evaluate(wi, wo)) < TOLERANCE


@pytest.mark.parametrize("kind", ["ggx2", "abc", "net ggx2", "specialized"])
def test_edits_count_as_in_the_material(llvm, kind):
    material = KINDS[kind]()
    wi, wo = pairs(300)
    written = materials.module(material)
    rng = np.random.default_rng(0)
    for name, (_, low, high) in written.PARAMETERS.items():
        q = next(q for q in material.brdf.parameters if q.name == name)
        value = rng.uniform(max(low, 0.05), min(high, 1.1), q.size)
        expected = material.edit(**{name: value}).evaluate(wi, wo)
        assert error(written.evaluate(wi, wo, **{name: value}), expected) < TOLERANCE, name


def test_a_value_out_of_range_counts_as_the_bound(llvm):
    wi, wo = pairs(300)
    written = materials.module(Material.analytic("ggx"))
    f = [written.evaluate(wi, wo, alpha_x=v) for v in (7.0, 1.0, -1.0, 1e-4)]
    assert np.array_equal(f[0], f[1])
    assert np.array_equal(f[2], f[3])
    assert not np.array_equal(f[0], f[2])


def test_unknown_parameter_lists_those_there_are(llvm):
    written = materials.module(Material.analytic("ggx"))
    with pytest.raises(ValueError, match="unknown parameters {'rough'}; choose from n_x, .*F0"):
        written.evaluate([[0, 0, 1]], [[0, 0, 1]], rough=1)


@pytest.mark.parametrize("case", extreme_cases.CASES)
@pytest.mark.parametrize("model", ["ggx2", "ward", "abc", "cook_torrance", "ashikhmin_shirley"])
def test_extremes_are_as_exact(llvm, model, case):
    """Roughness 1e-4, grazing and opposite directions, every parameter at its bounds: one material a lane."""
    brdf = enhance(model, replace=())
    chosen, random = extreme_cases.CASES[case], extreme_cases.Random(2000, 1)
    params = extreme_cases.draw_parameters(chosen, brdf, random)
    wi, wo = extreme_cases.draw_directions(chosen, brdf, params, random)
    rows = {name: np.array(v).T for name, v in params.items()}
    written = materials.module(Material.analytic(model)).evaluate(np.array(wi).T, np.array(wo).T, **rows)
    reference = np.array(brdf(wi, wo, params)).T
    # A lobe of 1e-4 is known to a few digits of the half vector: see tests/test_extremes.py for both against float64.
    assert error(written, reference) < 2e-2
    assert np.median(np.abs(written - reference) / np.maximum(reference, DARK)) < 1e-5


@pytest.mark.parametrize("kind", ["net ggx2_small", "specialized"])
@pytest.mark.parametrize("alpha", [1e-4, 1e-3, 1])
def test_networks_stay_finite_at_the_extremes(llvm, kind, alpha):
    material = KINDS[kind]().edit(alpha_x=alpha, alpha_y=1e-4, F0=1, rho_s=10, rho_d=1)
    wi, wo = pairs(3000)
    wo[::5] = wi[::5] * [-1, -1, 1]
    written = materials.module(material).evaluate(wi, wo)
    assert error(written, material.evaluate(wi, wo)) < 1e-3


def test_a_new_term_needs_nothing_to_be_written(llvm, monkeypatch):
    """It calls Dr.Jit and Mitsuba by whatever names its author's module has for them."""

    def D_new(h, alpha_x, alpha_y):
        import drjit

        tail = drjit.power(1 + dr.squared_norm(mi.Vector2f(h.x / alpha_x, h.y / alpha_y)), -1.5)
        return dr.select(h.z > 0.5, tail, dr.atan2(h.y, h.x) ** 2 * dr.tanh(h.z)) * dr.lerp(0.2, 0.5, dr.abs(h.x))

    monkeypatch.setitem(registry.ALTERNATIVES, "D_new", registry.Alternative(D_new, "D"))
    model = alternative_terms.with_terms(models.get("ggx"), {"D": "D_new"})
    material = Material.analytic(model)
    wi, wo = pairs(2000)
    assert error(materials.module(material).evaluate(wi, wo), material.evaluate(wi, wo)) < TOLERANCE


def test_what_cannot_be_translated_is_said(llvm, monkeypatch):
    def branches(h):
        return 1 if h.x > 0 else 2

    def unknown(h):
        return dr.erf(h.x)

    def of_another_library(h):
        return np.exp(h.x)

    for term, message in (
        (branches, "branches on a value that is not known"),
        (unknown, r"drjit.erf\(\) cannot be translated. Terms may use: abs, .*"),
        (of_another_library, 'slot "D"'),
    ):
        monkeypatch.setitem(registry.ALTERNATIVES, "D_odd", registry.Alternative(term, "D"))
        material = Material.analytic(alternative_terms.with_terms(models.get("ggx"), {"D": "D_odd"}))
        with pytest.raises(NotImplementedError, match=message):
            materials.module(material)
    assert dr.__name__ == "drjit"
    assert mi.__name__ == "mitsuba"


def test_pytorch_tensors_work_and_have_gradients(llvm):
    torch = pytest.importorskip("torch", reason="PyTorch is not installed")
    material = materials.mixed()
    wi, wo = pairs(500)
    written = materials.module(material)
    alpha = torch.tensor(0.2, requires_grad=True)
    f = written.evaluate(torch.tensor(wi), torch.tensor(wo), alpha_x=alpha)
    assert error(f.detach().numpy(), material.edit(alpha_x=0.2).evaluate(wi, wo)) < TOLERANCE
    f.sum().backward()
    assert alpha.grad.isfinite()
    assert alpha.grad != 0
    u = torch.rand(len(wi), 3)
    drawn, density = written.sample(torch.tensor(wi), u), written.pdf(torch.tensor(wi), torch.tensor(wo))
    assert np.allclose(drawn.numpy(), written.sample(wi, u.numpy()), atol=1e-5)
    assert np.allclose(density.numpy(), written.pdf(wi, wo), rtol=1e-4)
