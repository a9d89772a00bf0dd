"""Visibility of the unknowns of a fit in its photographs: the pixels that change when an unknown does."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from .descent import Descent
from .scene_materials import SceneMaterial
from .targets import Target
from .unknowns import Unknown

# Renders with random numbers of their own whose mean is compared: 64 paths a pixel, so that one that meets the object
# by chance, in a picture that does not show it, is a percent at most.
_RENDERS, _SPP = 4, 16
_SEEN = 0.02  # least change of a pixel, of its logarithm: less is a path by chance
_CAUSES = (
    "Likely causes: poses in another convention (OpenCV and COLMAP look along +z; needed is OpenGL's, along -z with +y "
    "up), poses in another world than the scene (applied_transform of nerfstudio, other units), normals that point "
    "inwards, a light behind what they show, a mask that leaves the object out, or parameters without effect (a "
    "roughness where rho_s is 0)."
)


def warnings_of(
    descent: Descent,
    placed: Mapping[str, SceneMaterial],
    targets: Sequence[Target],
    names: Sequence[str],
    seed: int,
) -> list[str]:
    """Check that photographs see what is sought.

    Parameters
    ----------
    descent : Descent
        At its start.
    placed : dict of str to SceneMaterial
    targets : sequence of Target
        Some pixels of each view to fit.
    names : sequence of str
        Of the views, by number.
    seed : int

    Returns
    -------
    list of str
        A sentence for views that see nothing, and one for each material that no view sees.

    Raises
    ------
    ValueError
        If no pixel of any view depends on any unknown.
    """
    groups = {name: [u for u in descent.unknowns if u.key in one.keys.values()] for name, one in placed.items()}
    known = {u.key for group in groups.values() for u in group}
    groups["the other unknowns"] = [u for u in descent.unknowns if u.key not in known]
    changes = {name: changes_of(descent, group, targets, seed) for name, group in groups.items() if group}
    numbers = np.unique(np.concatenate([target.numbers.ravel() for target in targets]))
    views = [names[k] for k in numbers]
    sees = np.max(list(changes.values()), axis=0) > _SEEN
    if not sees.any():
        raise ValueError(
            f"fit_images(): no pixel that counts in any of {len(views)} views changes when the unknowns do: the "
            f"photographs do not see {' and '.join(changes)}. {_CAUSES}"
        )
    blind = [name for name, seen in zip(views, sees, strict=True) if not seen]
    result = [
        f'fit_images(): no view sees "{name}", whose parameters stay undetermined.'
        for name, change in changes.items()
        if not (change > _SEEN).any()
    ]
    if blind:
        some = f"{', '.join(blind[:5])}{', ...' if len(blind) > 5 else ''}"
        result.append(
            f"fit_images(): {len(blind)} of {len(views)} views see nothing of what is sought: {some}. {_CAUSES}"
        )
    return result


def undetermined(descent: Descent, targets: Sequence[Target], seed: int) -> tuple[list[str], set[int]]:
    """Return the keys of unknowns that no pixel shows when they change by half of their range, and the blind views."""
    seen = np.stack([changes_of(descent, [u], targets, seed) > _SEEN for u in descent.unknowns])
    numbers = np.unique(np.concatenate([target.numbers.ravel() for target in targets]))
    keys = [u.key for u, views in zip(descent.unknowns, seen, strict=True) if not views.any()]
    return keys, {int(k) for k in numbers[~seen.any(0)]}


def changes_of(descent: Descent, unknowns: Sequence[Unknown], targets: Sequence[Target], seed: int) -> np.ndarray:
    """Return for each view the largest change of a pixel's logarithm when unknowns go half of the way to a bound."""
    values = descent.values()
    moved = {u.key: _moved(u, values[u.key]) for u in unknowns}
    numbers = np.unique(np.concatenate([target.numbers.ravel() for target in targets]))
    result = np.zeros(len(numbers))
    for target in targets:
        before, after = (
            np.mean(descent.renders(target, _SPP, range(seed, seed + _RENDERS), instead=v), axis=0) for v in ({}, moved)
        )
        scale = descent.measure.scale
        with np.errstate(invalid="ignore"):  # infinite in both renders: no change that could be seen
            change = np.abs(np.log1p(np.maximum(after, 0) / scale) - np.log1p(np.maximum(before, 0) / scale))
        change = np.where((target.weight > 0) & np.isfinite(change), change, 0)
        np.maximum.at(result, np.searchsorted(numbers, target.numbers.ravel()), change.max(-1).ravel())
    return result


def _moved(u: Unknown, value: np.ndarray) -> np.ndarray:
    low, high = u.space.bounds
    free = u.space.to_free(value)
    return u.space.to_physical(free + np.where(free < (low + high) / 2, 0.5, -0.5) * (high - low))
