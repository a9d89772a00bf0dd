"""Load the scene that a command names, with values for its parameters."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from ..system.files import require_file
from .outputs import is_same

_UNUSED = "unused parameters"  # Mitsuba's words; a line "- $name=value" for each follows


def load_scene(mi: Any, name: str, where: str, define: Iterable[tuple[str, str]], material: Path | None = None) -> Any:
    """Load a scene as Mitsuba does, but leave equal objects apart.

    Two materials that start equal are two materials for a fit: Mitsuba's optimization would make them one.

    Parameters
    ----------
    mi : module
        Mitsuba, with a variant.
    name : str
        Path of the ``.xml``.
    where : str
        Start of error messages.
    define : iterable of (str, str)
        Values of its parameters. The name of a file that exists is meant from where the user stands, not from where
        the scene lies.
    material : Path, optional
        For its parameter ``$material``, if it has one, wherever that is: an included file, a default.

    Returns
    -------
    mi.Scene
    """
    file = require_file(name, where)
    values = given = _values(define)

    def load(**values: str) -> Any:
        try:
            return mi.load_file(str(file), optimize=False, **values)
        except RuntimeError as error:
            unknown = re.findall(r"^\s*- (\$\w+)=", str(error), re.MULTILINE) if _UNUSED in str(error) else []
            if not unknown or "$material" in unknown and "material" not in given:
                raise
            raise ValueError(
                f"{where}: -D: neither the scene nor what it includes has {', '.join(sorted(unknown))}."
            ) from None

    if material is None or "material" in values:
        scene = load(**values)
    else:
        try:
            scene = load(**values, material=str(material))
        except RuntimeError as error:  # Mitsuba reads the whole scene before it says that a parameter is not used
            if _UNUSED not in str(error) or "- $material=" not in str(error):
                raise
            scene = load(**values)
    if not isinstance(scene, mi.Scene):
        raise ValueError(f"{where}: this is no scene. Its outermost element must be <scene>.")
    return scene


def _from_here(value: str) -> str:
    try:
        float(value)
    except ValueError:
        path = Path(value)
        # "diffuse" is the type of a BSDF, even where there is a file of that name
        return str(path.absolute()) if (path.suffix or len(path.parts) > 1) and path.is_file() else value
    return value


def refuse_inputs(mi: Any, name: str, define: Iterable[tuple[str, str]], outputs: Iterable[Path]) -> None:
    """Raise if a file to be written is one that a scene reads: an image, a mesh, a material, an included scene.

    Parameters
    ----------
    mi, name, define
        As for :func:`load_scene`.
    outputs : iterable of Path

    Raises
    ------
    ValueError
        If one of them is.
    """
    existing = [path for path in outputs if path.exists()]
    if not existing:
        return
    config = mi.parser.ParserConfig(mi.variant())
    config.unused_parameters = mi.LogLevel.Debug
    state = mi.parser.parse_file(config, str(Path(name).resolve()), **{"material": "", **_values(define)})
    texts = (value for node in state.nodes for _, value in node.props.items() if isinstance(value, str))
    # relative to the scene or, as Mitsuba's own search goes on, to where the user stands
    read = [Path(str(file)) for file in state.files]
    read += [folder / text for text in texts for folder in (Path(name).resolve().parent, Path()) if text]
    for path in existing:
        if any(is_same(path, file) for file in read):
            raise ValueError(f'-o: "{path}" is what the scene reads. Choose another name.')


def _values(define: Iterable[tuple[str, str]]) -> dict[str, str]:
    return {key: _from_here(value) for key, value in define}
