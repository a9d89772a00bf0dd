"""Models from a text: as the native one in files, fits and renders; with networks; and all that is refused."""

from __future__ import annotations

import dataclasses
import json
import re
import time
from pathlib import Path

import lanes

import mi_enhance  # noqa: F401  (before mitsuba)

import drjit as dr  # isort: skip
import mitsuba as mi
import numpy as np
import pytest
import twin
from any_material import USUAL, given, materials
from plugin_scenes import ball, render_attached

from mi_enhance import data, enhance, models
from mi_enhance.analytic import geometry, parameters
from mi_enhance.analytic.text_model import toml_model
from mi_enhance.cli import main
from mi_enhance.data.directions import sample_pairs
from mi_enhance.fitting.fit import fit
from mi_enhance.material.colour_normalization import normalize
from mi_enhance.material.material import Material
from mi_enhance.neural.mlp import flatten, unflatten

# Relative: log(h_z) has an error of 6e-8, which the text multiplies by an exponent of up to 800.
VALUE = 2e-4
DARK = 1e-9
RECOVERED = 1e-3  # log-L1 of a fit to samples of the model itself

FILE = Path(__file__).parents[2] / "docs/ashikhmin_shirley.toml"
TEXT = FILE.read_text(encoding="utf-8")

# What the native models do not have: a sum in parentheses, a term of parameters alone, a parameter below 0.
TWISTED = """
name = "twisted"
formula = "M * B + S * N * (D + W)"
[terms]
M = "rho_d / pi"
B = "1 + 0 * cos_theta_i"
S = "rho_s"
N = "(n + 1) / (2 * pi)"
D = "cos_theta_h ** n"
W = "exp(-2 + twist) * wi.z * wo.z * cos_theta_d"
[parameters]
rho_d = true
rho_s = true
n = { low = 1, high = 1e4, initial = 20, log = true }
twist = { low = -1, high = 1, initial = 0 }
[[lobes]]
rho_s = "rho_s"
alpha_x = "sqrt(2 / (n + 2))"
alpha_y = "sqrt(2 / (n + 2))"
"""


# --- the same as the native model -------------------------------------------------------------------------------------


def test_text_reads_as_the_native_model():
    text, native = models.from_toml(FILE), models.ashikhmin_shirley()
    assert str(text) == str(native) and text.graph.slots == native.graph.slots
    assert text.parameters == native.parameters
    assert text.starts == native.starts and text.v_cavity == native.v_cavity
    assert text.text == TEXT and not native.text
    for a, b in zip(text.graph.walk(), native.graph.walk(), strict=True):
        assert [c.name for c in a.args] == [c.name for c in b.args]
        # of one's own accord: h where the native term has cos_theta_h, too
        assert set(a.inputs) - {"cos_theta_h"} == set(b.inputs)


def test_text_has_the_values_and_gradients_of_the_native_model(llvm):
    n = 4000
    brdfs = [enhance(model, ()) for model in (models.from_toml(FILE), "ashikhmin_shirley")]
    p = materials(brdfs[0].model, n, usual={**USUAL, "F0": (0.01, 0.95)})
    p["rho_d"][::2] = 0  # the lobe alone
    wi, wo = twin.pairs(n, seed=1)
    np.testing.assert_allclose(*(lanes.evaluate(b, wi, wo, p) for b in brdfs), rtol=VALUE, atol=DARK)
    gradients = []
    for b in brdfs:
        values = lanes.parameters(p)
        dr.enable_grad(values)
        f = b(lanes.vectors(wi), lanes.vectors(wo), values)
        z = mi.Float(np.ascontiguousarray(wo[:, 2]))
        dr.backward(sum(dr.log(1 + c * z) * weight for c, weight in zip(f, (1, 2, 3), strict=True)))
        gradients.append({name: np.array(dr.grad(v), np.float64) for name, v in values.items()})
    for name in p:
        a, b = (g[name] for g in gradients)
        np.testing.assert_allclose(a, b, rtol=1e-3, atol=1e-3 * np.abs(b).mean(), err_msg=name)


def test_text_is_sampled_as_the_native_model(llvm):
    params = {"rho_s": mi.Color3f(1, 2, 3), "n_u": mi.Float(1, 100, 1e6), "n_v": mi.Float(7)}
    ((rho_s, *alphas),), ((expected, *widths),) = (
        m.lobes(params) for m in (models.from_toml(FILE), models.ashikhmin_shirley())
    )
    np.testing.assert_array_equal(np.array(rho_s), np.array(expected))
    np.testing.assert_allclose(np.array(alphas[0]), np.array(widths[0]), rtol=1e-6)
    np.testing.assert_allclose(np.array(alphas[1]), np.array(widths[1]), rtol=1e-6)


def test_corners_of_the_ranges_stay_finite_with_their_gradients(llvm):
    brdf, n = enhance(models.from_toml(FILE), ()), 4000
    rng = np.random.default_rng(4)
    p = {q.name: rng.choice([q.low, q.initial, q.high], (n, q.size)) for q in brdf.parameters}
    wi, wo = twin.awkward_pairs(n, seed=5)
    values = lanes.parameters(p)
    dr.enable_grad(values)
    f = brdf(lanes.vectors(wi), lanes.vectors(wo), values)
    dr.backward(sum(dr.log(1 + c) for c in f))
    assert np.isfinite(np.array(f)).all() and np.array(f).min() >= 0
    for name, v in values.items():
        assert np.isfinite(np.array(dr.grad(v))).all(), name


@pytest.mark.parametrize("name", ["ggx", "ggx2"])
def test_formula_associates_as_in_the_native_models(name):
    """Sums to the left and products to the right: networks of operators have the same operands."""
    native = models.get(name).graph
    constant = toml_model.expression.parse("rho", {"rho": "colour"}, "")
    scalar = toml_model.expression.parse("1", {}, "")
    terms = {n.name: constant if n.name in ("M", "S", "S2") else scalar for n in native.walk() if not n.args}
    text = toml_model._graph(str(native), terms, "test")
    tree = lambda node: (node.name, *map(tree, node.args))  # noqa: E731
    assert tree(text) == tree(native)


def test_parentheses_are_kept_and_printed():
    model = models.from_expression(TWISTED)
    assert str(model) == "M * B + S * N * (D + W)"
    assert model.graph.slots == ("M", "M*B", "B", "M+S", "S", "S*N", "N", "N*D", "D", "D+W", "W")
    assert str(model.graph.replace({"D+W": None, "D": None})) == "M * B + S * N * ([D] [+] W)"


def test_directions_are_those_of_the_geometry(llvm):
    q = geometry.quantities(mi.Vector3f(0, 0, 1), mi.Vector3f(0, 0, 1))
    kinds = {name: "direction" if isinstance(v, mi.Vector3f) else "number" for name, v in q.items()}
    assert kinds == geometry.QUANTITIES


def test_starts_and_lobes_may_be_left_out_where_the_package_has_some():
    text = TEXT[: TEXT.index("[[lobes]]")].replace("n_u", "alpha_x").replace("n_v", "alpha_y")
    text = re.sub(r"alpha_(.) = \{.*", r"alpha_\1 = { initial = 0.3 }", text)
    model = models.from_expression(text)
    alpha_x = next(q for q in model.parameters if q.name == "alpha_x")
    assert alpha_x == dataclasses.replace(parameters.ALPHA_X, initial=0.3)
    assert model.lobes is models.model.lobes_of_alpha and model.starts == models.ggx().starts
    assert models.from_expression(TWISTED + "# after mine.toml").starts == ({},)


def test_example_of_the_documentation_is_a_model(llvm):
    (text,) = re.findall(r"```toml\n(.*?)```", (FILE.parent / "files.md").read_text(encoding="utf-8"), re.DOTALL)
    material = Material(enhance(models.from_expression(text), ()), {})
    assert str(material.brdf) == "M + S * D" and len(material.brdf.model.starts) == 2
    # (n + 2) / (2 pi) at h = n, for rho_d = 0.5, rho_s = 1, n = 100
    np.testing.assert_allclose(material.evaluate([[0, 0, 1]], [[0, 0, 1]]), (0.5 + 51) / np.pi, rtol=1e-5)


# --- fits, files, renders ---------------------------------------------------------------------------------------------


def test_fit_save_load_and_render(llvm, tmp_path):
    """The file is self-contained: it is loaded where the text is not."""
    (tmp_path / "mine.toml").write_text(TEXT)
    material = Material.analytic(models.from_toml(tmp_path / "mine.toml"))
    (tmp_path / "mine.toml").unlink()
    flat = {"n_x": (-0.05, 0.05), "n_y": (-0.05, 0.05), "rho_d": (0, 0.5), "rho_s": (0.1, 2)}
    truth = given(materials(material.brdf.model, 1, 20, {**USUAL, **flat}))
    wi, wo = sample_pairs(3000, seed=0, min_cos=0.05)
    fitted = fit(material, data.Measurements(wi, wo, twin.analytic("ashikhmin_shirley", wi, wo, truth)))
    assert fitted.report["log_l1"] < RECOVERED
    fitted.save(tmp_path / "m.bsdf")
    loaded = Material.load(tmp_path / "m.bsdf")
    assert loaded.brdf.model.text == TEXT and loaded.brdf.model.name == "ashikhmin_shirley_text"
    np.testing.assert_array_equal(loaded.evaluate(wi[:100], wo[:100]), fitted.evaluate(wi[:100], wo[:100]))
    image = np.array(mi.render(ball({"type": "enhanced", "filename": str(tmp_path / "m.bsdf")}), spp=16, seed=1))
    native = Material.analytic("ashikhmin_shirley").edit(**fitted.params)
    native = dataclasses.replace(native, lobe_albedo=fitted.lobe_albedo, mixture=fitted.mixture)  # the same noise
    np.testing.assert_allclose(image, np.array(mi.render(ball(native.to_dict()), spp=16, seed=1)), rtol=0.01)
    edited = loaded.edit(rho_d=0.7)
    edited.save(tmp_path / "edited.bsdf")
    assert Material.load(tmp_path / "edited.bsdf").show() == edited.show()


@pytest.mark.parametrize("text", [TEXT, TWISTED], ids=["ashikhmin_shirley", "twisted"])
def test_renders_with_finite_gradients(llvm, text):
    material = Material(enhance(models.from_expression(text), ()), {"rho_d": 0.3})
    image, p, keys = render_attached(material)
    dr.backward(dr.mean(dr.square(image), axis=None))
    assert np.isfinite(np.array(image)).all() and np.array(image).max() > 0.01
    for key in keys:
        gradient = np.array(dr.grad(p[key]))
        assert np.isfinite(gradient).all() and np.abs(gradient).max() > 0, key


@pytest.mark.parametrize("variant", ["llvm_ad_spectral", "llvm_ad_mono"])
def test_colours_are_those_of_the_variant(variant):
    if variant not in mi.variants():
        pytest.skip(f"{variant} is not part of this Mitsuba")
    material = Material(enhance(models.from_toml(FILE), ()), {"rho_d": (0.5, 0.3, 0.1), "n_u": 20, "n_v": 50})
    images = []
    for name in ("llvm_ad_rgb", variant):
        mi.set_variant(name)
        image = np.array(mi.render(ball(material.to_dict(), emitter={"type": "constant"}), spp=256))
        images.append(image if image.shape[-1] == 1 else image @ np.array([[0.2126], [0.7152], [0.0722]]))
    ball_only = (slice(5, 11), slice(5, 11))
    np.testing.assert_allclose(images[1][ball_only].mean(), images[0][ball_only].mean(), rtol=0.05)  # noise, spectra


def test_command_line_takes_a_file(llvm, tmp_path, capsys):
    wi, wo = sample_pairs(500, seed=0, min_cos=0.05)
    truth = Material.analytic(models.from_toml(FILE)).edit(rho_d=(0.1, 0.2, 0.3), n_u=30, n_v=60)
    data.save_table(data.Measurements(wi, wo, truth.evaluate(wi, wo)), tmp_path / "m.csv")
    out = tmp_path / "m.bsdf"
    assert main.main(["fit", str(tmp_path / "m.csv"), "-m", str(FILE), "-o", str(out), "--json"]) == 0
    report = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert report["log_l1"] < 0.01 and report["model"] == "M * B + S * D * F * 1/E"
    assert Material.load(out).brdf.model.text == TEXT


# --- with networks ----------------------------------------------------------------------------------------------------


def test_networks_have_the_outputs_of_their_terms(llvm):
    """Three for a term of a colour, one for a term of the directions, and for one of parameters alone."""
    brdf = enhance(
        models.from_expression(TWISTED), ("M", "B", "N", "D", "D+W"), inputs="shape", hidden=(4,), n_latent=3
    )
    assert str(brdf) == "[M] * [B] + S * [N] * ([D] [+] W)"
    # log(n) / 4 and twist as it is, 3 latent numbers; 7 features of the directions; two operands
    sizes = {slot: mlp.sizes for slot, mlp in brdf.modules.items()}
    assert sizes == {"M": (5, 4, 3), "B": (12, 4, 1), "N": (5, 4, 1), "D": (12, 4, 1), "D+W": (2, 4, 1)}
    p = materials(brdf.model, 200) | {"latent": np.full((200, 3), 0.5), "asymmetry": np.full((200, 1), 0.1)}
    p |= {f"norm_{slot}": np.zeros((200, 1)) for slot in ("M", "B", "N", "D")}
    f = lanes.evaluate(brdf, *twin.pairs(200), p)
    assert np.isfinite(f).all() and (f > 0).any()


def test_enhanced_model_is_fitted_normalized_saved_and_loaded(llvm, tmp_path):
    """normalize() scales by a factor of the summand: N, not D, which stands inside of a sum."""
    brdf = enhance(models.from_expression(TWISTED), ("B", "D", "N"), inputs="shape", hidden=(4,), n_latent=2)
    flat = flatten(brdf.modules)
    flat = flat + np.random.default_rng(0).normal(0, 0.3, flat.shape).astype(np.float32)
    brdf = dataclasses.replace(brdf, modules=unflatten(brdf.modules, flat))
    before = Material(brdf, {"rho_d": (0.1, 0.2, 0.3), "rho_s": (0.2, 0.1, 0.05), "n": 30.0, "twist": -0.5})
    after = normalize(before)
    wi, wo = sample_pairs(300, seed=0, min_cos=0.05)
    np.testing.assert_allclose(after.evaluate(wi, wo), before.evaluate(wi, wo), rtol=1e-4)
    assert not after.params["norm_D"] and after.params["norm_N"] and after.params["norm_B"]
    fitted = fit(before, data.Measurements(wi, wo, before.evaluate(wi, wo)))
    assert fitted.report["log_l1"] < 0.01
    fitted.save(tmp_path / "m.bsdf")
    loaded = Material.load(tmp_path / "m.bsdf")
    np.testing.assert_array_equal(loaded.evaluate(wi, wo), fitted.evaluate(wi, wo))


# --- what is refused --------------------------------------------------------------------------------------------------


def changed(**replacements):
    """The twisted model with other lines: key -> whole line, None to leave it out."""
    text = TWISTED
    for key, line in replacements.items():
        text, n = re.subn(rf"^{key} = .*$", lambda _, line=line: line or "", text, count=1, flags=re.MULTILINE)
        assert n, key
    return text


WRONG = [
    ("", "name must be a text in quotes"),
    ("name", r"this is not TOML \(.*\). The format is described in docs/files.md"),
    ("[" * 9_000, "this is not TOML"),
    ("a = " + "[" * 9_000, "this is not TOML"),
    ("x" * 10_001, "a model is a text of at most 10000 characters"),
    ("mine.toml", r'"mine.toml" is a path, not a model. Use models.from_toml\("mine.toml"\)'),
    (None, "a model is a text of at most 10000 characters; got nothing"),
    (changed(name="name = 5"), 'name must be a text in quotes "..."; got 5'),
    (changed(name='name = "a b"'), 'name must be letters, digits and "_", at most 64; got "a b"'),
    ("title = 1\n" + TWISTED, 'unknown entry "title". Choose from: name, source, formula'),
    (TWISTED.replace("[terms]", "[term]"), 'unknown entry "term". .* Did you mean "terms"'),
    ("frame = 1\n" + TWISTED, "frame must be true or false; got 1"),
    ('name = "x"\nparameters = "M"', r"\[parameters\] must be a table of 1 to 40 entries; got 'M'"),
    ('name = "x"\nformula = "M"\nparameters = {}\nterms = {}', r"\[parameters\] must be a table of 1 to 40 en"),
    # formula
    (changed(formula="formula = 5"), 'formula must be a text in quotes "..."; got 5'),
    (changed(formula='formula = ""'), 'formula: the term "M" stands 0 times in the formula'),
    (changed(formula='formula = "M * B + S * N * (D + W) * X"'), 'formula: the term "X" is not in'),
    (changed(formula='formula = "M * B + S * N * D"'), 'the term "W" stands 0 times in the formula'),
    (changed(formula='formula = "M * B + S * N * (D + W) * B"'), 'the term "B" stands 2 times in the formula'),
    (changed(formula='formula = "M * B - S * N * (D + W)"'), 'the term "-" is not in'),
    (changed(formula='formula = "M B + S * N * (D + W)"'), '"B" comes where it should not'),
    (changed(formula='formula = "M * B + S * N * (D + W"'), "the end comes where it should not"),
    (changed(formula='formula = "M * B + S * N * D + W)"'), r'"\)" comes where it should not'),
    (changed(formula='formula = "M * B + + S * N * (D + W)"'), r'"\+" comes where it should not'),
    (changed(formula=f'formula = "M * B + S * N * {"(" * 500}D + W{")" * 500}"'), r'"\(" comes where it should'),
    (changed(formula=f'formula = "{"M" * 9000}!"'), "is not in"),
    (changed(formula='formula = "M * B + S * N * D + W"'), r"M \* B \+ .* \+ W adds a colour and a number"),
    (changed(formula='formula = "M * B * S * N * (D + W)"'), r".* multiplies two colours. f must stay linear"),
    # terms
    (changed(W=None), 'the term "W" is not in'),
    (changed(W='W = "wi.z *"'), r'\[terms\] W: "wi.z \*" is not an expression'),
    (changed(W="W = 1"), r"\[terms\] W: must be an expression in quotes"),
    (changed(W=f"W.{'.'.join('a' * 4500)} = 1"), r"\[terms\] W: must be an expression in quotes, .* got 1 entries"),
    (changed(W='W = "t_theta * twist"'), 'unknown name "t_theta"'),
    (changed(D='D = "h ** n"'), r'"h" is a direction'),
    (changed(D='D = "rho_s * cos_theta_h ** n"'), "the terms S and D both read the colour rho_s. Let one"),
    (changed(S='S = "rho_s * h.z"'), r"\[terms\] S reads a colour and the direction h. Split it"),
    (changed(S='S = "rho_s + 1"'), r"\[terms\] S: a colour and a number are added"),
    (changed(S='S = "1"', rho_s=None), r'\[\[lobes\]\] rho_s: unknown name "rho_s"|adds a colour and a number'),
    (changed(W='W = "wi.z"'), "no term reads the parameter twist. Use it, or leave it out"),
    (changed(M='M = "1"'), "no term reads the parameter rho_d"),
    (TWISTED.replace("rho_d", "colour", 1).replace("rho_d = true", "colour = {size=3, low=0, high=1, initial=0}"),
     "the term M must be the diffuse one and read rho_d"),
    # parameters
    (changed(n="n = true"), r"\[parameters\] n: must be a table such as .*, or true for one of .*rho_d, rho_s"),
    (changed(n="n = { low = 1, high = 2 }"), r"\[parameters\] n: initial is missing. Give low, high and initial"),
    (changed(n="n = { low = 1, high = 2, initial = 3 }"), "needs low <= initial <= high and low < high; got 1, 3,"),
    (changed(n="n = { low = 1, high = 1, initial = 1 }"), "needs low <= initial <= high and low < high"),
    (changed(n="n = { low = 0, high = 2, initial = 1, log = true }"), "needs 0 < low <= initial <= high"),
    (changed(n="n = { low = 1, high = 2, initial = 1, logs = true }"), 'unknown entry "logs".*Did you mean "log"'),
    (changed(n="n = { low = 1, high = inf, initial = 1 }"), r"high must be a number, at most 1e\+30; got inf"),
    (changed(n="n = { low = nan, high = 2, initial = 1 }"), "low must be a number"),
    (changed(n='n = { low = "1", high = 2, initial = 1 }'), "low must be a number, .* got '1'"),
    (changed(n="n = { low = 1, high = 2, initial = true }"), "initial must be a number, .* got True"),
    (changed(n="n = { low = 1, high = 2, initial = 1, size = 2 }"), "size must be 1, or 3 for a linear RGB colour"),
    (changed(n="n = { low = 1, high = 2, initial = 1, size = true }"), "size must be 1, or 3"),
    (changed(n="n = { low = 1, high = 2, initial = 1, log = 1 }"), "log must be true or false; got 1"),
    (changed(rho_s="rho_s = { size = 1 }"), r"rho_s: has size 3, log false and a range within \[0, 10\] in all"),
    (changed(n="B = { low = 0.5, high = 2, initial = 1 }"), r"B: has size 1, log true and a range within \[1, 1e"),
    (changed(rho_s="rho_s = { high = 11 }"), r"rho_s: has size 3, .* Narrow the range, or choose another name"),
    *(
        (TWISTED.replace("twist", name), rf"\[parameters\] {name}: this name is taken, it means something else")
        for name in ("latent", "asymmetry", "norm_D", "h", "cos_theta_d", "sqrt", "pi", "weights", "id")
    ),
    (TWISTED.replace("twist", "lambda"), "is no word of Python. Choose another"),
    (TWISTED.replace("twist =", "'t w' ="), 'a name has letters, digits and "_"'),
    (TWISTED.replace("twist", "n_x"), r"\[parameters\] n_x: the frame has its own switch. Write frame = true"),
    (changed(twist="alpha_x = { log = false }", W='W = "alpha_x"'), "alpha_x: has size 1, log true and a range within"),
    (changed(twist="alpha_x = true", W='W = "alpha_x"'), "alpha_x and alpha_y come in pairs"),
    # starts and lobes
    (TWISTED + "[[starts]]\nx = 1\n", r'\[\[starts\]\]: unknown parameter "x". Choose from: rho_d'),
    (TWISTED + "[[starts]]\nn = 0.5\n", r"\[\[starts\]\]: n must lie in \[1, 10000\]"),
    (TWISTED + '[[starts]]\nn = "a"\n', r"\[\[starts\]\]: n must be a number"),
    (TWISTED + "[[starts]]\n" * 41, r"\[\[starts\]\] must be at most 40 tables; got 41 entries"),
    ("starts = 5\n" + TWISTED, r"\[\[starts\]\] must be at most 40 tables; got 5"),
    (TWISTED.split("[[lobes]]")[0], r"\[\[lobes\]\] is missing, and the model has no alpha_x, alpha_y. Say which"),
    (TWISTED + 'roughness = "1"\n', r'\[\[lobes\]\]: unknown entry "roughness". Choose from: rho_s, alpha_x, alph'),
    (changed(alpha_y=None), r'\[\[lobes\]\] alpha_y: "" is not an expression'),
    (changed(alpha_x='alpha_x = "h.z"'), r'\[\[lobes\]\] alpha_x: unknown name "h"'),
    (TWISTED.replace('rho_s = "rho_s"', 'rho_s = "n"'), "rho_s must be a colour times numbers"),
    (changed(alpha_x='alpha_x = "rho_s"'), "alpha_x and alpha_y numbers"),
]  # fmt: skip


@pytest.mark.parametrize("text, message", WRONG, ids=lambda v: re.sub(r"\W+", " ", str(v))[-40:])
def test_wrong_model_is_refused(text, message):
    start = time.process_time()
    with pytest.raises(ValueError, match=rf"(?s)^from_expression\(\): .*({message})") as caught:
        models.from_expression(text)
    assert time.process_time() - start < 10 and len(str(caught.value)) < 700  # seconds; the slowest takes 1


def test_file_that_is_not_a_model_is_refused(tmp_path):
    path = tmp_path / "m.toml"
    with pytest.raises(FileNotFoundError, match=rf'models.from_toml\("{path}"\): no such file'):
        models.from_toml(path)
    path.write_bytes(b"name = '\xff'")
    with pytest.raises(ValueError, match=rf'models.from_toml\("{path}"\): this is not text in UTF-8 .* Save it as one'):
        models.from_toml(path)
    path.write_text(TWISTED.replace("twist)", "twit)"))
    with pytest.raises(
        ValueError, match=rf'models.from_toml\("{path}"\): \[terms\] W: unknown name "twit".*mean "twist"'
    ):
        models.from_toml(path)


@pytest.mark.parametrize(
    "description, message",
    [
        ({"model_text": "name = 1"}, r"cannot be understood: from_expression\(\): name must be a text"),
        ({"model_text": "[" * 10_000}, r"cannot be understood: from_expression\(\): this is not TOML"),
        ({"model_text": 5}, r"cannot be understood: from_expression\(\): a model is a text"),
        ({"model_text": ["name"]}, r"cannot be understood: from_expression\(\): a model is a text"),
        ({"model_text": str(FILE)}, r"cannot be understood: from_expression\(\): .* is a path, not a model"),
        ({"model_text": "", "model": str(FILE)}, "cannot be understood: .*unknown model"),
        ({"model_text": TWISTED}, r"params has shape \(12,\); \(8,\) is needed for M \* B"),
    ],
    ids=lambda v: str(v)[:30],
)
def test_damaged_text_in_a_material_is_refused(llvm, description, message):
    """No other file is read for it, whatever it says."""
    d = Material.analytic(models.from_toml(FILE)).to_dict()
    text = json.dumps({**json.loads(d["description"]), **description})
    with pytest.raises(ValueError, match=rf'^bsdf "enhanced": .*{message}'):
        Material.from_arrays(text, d["params"], d["weights"])
