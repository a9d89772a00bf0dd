"""Materials to be written, of every kind there is; and a written Python file as a module. Not a test itself."""

from __future__ import annotations

import dataclasses
import functools
import types

import numpy as np

from mi_enhance import Material, models
from mi_enhance.analytic import parameters
from mi_enhance.export import numpy_file
from mi_enhance.export.program import record
from mi_enhance.neural.distilled_network import DistilledNetwork
from mi_enhance.neural.enhance import with_trunk
from mi_enhance.sampling.lobe_mixture import NODES, Mixture

TEXT = """
name = "blinn_phong"
formula = "M + S * D"
[terms]
M = "rho_d / pi"
S = "rho_s"
D = "(n + 2) / (2 * pi) * cos_theta_h ** n"
[parameters]
rho_d = true
rho_s = true
n = { low = 1, high = 1e5, initial = 100, log = true }
[[lobes]]
rho_s = "rho_s"
alpha_x = "sqrt(2 / (n + 2))"
alpha_y = "sqrt(2 / (n + 2))"
"""


def pretrained(name: str, row: int = 0) -> Material:
    """A shipped network with the parameters of one of the materials it was trained on."""
    material = Material.pretrained(name)
    brdf = material.brdf
    vector = material.library[row] if material.library is not None else material.as_vector()
    return dataclasses.replace(material, params=parameters.unflatten(brdf.parameters, np.asarray(vector, np.float64)))


def specialized() -> Material:
    """A network with a small one in the place of two of its modules, random weights."""
    material, rng = pretrained("ggx2"), np.random.default_rng(0)
    inputs, slots, seen = ("lobe", "cos_d", "log_product", "sin_d"), ("B", "G"), 4
    layers = []
    for n in (8, 8, len(slots)):
        layers.append((rng.normal(0, 0.4, (n, seen)).astype(np.float32), rng.normal(0, 0.1, n).astype(np.float32)))
        seen += n
    network = DistilledNetwork(slots, inputs, tuple(layers))
    return dataclasses.replace(material, brdf=dataclasses.replace(material.brdf, distilled=(network,)))


def trunk() -> Material:
    """A network that several slots share, read out in RGB; random weights."""
    material = Material(with_trunk("ggx2", hidden=(16, 16, 24)), {})
    rng = np.random.default_rng(2)
    size = material.params["read_out"].size
    return material.edit(read_out=rng.normal(0, 0.3, size), latent=rng.uniform(0, 1, 8), rho_s2=(0.3, 0.2, 0.1))


def low_rank() -> Material:
    """A trunk that is read out by codes, of a roughness that was edited."""
    material, rng = Material.pretrained(low_rank=True), np.random.default_rng(4)
    params = {"code": rng.normal(0, 1, 48), "latent": rng.uniform(0, 1, 8), "rho_s2": (0.3, 0.2, 0.1)}
    return material.edit(**params).edit(alpha_x=0.3, alpha_y=0.3)


def of_its_own() -> Material:
    """A small network in RGB that scales two terms, random weights."""
    material, rng = Material.analytic("ggx"), np.random.default_rng(3)
    first = rng.normal(0, 0.5, (6, 3)).astype(np.float32), rng.normal(0, 0.1, 6).astype(np.float32)
    last = rng.normal(0, 0.3, (6, 9)).astype(np.float32), rng.normal(0, 0.1, 6).astype(np.float32)
    network = DistilledNetwork(("M", "F"), ("lobe", "cos_d", "log_product"), (first, last), channels=3)
    return dataclasses.replace(material, brdf=dataclasses.replace(material.brdf, distilled=(network,)))


def mixed() -> Material:
    """A material with a mixture of its own, whose shares depend on the view."""
    albedos = np.random.default_rng(1).uniform(0.05, 1, (3, NODES))
    mixture = Mixture((1.2, 0.9), tuple(tuple(map(float, row)) for row in albedos))
    return dataclasses.replace(pretrained("ggx2_small", 7), mixture=mixture)


KINDS = {
    **{name: functools.partial(Material.analytic, name) for name in models.MODELS},
    "text": lambda: Material.analytic(models.from_expression(TEXT)),
    **{f"net {name}": functools.partial(pretrained, name) for name in ("ggx", "ggx2", "ggx2_small", "paper", "ward")},
    "net cook_torrance": functools.partial(pretrained, "cook_torrance"),
    "specialized": specialized,
    "trunk": trunk,
    "low rank": low_rank,
    "of its own": of_its_own,
    "mixture": mixed,
    "bounded": lambda: Material.analytic("ward").edit(alpha_x=0.1, alpha_y=0.4, rho_s=1).bounded(),
    "edited": lambda: pretrained("ggx2", 3).edit(rho_d=(0.2, 0.1, 0), n_x=0.2, t_theta=1, alpha_x=0.01, F0=0.5),
}


def module(material: Material, *, editable: bool = True) -> types.SimpleNamespace:
    """The functions of the Python file that a material is written as."""
    names: dict = {}
    exec(numpy_file.source(record(material, editable=editable), "it"), names)
    return types.SimpleNamespace(**names)
