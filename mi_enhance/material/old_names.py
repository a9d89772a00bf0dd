"""Methods of `Material` under their names of version 0.1."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING, Any

import numpy as np

from ..system.bundled_files import DEFAULT_NETWORK

if TYPE_CHECKING:
    from .material import Material


class OldNames:
    """Base of `Material`: each name works and warns."""

    @staticmethod
    def network(name: str = DEFAULT_NETWORK) -> Material:
        """Return ``Material.pretrained(name)``."""
        from .material import Material

        _warn("network()", "pretrained()")
        return Material.pretrained(name)

    @property
    def exact(self: Any) -> Material:
        """The same as ``unspecialized``."""
        _warn("exact", "unspecialized")
        return self.unspecialized

    def vector(self: Any) -> np.ndarray:
        """Return ``as_vector()``."""
        _warn("vector()", "as_vector()")
        return self.as_vector()

    def lanes(self: Any) -> dict[str, Any]:
        """Return ``as_drjit()``."""
        _warn("lanes()", "as_drjit()")
        return self.as_drjit()


def _warn(old: str, new: str) -> None:
    text = f"Material.{old} is now Material.{new}; the old name will go in a later version."
    warnings.warn(text, DeprecationWarning, stacklevel=3)
