"""A material as a file: exact, atomic, and never a crash whatever the bytes."""

from __future__ import annotations

import json
import struct

import lanes
import mitsuba as mi
import numpy as np
import pytest
import twin
import twin_networks

from mi_enhance.material.material import Material
from mi_enhance.neural import mlp
from mi_enhance.neural.enhance import enhance
from mi_enhance.system import tensor_file
from mi_enhance.system.bundled_files import demo_data

EQUATION = "M + S * D * [F] [*] [G] * [1/E]"
TWO_LOBES = {"model": "ggx2", "replace": ("B", "G", "G2"), "inputs": "shape", "modulated": True, "n_latent": 6}


def random_material(replace=("F", "F*G", "G", "1/E"), library=False, **settings):
    """A material whose numbers all differ, as float32 holds them."""
    model, hidden = settings.pop("model", "ggx"), settings.pop("hidden", (4, 3))
    brdf = enhance(model, replace, seed=3, hidden=hidden, **settings)
    p = twin_networks.parameters(brdf, 5, seed=4)
    rows = np.concatenate([p[q.name] for q in brdf.parameters], 1)
    params = {q.name: p[q.name][0] for q in brdf.parameters}
    return Material(
        brdf, params, {"log_l1": 0.0125, "name": "gold", "nested": {"a": [1]}}, rows if library else None, 0.25
    )


@pytest.fixture
def saved(llvm, tmp_path):
    path = tmp_path / "gold.bsdf"
    random_material().save(path)
    return path


def fields(path):
    """All tensors of a file, to be changed and written again."""
    return {k: tensor_file.values(path, f) for k, f in tensor_file.fields(path, "test").items()}


def rewrite(path, description=None, **changed):
    """The same file with other tensors (None leaves one out) or other entries of the description."""
    tensors = fields(path)
    text = json.loads(tensors.pop("description").tobytes())
    text = description if isinstance(description, str) else json.dumps({**text, **(description or {})})
    tensors.update(changed)
    tensor_file.write(path, {"description": text, **{k: v for k, v in tensors.items() if v is not None}})
    return path


# ---------------------------------------------------------------------- round trips


@pytest.mark.parametrize(
    "settings",
    [
        {},
        {"replace": ()},
        {"replace": ("M", "S*D"), "inputs": "directions"},
        {"replace": ("F*G",)},
        {"n_latent": 0},
        {"library": True, "n_latent": 5, "hidden": (8,)},
        TWO_LOBES,
        {**TWO_LOBES, "replace": ("M", "S2", "F*G"), "library": True},
    ],
    ids=["final", "analytic", "colours", "operator", "no latent", "network", "two lobes", "two lobes, colours"],
)
def test_file_brings_everything_back_to_the_bit(llvm, tmp_path, settings):
    old, path = random_material(**settings), tmp_path / "m.bsdf"
    old.save(path)
    new = Material.load(path)
    assert str(new.brdf) == str(old.brdf) and new.brdf.state == old.brdf.state
    assert (new.brdf.inputs, new.brdf.n_latent) == (old.brdf.inputs, old.brdf.n_latent)
    kinds = lambda b: {s: (m.sizes, m.n_folded, m.modulated) for s, m in b.modules.items()}  # noqa: E731
    assert kinds(new.brdf) == kinds(old.brdf)
    assert np.array_equal(mlp.flatten(new.brdf.modules), mlp.flatten(old.brdf.modules))
    assert np.array_equal(new.as_vector(), old.as_vector())
    assert new.report == old.report and new.lobe_albedo == old.lobe_albedo
    assert (new.library is None) == (old.library is None)
    if old.library is not None:
        assert np.array_equal(new.library, old.library)
    new.save(tmp_path / "again.bsdf")
    assert (tmp_path / "again.bsdf").read_bytes() == path.read_bytes()


@pytest.mark.parametrize("settings", [{}, TWO_LOBES], ids=["final", "two lobes"])
def test_dictionary_brings_everything_back_to_the_bit(llvm, settings):
    old = random_material(**settings)
    d = old.to_dict()
    new = Material.from_arrays(d["description"], d["params"], d["weights"])
    assert np.array_equal(mlp.flatten(new.brdf.modules), mlp.flatten(old.brdf.modules))
    assert np.array_equal(new.as_vector(), old.as_vector()) and new.lobe_albedo == old.lobe_albedo


@pytest.mark.parametrize("value", ["low", "high"])
def test_bounds_survive_the_rounding_of_the_file(llvm, tmp_path, value):
    """float32(pi) is larger than pi; a fit that ended at a bound must load again."""
    m = Material.analytic("ggx")
    m = m.edit(**{p.name: getattr(p, value) for p in m.brdf.parameters})
    m.save(tmp_path / "m.bsdf")
    for p in m.brdf.parameters:
        v = Material.load(tmp_path / "m.bsdf").params[p.name]
        assert p.low <= v.min() and v.max() <= p.high


def test_evaluate_is_the_twin(llvm):
    m = random_material()
    wi, wo = twin.pairs(500, seed=1, min_cos=0.05)
    expected = twin.brdf(wi, wo, m.params, {s: n.layers for s, n in m.brdf.modules.items()})
    np.testing.assert_allclose(m.evaluate(wi, wo), expected, rtol=1e-4)  # as in test_enhance.py


# ---------------------------------------------------------------------- edit and show


def test_edit_changes_a_copy():
    old = random_material()
    new = old.edit(rho_d=(0.2, 0.1, 0.0), alpha_x=0.5, rho_s=3)
    assert new.params["rho_d"].tolist() == [0.2, 0.1, 0.0] and new.params["rho_s"].tolist() == [3, 3, 3]
    assert new.params["alpha_x"] == 0.5 and old.params["alpha_x"] != 0.5
    assert np.array_equal(new.params["latent"], old.params["latent"]) and new.brdf is old.brdf


@pytest.mark.parametrize(
    "values, message",
    [
        (
            {"roughness": 0.1},
            r'Material\.edit\(\): unknown parameter "roughness"\. Choose from: n_x, .*alpha_x, .*latent',
        ),
        ({"rho_d": (0.1, 0.2)}, r"Material\.edit\(\): rho_d takes 3 number\(s\); got 2"),
        ({"rho_d": -0.1}, r"Material\.edit\(\): rho_d must lie in \[0, 1\]; got \[-0\.1"),
        ({"alpha_x": 0.0}, r"alpha_x must lie in \[0\.0001, 1\]; got \[0\.0\]"),
        ({"F0": np.nan}, r"F0 must lie in \[0, 1\]; got \[nan\]"),
        ({"rho_s": np.inf}, r"rho_s must lie in \[0, 10\]; got \[inf"),
    ],
    ids=lambda v: next(iter(v)) if isinstance(v, dict) else "",
)
def test_edit_refuses_what_is_out_of_range(values, message):
    with pytest.raises(ValueError, match=message):
        random_material().edit(**values)


def test_show_names_equation_parameters_and_report():
    m = random_material(hidden=mlp.HIDDEN).edit(rho_d=(0.25, 0.5, 1))
    text = m.show()
    assert text.splitlines()[0] == EQUATION
    assert "rho_d    0.25 0.5 1" in text and "log_l1: 0.0125" in text and "name: gold" in text
    assert "39 parameters (156 bytes), 6612 shared weights, inputs: symmetric" in text
    assert m.report["edited"] == ["rho_d"] and "edited since the fit, whose errors these are: rho_d" in text
    assert m.edit(F0=0.1).report["edited"] == ["F0", "rho_d"]
    assert "edited" not in Material.analytic("ggx").edit(F0=0.1).report  # of no fit


# ---------------------------------------------------------------------- files that are something else


def refuse(path, message):
    with pytest.raises(ValueError, match=message) as caught:
        Material.load(path)
    assert str(caught.value).startswith(f'Material.load("{path}"): ')


def test_missing_file_is_refused(llvm):
    with pytest.raises(FileNotFoundError, match=r'Material\.load\("nowhere\.bsdf"\): no such file'):
        Material.load("nowhere.bsdf")


def test_folder_is_refused(llvm, tmp_path):
    refuse(tmp_path, "this is a folder")


def test_measured_file_is_refused_with_the_command_that_helps(llvm):
    refuse(
        demo_data("ilm_solo_m_68_rgb.bsdf"), r"measured RGL file, not a material.*mi-enhance fit .* -o material\.bsdf"
    )


def test_tensor_file_of_another_kind_is_refused(llvm, tmp_path):
    tensor_file.write(tmp_path / "x.bsdf", {"other": np.zeros(3, np.float32)})
    refuse(tmp_path / "x.bsdf", r"not a material of mi_enhance: it has no params and description\. Got: \['other'\]")


@pytest.mark.parametrize("keep", [0, 5, 30, 200, -1], ids=str)
def test_truncated_file_is_refused(saved, keep):
    saved.write_bytes(saved.read_bytes()[:keep])
    refuse(saved, "does not begin like a tensor file|ends inside its header|cut off or damaged")


@pytest.mark.parametrize("name", ["params", "F.layers.0.weights", "G.layers.2.bias"])
@pytest.mark.parametrize("value", [np.nan, np.inf], ids=str)
def test_numbers_that_are_not_finite_are_refused(saved, name, value):
    array = fields(saved)[name].copy()
    array.flat[0] = value
    refuse(rewrite(saved, **{name: array}), f"{name} holds NaN or infinity")


@pytest.mark.parametrize(
    "changed, message",
    [
        ({"params": np.zeros(7, np.float32)}, r"params has shape \(7,\); \(39,\) is needed for M \+ S"),
        ({"F.layers.0.bias": np.zeros(5, np.float32)}, r"F\.layers\.0\.bias should have shape \(4,\); got \(5,\)"),
        ({"1/E.layers.1.weights": None}, r"1/E\.layers\.1\.weights should have shape \(3, 4\); got nothing"),
        ({"library": np.zeros((2, 3), np.float32)}, r"library has shape \(2, 3\); \(M, 39\) is needed"),
        ({"params": np.full(39, 99, np.float32)}, r"n_x must lie in \[-0\.5, 0\.5\]; got \[99\.0\]"),
        ({"F.layers.0.bias": np.zeros(4, np.int32)}, r"F\.layers\.0\.bias holds int32; float32 is needed"),
        ({"params": np.full(39, 1e300)}, r"params holds float64; float32 is needed"),
    ],
    ids=lambda v: next(iter(v)) if isinstance(v, dict) else "",
)
def test_wrong_tensors_are_refused(saved, changed, message):
    refuse(rewrite(saved, **changed), message)


@pytest.mark.parametrize(
    "description, message",
    [
        ("{", "its description is not one of mi_enhance"),
        ("[]", "its description is not one of mi_enhance"),
        ("{}", "its description is not one of mi_enhance"),
        ("[" * 200_000, "its description is not one of mi_enhance"),
        ({"kind": "something else"}, 'its description says kind "something else"; "mi_enhance material" is needed'),
        ({"format": 6}, r"format 6 is newer than this package reads \(5\)\. Upgrade mi_enhance"),
        ({"format": "1"}, "its description says"),
        ({"model": "phong"}, 'cannot be understood: .*unknown model "phong"'),
        ({"model": ["ggx"]}, "cannot be understood"),
        ({"replace": {"X": [4]}}, 'cannot be understood: .*"X" is not a slot'),
        ({"replace": ["X"], "hidden": [4]}, 'cannot be understood: .*"X" is not a slot'),
        ({"terms": {"D": "D_phong"}}, 'cannot be understood: .*unknown term "D_phong"'),
        ({"terms": {"F*G": "D_ggx"}}, "cannot be understood: .*is an operator"),
        ({"terms": 5}, "cannot be understood"),
        ({"replace": 5}, "cannot be understood"),
        (
            {"replace": {"G": [10**9]}},
            r"module of G: hidden layers \[1000000000\] are out of range: 1 to 8 layers of 1",
        ),
        ({"replace": {"G": [1024] * 100_000}}, "hidden layers .* are out of range"),
        ({"replace": {"G": [-1]}}, "hidden layers .* are out of range"),
        ({"replace": {"G": []}}, "hidden layers .* are out of range"),
        ({"replace": {"G": "16"}}, "out of|should have shape"),
        ({"replace": {"G": None}}, "cannot be understood"),
        ({"n_latent": 10**9}, "n_latent 1000000000 out of"),
        ({"n_latent": 2.5}, "cannot be understood"),
        ({"inputs": "angles"}, 'inputs="angles" is unknown'),
        ({"report": 5}, "report must be"),
        ({"lobe_albedo": None}, "lobe_albedo must be a number of at least 0; got None"),
        ({"lobe_albedo": -1}, "lobe_albedo must be a number of at least 0; got -1"),
        ({"lobe_albedo": float("nan")}, "lobe_albedo must be a number of at least 0; got nan"),
        ({"lobe_albedo": 10**400}, "lobe_albedo must be a number of at least 0"),
    ],
    ids=lambda v: str(v)[:30],
)
def test_hostile_description_is_refused(saved, description, message):
    refuse(rewrite(saved, description), message)


def test_description_without_an_entry_is_refused(saved):
    text = json.loads(fields(saved)["description"].tobytes())
    for key in ("kind", "format", "model", "replace", "n_latent", "inputs", "lobe_albedo"):
        refuse(rewrite(saved, json.dumps({k: v for k, v in text.items() if k != key})), "description|lobe_albedo")


def test_weights_of_another_network_are_refused(llvm):
    d = random_material().to_dict()
    with pytest.raises(ValueError, match=r'bsdf "enhanced": 3 weights given, \d+ expected for M \+ S'):
        Material.from_arrays(d["description"], d["params"], mi.Float(1, 2, 3))


def test_flipped_bytes_never_do_more_than_refuse(saved, tmp_path):
    """A flipped weight may load; anything else must be a sentence that names the file."""
    content, rng, path = saved.read_bytes(), np.random.default_rng(0), tmp_path / "flipped.bsdf"
    header = 1000 + content.index(b'{"kind"')  # the fields and most of the description
    loaded = 0
    for k in range(600):
        damaged = bytearray(content)
        for _ in range(rng.integers(1, 4)):
            damaged[rng.integers(len(content) if k % 3 == 0 else min(header, len(content)))] = rng.integers(256)
        path.write_bytes(damaged)
        try:
            material = Material.load(path)
        except ValueError as error:
            assert str(error).startswith(f'Material.load("{path}"): ')
        else:
            loaded += 1
            material.show()
    assert 0 < loaded < 600


def test_empty_dimension_beside_a_huge_one_is_refused(saved):
    """0 * 2**63 bytes fit into any file."""
    content = saved.read_bytes()
    name = b"F.layers.0.weights"
    place = content.index(name) + len(name) + 2 + 1 + 8
    saved.write_bytes(content[:place] + struct.pack("<QQ", 0, 1 << 63) + content[place + 16 :])
    refuse(saved, "F.layers.0.weights")


# ---------------------------------------------------------------------- writing


def test_failing_write_leaves_the_old_file(saved, monkeypatch):
    old = saved.read_bytes()

    def fail(path, tensors):
        with open(path, "wb") as file:
            file.write(b"half a file")
        raise OSError("disk full")

    monkeypatch.setattr(tensor_file, "write", fail)
    with pytest.raises(OSError, match="disk full"):
        random_material().edit(rho_d=0.9).save(saved)
    assert saved.read_bytes() == old
    assert [p.name for p in saved.parent.iterdir()] == [saved.name]


def test_saving_replaces_the_old_file_and_leaves_nothing_else(saved):
    random_material().edit(rho_d=0.5).save(saved)
    assert Material.load(saved).params["rho_d"].tolist() == [0.5] * 3
    assert [p.name for p in saved.parent.iterdir()] == [saved.name]


def test_loaded_material_evaluates_to_the_bit(saved):
    old, new = random_material(), Material.load(saved)
    wi, wo = twin.pairs(100, seed=1)
    p = {k: v[None] for k, v in old.params.items()}
    assert np.array_equal(lanes.evaluate(old.brdf, wi, wo, p), lanes.evaluate(new.brdf, wi, wo, p))


# --- evaluate ---------------------------------------------------------------------------------------------------------


def test_evaluation_does_not_depend_on_how_networks_are_evaluated(llvm):
    """Weights as data, as here, or as constants, as in the plugin: up to rounding."""
    m = random_material()
    wi, wo = twin.pairs(200)
    params = m.as_drjit()
    baked = np.array(m.brdf(lanes.vectors(wi), lanes.vectors(wo), params)).T
    np.testing.assert_allclose(m.evaluate(wi, wo), baked, rtol=1e-4)


UP = [[0.0, 0.0, 1.0]]


@pytest.mark.parametrize(
    "wi, wo, message",
    [
        (UP * 3, UP * 5, r"wi and wo have shapes \(3, 3\) and \(5, 3\); both must be \(N, 3\)"),
        (UP[0], UP[0], r"shapes \(3,\) and \(3,\)"),
        ([[0.0, 1.0]], [[0.0, 1.0]], r"shapes \(1, 2\) and \(1, 2\)"),
        (np.zeros((0, 3)), np.zeros((0, 3)), r"shapes \(0, 3\)"),
        (UP * 2, [UP[0], [0, 0, 2.0]], r"wo\[1\] is \[0.0, 0.0, 2.0\]; it must have length 1. 1 of 2 directions"),
        ([[0.0, np.nan, 1.0]], UP, r"wi\[0\] is \[0.0, nan, 1.0\]; it must have length 1"),
        (UP, [[np.inf, 0.0, 0.0]], r"wo\[0\] is \[inf, 0.0, 0.0\]"),
    ],
)
def test_directions_that_are_none_are_refused(llvm, wi, wo, message):
    with pytest.raises(ValueError, match=message):
        Material.analytic("ggx").evaluate(wi, wo)
