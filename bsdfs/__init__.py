"""The Mitsuba plugins of mi_enhance, installed as ``mi_enhance.bsdfs``.

A plugin written in Python is registered for one variant, and its class is only valid in the variant that was active
when it was created. So the files that subclass Mitsuba are loaded anew whenever the variant changes, as Mitsuba does
with its own Python integrators.
"""

from __future__ import annotations

import importlib
import sys

import mitsuba as mi

# Files with classes of the variant, in the order in which they need one another.
_FILES = tuple(f"mi_enhance.bsdfs.{name}" for name in ("map_textures", "scene_parameters", "enhanced", "photographs"))


def register(old: str | None = None, new: str | None = None) -> None:
    """Make ``{"type": "enhanced"}``, and the plugins of photographs, known to the variant that is active.

    ``import mi_enhance`` calls it and has Mitsuba call it after every change of variant, so nobody else needs to.
    It never raises, because Mitsuba calls it from within ``mi.set_variant()``: what is wrong is said when a scene asks
    for the plugin.

    Parameters
    ----------
    old, new : str, optional
        What Mitsuba passes to such callbacks; not needed.
    """
    variant = mi.variant()
    if variant is None:
        return
    if variant.startswith("scalar"):
        _register_error(
            f'mi_enhance: variant "{variant}" cannot run the networks of "enhanced". '
            'Call mi.set_variant("llvm_ad_rgb") first.'
        )
        return
    try:
        *_, plugin, photographs = (
            importlib.reload(sys.modules[name]) if name in sys.modules else importlib.import_module(name)
            for name in _FILES
        )
    except Exception as error:
        _register_error(f'mi_enhance: "enhanced" could not be loaded in variant "{variant}": {error!r}', error)
        return
    mi.register_bsdf("enhanced", lambda props: plugin.Enhanced(props))
    mi.register_sensor("mi_enhance_pixels", lambda props: photographs.PixelCamera(props))
    mi.register_emitter("mi_enhance_lights", lambda props: photographs.PhotographLights(props))


def _register_error(message: str, cause: Exception | None = None) -> None:
    """Register a plugin that only tells why it cannot be had."""

    def refuse(props: mi.Properties):
        raise RuntimeError(message) from cause

    mi.register_bsdf("enhanced", refuse)
