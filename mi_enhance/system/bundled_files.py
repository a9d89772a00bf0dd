"""Paths of the scenes, measured materials and trained networks that come with the package."""

from __future__ import annotations

from pathlib import Path

_PACKAGE = Path(__file__).resolve().parents[1]


def _find(folder: Path, name: str, what: str) -> Path:
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
    installed = _PACKAGE / "scenes"  # in a checkout they lie beside the package
    return _find(installed if installed.is_dir() else _PACKAGE.parent / "scenes", name, "scene_file()")


def demo_data(name: str) -> Path:
    """Return the path of a bundled measured material (RGL Material Database, CC0).

    Parameters
    ----------
    name : str
        File name in ``mi_enhance/bundled/rgl/``, for example ``"satin_rosaline_rgb.bsdf"``.

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
    return _find(_PACKAGE / "bundled/rgl", name, "demo_data()")


# The shipped networks that are used where none is named: for one material, and where hundreds of numbers for each are
# too many (surfaces and photographs).
DEFAULT_NETWORK, SURFACE_NETWORK = "ggx2_rgb", "ggx2"


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
    return _find(_PACKAGE / "networks", f"{name}.bsdf", "network_file()")


def rival_file(name: str) -> Path:
    """Return the path of a network of somebody else's form, trained by us, that comes with the package.

    Parameters
    ----------
    name : str
        File name in ``mi_enhance/bundled/rivals/``, for example ``"hybrid.npz"``.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    """
    return _find(_PACKAGE / "bundled/rivals", name, "rival_file()")


def network_exists(name: str) -> bool:
    """Tell whether a network of that name comes with the package.

    Examples
    --------
    >>> network_exists("ggx"), network_exists("ggx_retro")
    (True, False)
    """
    return (_PACKAGE / "networks" / f"{name}.bsdf").is_file()
