"""Paths of the scenes and measured materials that come with the package.

In a checkout (also after ``pip install -e .``) they lie beside ``mi_enhance/``; an installed wheel has them inside.
"""

from __future__ import annotations

from pathlib import Path

_PACKAGE = Path(__file__).resolve().parents[1]


def _find(installed: str, checkout: str, name: str, what: str) -> Path:
    folder = _PACKAGE / installed
    if not folder.is_dir():
        folder = _PACKAGE.parent / checkout
    path = folder / name
    if not path.is_file():
        found = ", ".join(sorted(p.name for p in folder.glob("*") if p.suffix in (".xml", ".bsdf"))) or "none"
        raise FileNotFoundError(
            f'{what}: "{name}" does not come with mi_enhance. Choose one of: {found}. '
            "For a file of your own give its path."
        )
    return path


def scene_file(name: str) -> Path:
    """Return the path of a bundled scene, or of a file that belongs to one.

    Parameters
    ----------
    name : str
        File name relative to ``scenes/``, for example ``"shader_ball.xml"``.

    Raises
    ------
    FileNotFoundError
        If there is no such file; the message lists the scenes.

    Examples
    --------
    >>> from mi_enhance.system.bundled_files import scene_file
    >>> scene_file("shader_ball.xml").name
    'shader_ball.xml'
    """
    return _find("scenes", "scenes", name, "scene_file()")


def demo_data(name: str) -> Path:
    """Return the path of a bundled measured material (RGL Material Database, CC0).

    Parameters
    ----------
    name : str
        File name in ``data/rgl/``, for example ``"satin_rosaline_rgb.bsdf"``.

    Raises
    ------
    FileNotFoundError
        If there is no such file; the message lists the materials.

    Examples
    --------
    >>> from mi_enhance.system.bundled_files import demo_data
    >>> demo_data("satin_rosaline_rgb.bsdf").name
    'satin_rosaline_rgb.bsdf'
    """
    return _find("demo_data", "data/rgl", name, "demo_data()")


DEFAULT_NETWORK = "ggx2"  # the shipped one that is used where none is named


def network_file(name: str) -> Path:
    """Return the path of a trained network that comes with the package.

    Parameters
    ----------
    name : str
        Name of the network, for example ``"ggx"``.

    Raises
    ------
    FileNotFoundError
        If there is no such network; the message lists those there are.
    """
    return _find("networks", "mi_enhance/networks", f"{name}.bsdf", "network_file()")
