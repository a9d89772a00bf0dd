"""The recorder: what is equal is one value, what is known is worked out, what is computed alike is one vector."""

from __future__ import annotations

import numpy as np
import pytest

from mi_enhance import Material, terms
from mi_enhance.export.program import record
from mi_enhance.export.recorder import Table, constant, gather, in_order, power
from mi_enhance.export.registry import exporter, exporters
from mi_enhance.export.stand_ins import FUNCTIONS, recording
from mi_enhance.export.statements import Language, Statements, number
from mi_enhance.export.vectorize import Vectorizer
from mi_enhance.export.vectors import Colour, Vector


@pytest.fixture
def recorder(llvm):
    with recording() as active:
        yield active


def texts(outputs, **options):
    body = Statements(Language({}, {"float": "float", "bool": "bool"}, **options), given(outputs), {}, str, ())
    values = [v for v in in_order(outputs) if v.op not in ("input", "constant")]
    return [*body.lines, *body.write(values, outputs)]


def given(outputs):
    return {v.number: v.args[0] for v in in_order(outputs) if v.op == "input"}


def test_equal_operations_are_one_value(recorder):
    x, y = (recorder.input(name, varying=True) for name in "xy")
    assert x * y + 1 is y * x + 1
    assert x - y is not y - x
    assert (x < y) is (y > x)


def test_text_of_a_value_is_short(recorder):
    """`pytest` writes the values of an assertion that fails: their text must not double with each operation."""
    x = value = recorder.input("x", varying=True)
    for _ in range(200):
        value = value * value + 1
    assert repr(x) == "%0 = input('x')"
    assert repr(value - x) == f"%{value.number + 1} = sub(%{value.number}, %0)"
    assert len(repr(gather(Table(range(1000)), x))) < 100


def test_constants_are_worked_out_in_single_precision(recorder):
    third = constant(1) / 3
    assert third.op == "constant"
    assert third.args[0] == np.float32(1) / np.float32(3)
    x = recorder.input("x", varying=True)
    assert x * 1 is x
    assert x + 0 is x
    assert (x * 0).args[0] == 0
    assert FUNCTIONS["select"](constant(True, "bool"), x, 2) is x
    assert FUNCTIONS["select"](x < 2, x, 2.0).op == "min"


def test_constants_of_a_long_sum_are_added_at_once(recorder):
    """Latent numbers that stand behind the parameters in a first layer cost nothing."""
    x, fma = recorder.input("x", varying=False), FUNCTIONS["fma"]
    total = constant(1)
    for w, v in ((2.0, x), (3.0, constant(4)), (5.0, constant(6))):
        total = fma(v, w, total)
    assert texts([total]) == ["43.0 + x * 2.0"]


@pytest.mark.parametrize("exponent, expected", [(0, 1), (1, 3), (5, 243), (-2, 1 / 9), (0.5, 3**0.5)])
def test_powers(recorder, exponent, expected):
    assert power(constant(3), exponent).args[0] == pytest.approx(expected)


def test_parentheses_stand_where_they_are_needed(recorder):
    x, y = (recorder.input(name, varying=True) for name in "xy")
    assert texts([(x + y) * y]) == ["y * (x + y)"]
    assert texts([x - (y - 1)]) == ["x - (y - 1.0)"]
    assert texts([x / (y * y)]) == ["x / (y * y)"]
    assert texts([-(x + y)]) == ["-(x + y)"]
    assert texts([FUNCTIONS["fma"](x, -2.0, y)]) == ["y - x * 2.0"]
    assert texts([FUNCTIONS["select"](x > 0, y, 1)]) == ["x > 0.0 ? y : 1.0"]
    assert texts([FUNCTIONS["clip"](x, 0, 1)]) == ["clamp(x, 0.0, 1.0)"]


def test_vectors_and_colours(recorder):
    x = recorder.input("x", varying=True)
    v = 2 * Vector(x, 1, 0)
    assert [p.op for p in v] == ["mul", "constant", "constant"]
    assert type(Colour(x) * x) is Colour
    assert texts([FUNCTIONS["dot"](v, v)]) == texts([(2 * x) * (2 * x) + 4])


def test_a_number_that_is_not_finite_is_refused():
    with pytest.raises(ValueError, match="a constant of the material is inf; it must be finite"):
        number(float("inf"))


def test_layers_become_matrix_products(recorder):
    rng = np.random.default_rng(0)
    w = rng.normal(size=(5, 3)).astype(np.float32)
    xs = [recorder.input(f"x{k}", varying=True) for k in range(3)]
    rows = []
    for row in w.tolist():
        total = constant(0.5)
        for weight, x in zip(row, xs, strict=True):
            total = FUNCTIONS["fma"](x, weight, total)
        rows.append(FUNCTIONS["select"](total > 0.01 * total, total, 0.01 * total))
    vectorizer = Vectorizer(rows, {"x": xs}, {})
    ops = [v.op for v in in_order([vectorizer.joined(rows)])]
    assert ops.count("linear") == 1
    assert ops.count("max") == 1


def test_terms_outside_of_a_recording_are_dr_jits_again(llvm):
    import mitsuba as mi

    with pytest.raises(ZeroDivisionError), recording():
        raise ZeroDivisionError
    assert terms.F_schlick(mi.Float(0), mi.Float(0.04))[0] == 1


def test_constant_material_leaves_out_what_is_0(llvm):
    grey = record(Material.analytic("ggx2").edit(rho_s=0), editable=False)
    assert grey.parameters == ()
    assert grey.prepared == ()
    assert len(grey.values("eval")) < 8


def test_an_exporter_registers_itself():
    before = dict(exporters())

    @exporter(".test", about="Test: nobody")
    def write(material, path, *, size: int = 3) -> dict:
        return {"size": size}

    try:
        assert exporters()[".test"].options == {"size": 3}
    finally:
        from mi_enhance.export import registry

        del registry._exporters[".test"]
    assert dict(exporters()) == before
