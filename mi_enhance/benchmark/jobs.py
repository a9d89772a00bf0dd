"""The jobs that are timed: kernels and frames."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from ..data.directions import sample_pairs
from ..evaluation import scenes
from ..numerics.arrays import vector3f
from .contender import Contender
from .contenders import edited

LANES = 1 << 20  # of the kernel that evaluates a BSDF alone
MANY = 20  # materials in the scene of many


def kernel(contender: Contender) -> Callable:
    """A job that evaluates a BSDF for 2^20 pairs of directions in one kernel, through pointers as a renderer does."""
    bsdf = contender.bsdf()
    wi, wo = (vector3f(w) for w in sample_pairs(LANES, seed=0))
    context = mi.BSDFContext()
    mitsuba: Any = mi  # its stubs do not type BSDFPtr and Mask
    # One of the pointers is to another BSDF: a single instance would be called without the dispatch that a scene has.
    other = mi.load_dict({"type": "diffuse"})
    is_first = dr.arange(mi.UInt32, LANES) < LANES - 1
    pointers: Any = dr.select(is_first, mitsuba.BSDFPtr(bsdf), mitsuba.BSDFPtr(other))
    dr.eval(wi, wo, pointers)

    def job(keep: object = (bsdf, other)) -> None:  # pointers do not own what they point to
        si = dr.zeros(mi.SurfaceInteraction3f, LANES)
        si.wi = wi
        dr.eval(pointers.eval(context, si, wo, mitsuba.Mask(True)))
        dr.sync_thread()

    return job


def frame(load: Callable, *args: Any, frozen: bool = False, **kwargs: Any) -> Callable:
    """A job that renders a frame of the scene that `load` gives; `args` are contenders, one or a list.

    A list is repeated to `MANY`: as many spheres stand in the picture however many materials there are. With `frozen`
    no frame after the second is traced again (``dr.freeze``).
    """
    bsdfs = []
    for a in args:
        made = [c.bsdf() for c in (a if isinstance(a, list) else [a])]
        bsdfs.append([made[k % len(made)] for k in range(MANY)] if isinstance(a, list) else made[0])
    loaded = load(*bsdfs, **kwargs)
    render = dr.freeze(mi.render) if frozen else mi.render
    return lambda: np.array(render(loaded))  # the copy waits for the kernels


def sphere(bsdf: mi.BSDF, **size: int) -> mi.Scene:
    """The small scene, for what grows."""
    return scenes.load("sphere_envmap", bsdf, **size)


def many(fitted: Sequence[Mapping[str, Contender]], label: str, n: int) -> list[Contender]:
    """`n` different materials of one model: the fitted ones in turn, their colours changed."""
    return [edited(fitted[k % len(fitted)][label], k) for k in range(n)]
