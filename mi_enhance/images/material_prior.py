"""The training materials of a network as a prior of fits to images."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import mitsuba as mi
import numpy as np

from ..analytic.parameter_space import Space
from ..fitting import library_prior
from .scene_materials import SceneMaterial


class MaterialPrior:
    """Gaussians over the training materials, one for each network in a scene.

    They weigh as much as one pixel beside all that are seen: what photographs tell well does not move, what they do
    not tell stays where training materials are.

    Parameters
    ----------
    placed : dict of str to SceneMaterial
        Those without a library, or with maps, have no prior.
    params : mi.SceneParameters
        Of the scene, with the values of what is known.
    free : collection of str
        Keys of what is sought.
    n_pixels : int
        So many pixels tell something of their own.
    """

    def __init__(
        self,
        placed: Mapping[str, SceneMaterial],
        params: mi.SceneParameters,
        free: Collection[str],
        n_pixels: int,
    ):
        self._n_pixels = n_pixels
        self._parts: list[tuple[dict[str, slice], Space, library_prior.Prior, np.ndarray]] = []
        for one in placed.values():
            if one.material.library is None or one.is_textured:
                continue
            known, begin = one.read(params), 0
            place: dict[str, slice] = {}
            for p in known.brdf.parameters:
                if one.keys.get(p.name) in free:
                    place[one.keys[p.name]] = slice(begin, begin + p.size)
                begin += p.size
            prior = library_prior.from_library(one.material, 1.0)
            self._parts.append((place, Space(known.brdf.parameters), prior, known.as_vector()))

    def gradients(self, values: Mapping[str, np.ndarray], loss: float) -> dict[str, np.ndarray]:
        """Return the derivatives of the prior with respect to physical values, by key.

        Parameters
        ----------
        values : dict of str to array
            By key; others are passed over.
        loss : float
            Mean residual of the fit as it is.
        """
        result: dict[str, np.ndarray] = {}
        for place, space, prior, vector in self._parts:
            vector = vector.copy()
            for key, where in place.items():
                vector[where] = values[key]
            free = space.to_free(vector)
            slope = prior.precision @ (free - prior.mean) / space.slope(free) * loss / self._n_pixels
            result |= {key: slope[where] for key, where in place.items()}
        return result

    def precision(self, keys: list[str], index: list[int]) -> np.ndarray:
        """Return the inverse covariance (P, P) of some numbers: the one at `index` of each of `keys`."""
        result = np.zeros((len(keys), len(keys)))
        for place, _, prior, _ in self._parts:
            mine = [k for k, key in enumerate(keys) if key in place]
            at = [place[keys[k]].start + index[k] for k in mine]
            result[np.ix_(mine, mine)] = prior.precision[np.ix_(at, at)]
        return result
