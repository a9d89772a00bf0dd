"""Read-outs of low rank: a few numbers for each slot of a trunk, times a matrix that all materials share.

A free read-out is hundreds of numbers, for one material with many samples. Texels, textures and photographs say less:
there a material has a code, and its read-out is that code times the basis of the network.
"""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..analytic.parameters import MAX_LOG
from ..neural.enhanced_brdf import EnhancedBRDF
from ..neural.mlp import MLP

if TYPE_CHECKING:
    from .material import Material


class LowRank(NamedTuple):
    """What a network with free read-outs carries along for those of low rank.

    Parameters
    ----------
    basis : MLP
        See :class:`mi_enhance.neural.trunk.Trunk`.
    library : array (M, P)
        Parameters of training materials, with codes.
    """

    basis: MLP
    library: np.ndarray


def with_basis(brdf: EnhancedBRDF, basis: MLP | None) -> EnhancedBRDF:
    """Return a BRDF whose materials have codes for this basis; None: read-outs of their own."""
    assert brdf.trunk is not None
    return dataclasses.replace(brdf, trunk=dataclasses.replace(brdf.trunk, basis=basis))


def refuse_free(material: Material, where: str) -> None:
    """Raise unless a texel or photographs determine the numbers of a material.

    Examples
    --------
    >>> from mi_enhance import Material
    >>> refuse_free(Material.analytic("ggx"), "example")
    """
    if material.brdf.trunk and material.brdf.has_free_read_out and not material.brdf.distilled:
        raise ValueError(
            f"{where}: this material has {material.brdf.trunk.size} numbers of its own, more than a texel or "
            'photographs determine. Start from a network with few: Material.pretrained("ggx2_rgb", low_rank=True).'
        )


def of_low_rank(material: Material, where: str) -> Material:
    """Return a network in the form whose few numbers a texel or photographs determine.

    Parameters
    ----------
    material : Material
        A network as it comes with the package; one without a trunk, or of low rank, is returned as it is.
    where : str
        For the error message.

    Raises
    ------
    ValueError
        If it has free read-outs and no basis: a fitted material, or a network trained without one.
    """
    if not material.brdf.has_free_read_out:
        return material
    if material.low_rank is None:
        refuse_free(material, where)
        return material
    basis, library = material.low_rank
    analytic = {p.name: material.params[p.name] for p in material.brdf.model.parameters}
    brdf = with_basis(material.brdf, basis)
    return dataclasses.replace(material, brdf=brdf, params=analytic, library=library, low_rank=None)


def of_free(material: Material) -> Material:
    """Return the same material with a read-out of its own in place of a code; one without a code as it is.

    The library, of materials with codes, stays behind.
    """
    trunk = material.brdf.trunk
    if not trunk or not trunk.basis:
        return material
    brdf = with_basis(material.brdf, None)
    exact = _freed(material.exact_params, material.brdf) if material.exact_params else None
    return dataclasses.replace(
        material, brdf=brdf, params=_freed(material.params, material.brdf), exact_params=exact, library=None
    )


def _freed(params: dict, brdf: EnhancedBRDF) -> dict:
    """Return the parameters with a read-out in place of code and norms."""
    trunk = brdf.trunk
    assert trunk is not None
    matrix = trunk.matrix(trunk.read_outs(params["code"]))  # a view
    matrix[:, -1] += np.concatenate([params[f"norm_{slot}"] for slot in trunk.slots])
    kept = {name: v for name, v in params.items() if name != "code" and not name.startswith("norm_")}
    return {**kept, "read_out": np.clip(matrix.ravel(), -MAX_LOG, MAX_LOG)}
