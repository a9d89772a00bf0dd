"""Models and terms register themselves; the second lobe has names of its own."""

import pytest

from mi_enhance import models
from mi_enhance.analytic import alternative_terms, lobes, parameters
from mi_enhance.analytic.models import registry
from mi_enhance.analytic.terms import registry as terms


def test_a_model_is_found_by_the_name_of_its_function(monkeypatch):
    monkeypatch.setattr(registry, "MODELS", dict(registry.MODELS))

    @registry.model
    def mine():
        return models.ward()

    assert registry.get("mine").name == "ward"
    with pytest.raises(KeyError, match='unknown model "mein".*mine.*models.from_toml.*Did you mean "mine"'):
        registry.get("mein")


def test_a_term_can_stand_in_its_slot_and_brings_its_parameters(monkeypatch):
    monkeypatch.setattr(terms, "ALTERNATIVES", dict(terms.ALTERNATIVES))

    @terms.term("F", parameters=(parameters.IOR,))
    def F_mine(ior):
        return ior

    model = alternative_terms.with_terms(models.get("ggx2"), {"F2": "F_mine"})
    assert "F_mine" in str(model) and model.extra == ("ior2",)
    with pytest.raises(KeyError, match='unknown term "F_min". Choose one of: F_schlick.*F_mine. Did you mean "F_mine"'):
        alternative_terms.with_terms(models.get("ggx2"), {"F2": "F_min"})


def test_lobes_name_their_slots_and_parameters():
    model = models.get("ggx2")
    names = {p.name for p in model.parameters}
    assert lobes.rough(names) == lobes.LOBES and lobes.rough({"F0"}) == ()
    for slot in model.graph.slots:
        assert lobes.of_slot(slot) is (lobes.SECOND if slot[-1] == "2" else lobes.FIRST)
    for lobe in lobes.LOBES:
        assert {lobe.rho_s, lobe.alpha_x, lobe.alpha_y} <= names
