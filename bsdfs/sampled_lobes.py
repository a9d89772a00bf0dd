"""How the plugin draws directions: the lobes of a material, and the probability of each."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Mapping
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from mi_enhance.bsdfs.compiled_form import Form

from mi_enhance.analytic.models.model import Model
from mi_enhance.material.material import Material
from mi_enhance.sampling import lobe_mixture


@dataclasses.dataclass(eq=False, init=False)  # a dataclass: `dr.freeze` finds the arrays of its fields
class SampledLobes:
    """The mixture by which a material is sampled.

    Parameters
    ----------
    material : Material
    """

    scales: list[mi.Float] | None  # factors on the roughness of the lobes
    albedos: mi.Float
    shares: list[mi.Float] | None  # probabilities of the lobes, where they are the same everywhere

    def __init__(self, material: Material):
        mixture = material.sampled_by
        # Data, so that materials share the compiled function; a material without a mixture of its own has no factors.
        self.scales = [dr.opaque(mi.Float, c) for c in mixture.scales] if material.mixture else None
        self.albedos = mi.Float(np.ravel(mixture.albedos))
        dr.make_opaque(self.albedos)

    def update(self, form: Form, constants: Mapping, textured: Collection[str]) -> None:
        """Take over the parameters as they are now: those that are constant over the surface, and names of others."""
        self._form, self.shares = form, None
        if self.scales is None and not textured:
            params = {name: v for name, v in constants.items() if name not in form.left_out}
            self.shares = lobe_mixture.shares_at(mi.Float(1), params, self.albedos, form.brdf.model)
            dr.make_opaque(self.shares)

    def at(self, si: Any, form: Form, params: Mapping) -> tuple[Model, list[mi.Float]]:
        """Return the model whose lobes are sampled at a hit point, and their probabilities."""
        model = form.brdf.model
        shares = self.shares  # of the last update, unless what they are made of has changed since
        if shares is None or form is not self._form or dr.grad_enabled(params):
            shares = lobe_mixture.shares_at(si.wi.z, params, self.albedos, model)
        if self.scales is not None:
            model = lobe_mixture.scaled(model, list(enumerate(self.scales)))
        return model, shares
