"""Checks of the active Mitsuba variant."""

from __future__ import annotations

import mitsuba as mi


def require_rgb(where: str) -> None:
    """Raise unless a variant is active in which RGB parameters can be optimized."""
    variant = mi.variant() or "none"
    if not variant.endswith("_rgb") or "_ad_" not in variant:
        raise RuntimeError(
            f'{where}: needs an RGB variant with gradients; "{variant}" is active. '
            'Call mi.set_variant("llvm_ad_rgb") first.'
        )
