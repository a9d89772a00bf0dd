"""Load a scene file of this package with any BSDF in the place of its material: one description for all models.

The scenes in ``scenes/`` name an enhanced material by its file. To render the ground truth or another model in the very
same scene, the parsed XML gets a ready BSDF instead of the node with ``id="material"``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import mitsuba as mi

from ..system.bundled_files import scene_file
from ..system.checks import positive_int
from ..system.variants import require_variant


def load(
    scene: str | Path, bsdf: dict | mi.BSDF, *, resolution: int = 256, spp: int = 64, max_depth: int = 6
) -> mi.Scene:
    """Load a scene and put `bsdf` in the place of its material.

    Parameters
    ----------
    scene : str or Path
        A bundled scene (``"shader_ball"``, ``"sphere_envmap"``) or the path of an ``.xml`` file with a BSDF of
        ``id="material"`` and the parameters below; its parameter ``$material``, if any, stays unused.
    bsdf : dict or mi.BSDF
        What to render with, a dictionary for ``mi.load_dict`` or a ready instance.
    resolution, spp, max_depth : int
        Width and height in pixels, samples per pixel, longest path (1: only emitters are seen).

    Returns
    -------
    mi.Scene

    Raises
    ------
    RuntimeError
        If no variant is active.
    FileNotFoundError
        If there is no such scene.
    ValueError
        If a number is not a positive integer, or the scene has no BSDF with ``id="material"``.

    Examples
    --------
    >>> mi.set_variant("llvm_ad_rgb")
    >>> ball = load("sphere_envmap", {"type": "roughconductor", "alpha": 0.2}, resolution=16, spp=4)
    >>> mi.render(ball).shape
    (16, 16, 3)
    """
    where = f'scenes.load("{scene}")'
    require_variant(where)
    given = {"resolution": resolution, "spp": spp, "max_depth": max_depth}
    numbers = {name: positive_int(value, name, where) for name, value in given.items()}
    path = _path(scene, where)
    bsdf = mi.load_dict(bsdf) if isinstance(bsdf, dict) else bsdf

    config = mi.parser.ParserConfig(mi.variant() or "")
    config.unused_parameters = mi.LogLevel.Debug  # a scene of one's own need not have $material
    # Merging shapes would order the emitters by chance at each load, and with them the noise of a given seed.
    config.merge_meshes = config.merge_equivalent = False
    state = mi.parser.parse_file(config, str(path), material="", **{k: str(v) for k, v in numbers.items()})
    if "material" not in state.id_to_index:
        raise ValueError(f'{where}: no object has id="material". Give that id to the BSDF that is to be replaced.')
    # References are resolved first: then every use of the material is an index, however the XML wrote it.
    mi.parser.transform_all(config, state)
    index = state.id_to_index["material"]
    for node in state.nodes:
        for key, value in list(node.props.items()):
            if isinstance(value, mi.Properties.ResolvedReference) and value.index() == index:
                node.props[key] = bsdf

    # Mitsuba's own load_file also looks for meshes and textures beside the scene, and only while loading.
    mitsuba: Any = mi  # its stubs do not type these functions
    before = mitsuba.file_resolver()
    resolver = mi.FileResolver(before)
    resolver.prepend(str(path.parent))
    mitsuba.set_file_resolver(resolver)
    try:
        return mitsuba.parser.instantiate(config, state)
    finally:
        mitsuba.set_file_resolver(before)


def shader_ball(bsdf: dict | mi.BSDF, *, resolution: int = 256, spp: int = 64) -> mi.Scene:
    """Load the Standard Shader Ball with `bsdf` on it: short for ``load("shader_ball", ...)``.

    Examples
    --------
    >>> shader_ball({"type": "diffuse"}, resolution=32).sensors()[0].film().size()[0]
    32
    """
    return load("shader_ball", bsdf, resolution=resolution, spp=spp)


def spheres(bsdfs: Sequence[dict | mi.BSDF], *, resolution: int = 256, spp: int = 64, max_depth: int = 6) -> mi.Scene:
    """Load a scene of spheres side by side in the room of ``"sphere_envmap"``, each with a material of its own.

    Parameters
    ----------
    bsdfs : list of dict or mi.BSDF
        One for each sphere.
    resolution, spp, max_depth : int
        As for :func:`load`.

    Returns
    -------
    mi.Scene

    Examples
    --------
    >>> two = spheres([{"type": "diffuse"}, {"type": "roughconductor"}], resolution=16, spp=4)
    >>> len(two.shapes())
    3
    """
    columns = math.ceil(math.sqrt(len(bsdfs)))
    rows = math.ceil(len(bsdfs) / columns)
    transform = mi.ScalarTransform4f
    balls = {
        f"ball_{k}": {
            "type": "sphere",
            "center": [2.3 * (k % columns - (columns - 1) / 2), 1, -2.3 * (k // columns)],
            "bsdf": bsdf,
        }
        for k, bsdf in enumerate(bsdfs)
    }
    middle = [0, 0.6, -2.3 * (rows - 1) / 2]
    return mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "path", "max_depth": max_depth},
            "sensor": {
                "type": "perspective",
                "fov": 40,
                "to_world": transform().look_at(
                    origin=[0, 2.4 + 1.8 * rows, 2.5 + 2.2 * columns], target=middle, up=[0, 1, 0]
                ),
                "sampler": {"type": "independent", "sample_count": spp},
                "film": {"type": "hdrfilm", "width": resolution, "height": resolution, "rfilter": {"type": "box"}},
            },
            "ground": {
                "type": "disk",
                "to_world": transform().translate([0, 0, middle[2]]).rotate([1, 0, 0], -90).scale(8 + 3 * columns),
                "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.3}},
            },
            "light": {"type": "envmap", "filename": str(scene_file("envmaps/apartment.exr"))},
            **balls,
        }
    )


def _path(scene: str | Path, where: str) -> Path:
    if Path(scene).suffix != ".xml":
        return scene_file(f"{scene}.xml")
    if not Path(scene).is_file():
        raise FileNotFoundError(
            f"{where}: no such file. Give a path, or a bundled scene by name: shader_ball, sphere_envmap."
        )
    return Path(scene).resolve()
