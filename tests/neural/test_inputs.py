"""The tables of inputs: names, numbers and values of all kinds belong together."""

import mitsuba as mi
import numpy as np
import pytest
from lanes import vectors

from mi_enhance import enhance, models
from mi_enhance.analytic import geometry, parameters
from mi_enhance.neural import inputs, parameter_inputs
from mi_enhance.neural.simplify import simplify


def values(model):
    """Initial values of a model with all that modules bring, one lane."""
    all_parameters = (*model.parameters, parameters.ASYMMETRY, parameters.latent(3))
    vector = parameters.flatten(all_parameters, parameters.initial(all_parameters))
    return parameters.unflatten(all_parameters, [mi.Float(v) for v in vector])


@pytest.mark.parametrize("kind", inputs.INPUTS)
@pytest.mark.parametrize("name", sorted(models.MODELS))
def test_names_and_values_are_as_many(llvm, name, kind):
    model = models.get(name)
    if not set(parameter_inputs.names_of_parameters(model, kind)) <= {p.name for p in model.parameters}:
        with pytest.raises(ValueError, match=f'modules read .* which model "{name}" does not have'):
            enhance(name, ["G"] if "G" in model.graph.slots else ["D"], inputs=kind)
        return
    p = values(model)
    wi, wo = vectors([[0.1, 0.2, 0.97]]), vectors([[-0.5, 0.3, 0.81]])
    record = {**geometry.quantities(wi, wo), **p}
    nodes = list(model.graph.walk())
    for slot, x in inputs.of_directions(record, kind, wi, wo, nodes).items():
        names = inputs.names_of_directions(model, kind, model.graph.find(slot))
        assert len(names) == len(set(names)) == len(x), slot
    assert len(parameter_inputs.of_parameters(p, kind, model)) == parameter_inputs.n_of_parameters(model, kind) + 3


def test_order_of_the_inputs_is_that_of_saved_weights():
    """Files hold weights by place: another order would load them wrong."""
    lobes = ["lobe", "azimuth", "lobe2", "azimuth2"]
    model = models.get("ggx2")
    names = {slot: inputs.names_of_directions(model, "own", model.graph.find(slot)) for slot in model.graph.slots}
    each = ["sum", "product", "log_product", "difference", "log_ratio"]
    assert inputs.NAMES == (
        *("sin2_h", *lobes, "cos_d", "product", "log_product", "sin_d", "difference", "log_ratio"),
        *("even_difference", "even_log_ratio"),
    )  # fmt: skip
    assert names["D2"] == ["sin2_h", "lobe2", "azimuth2"] and names["F2"] == ["cos_d", "sin_d"]
    assert names["1/E"] == names["B"] == each and names["M"] == []
    assert names["G2"] == [*each, "slope_sum2", "slope_product2"]
    # Ashikhmin and Shirley's 1/E sees the difference angle, too
    node = models.get("ashikhmin_shirley").graph.find("1/E")
    assert inputs.names_of_directions(model, "own", node) == ["cos_d", "sin_d", *each]
    assert inputs.names_of_directions(model, "symmetric", node) == [*inputs.NAMES[:3], *inputs.NAMES[5:8]]
    assert parameter_inputs.names_of_parameters(model, "directions") == [
        *("n_x", "n_y", "t_theta", "rho_d", "rho_s", "alpha_x", "alpha_y", "F0")
    ]


@pytest.mark.parametrize("kind", inputs.COLOURLESS)
def test_features_of_asymmetry_are_left_out_where_it_is_0(llvm, kind):
    """Exactly: what is left out is weights times 0."""
    brdf = enhance("ggx2", ("B", "G", "1/E2"), inputs=kind, hidden=(4,), n_latent=2)
    small, left_out = simplify(brdf, {"asymmetry": np.zeros(1)})
    assert "asymmetry" in left_out
    assert all(small.modules[slot].sizes[0] == mlp.sizes[0] - 2 for slot, mlp in brdf.modules.items())
    vector = parameters.flatten(brdf.parameters, parameters.initial(brdf.parameters))
    p = parameters.unflatten(brdf.parameters, [mi.Float(v) for v in vector])
    wi, wo = vectors([[0.1, 0.2, 0.97]]), vectors([[-0.5, 0.3, 0.81]])
    rest = {name: v for name, v in p.items() if name not in left_out}
    assert np.array_equal(np.array(small(wi, wo, rest)), np.array(brdf(wi, wo, p)))


@pytest.mark.parametrize("hidden", [(), (0,), (16, 1025), (4,) * 9, 16, (1.5,)], ids=str)
def test_hidden_sizes_out_of_range_are_refused(hidden):
    with pytest.raises(ValueError, match=r"module of F: hidden layers .* are out of range: 1 to 8 layers of 1 to 1024"):
        enhance("ggx", ("F",), hidden=hidden)
