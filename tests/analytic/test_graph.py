"""The graph as plain Python: slots, order, printing, replacing. No optics, no Dr.Jit."""

from __future__ import annotations

import pytest
import twin

from mi_enhance import enhance, models
from mi_enhance.analytic.graph import Node

RECORD = {"a": 2.0, "b": 3.0, "c": 5.0}


def abc():
    a, b, c = (Node(n.upper(), f) for n, f in [("a", lambda a: a), ("b", lambda b: b), ("c", lambda c: c)])
    return a + b * c


def test_ggx_has_eleven_slots_in_reading_order():
    assert models.ggx().graph.slots == twin.SLOTS


def test_ggx_associates_to_the_right():
    """D stays outside of every operator module, and everything right of S is one operand."""
    node, order = models.ggx().graph, []
    while node.args:
        left, node = node.args
        assert not left.args
        order.append(left.name)
    assert [*order, node.name] == ["M", "S", "D", "F", "G", "1/E"]


@pytest.mark.parametrize(
    "replace, text",
    [
        ([], "M + S * D * F * G * 1/E"),
        (["1/E"], "M + S * D * F * G * [1/E]"),
        (["F", "F*G", "G", "1/E"], "M + S * D * [F] [*] [G] * [1/E]"),
        (["M+S", "S*D"], "M [+] S [*] D * F * G * 1/E"),
        (list(twin.SLOTS), "[M] [+] [S] [*] [D] [*] [F] [*] [G] [*] [1/E]"),
    ],
    ids=lambda v: v if isinstance(v, str) else f"{len(v)} replaced",
)
def test_graph_prints_as_its_equation(replace, text):
    assert str(models.ggx().graph.replace(dict.fromkeys(replace))) == text
    assert str(enhance("ggx", replace)) == text


def test_operators_are_named_after_their_neighbours():
    """A product joins the factors beside it, a sum the first factors of its summands."""
    a, b, c = (Node(n, lambda: 1.0) for n in "ABC")
    assert ((a * b) * c).slots == ("A", "A*B", "B", "B*C", "C")
    assert ((a * b) + c).slots == ("A", "A*B", "B", "A+C", "C")


def test_evaluation_is_the_formula():
    assert abc()(RECORD) == 2 + 3 * 5


@pytest.mark.parametrize("name", ["A", "B", "C"])
def test_replacing_a_term_touches_only_that_term(name):
    values = {"A": 2.0, "B": 3.0, "C": 5.0, name: 11.0}
    old = abc()
    new = old.replace({name: lambda record: 11.0})
    assert new(RECORD) == values["A"] + values["B"] * values["C"]
    assert [n.name for n in new.walk() if n.replaced] == [name]
    assert old(RECORD) == 17 and not any(n.replaced for n in old.walk())


def test_replaced_operator_gets_its_operands():
    g = abc().replace({"B*C": lambda b, c: 100 * b + c})
    assert g(RECORD) == 2 + 305


def test_replaced_term_gets_the_whole_record_and_keeps_its_inputs():
    g = abc().replace({"B": lambda record: record["a"]})
    assert g(RECORD) == 2 + 2 * 5
    assert g.find("B").inputs == ("b",)


def test_unknown_slot_is_refused_with_the_slots():
    with pytest.raises(
        KeyError, match=r'"G\*F" is not a slot of M \+ S .*Slots: M, M\+S, S, S\*D, D, D\*F, F, F\*G, G'
    ):
        models.ggx().graph.replace({"G*F": None})
    with pytest.raises(KeyError, match='"X" is not a slot'):
        enhance("ggx", ["F", "X"])


def test_unknown_model_is_refused_with_the_models():
    with pytest.raises(KeyError, match='unknown model "ggxx".*Choose one of: .*ggx.*Did you mean "ggx"'):
        models.get("ggxx")


def test_state_has_eleven_digits_and_eleven_neighbours():
    """Twelve candidates at Hamming distance at most 1 (paper, section 4.1)."""
    state = {"F", "G"}
    candidates = {enhance("ggx", state).state}
    for slot in models.ggx().graph.slots:
        candidates.add(enhance("ggx", state ^ {slot}, hidden=(2,)).state)
    centre = tuple(int(s in state) for s in twin.SLOTS)
    assert len(candidates) == 12 and centre in candidates
    assert {sum(a != b for a, b in zip(c, centre, strict=True)) for c in candidates} == {0, 1}
