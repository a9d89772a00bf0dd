"""The kinds of files a material can be written as: each registers itself in the file it stands in.

A new kind is one new file in this folder::

    @exporter(".mine", about="Mine: what opens it")
    def write(material, path, *, samples: int = 100) -> dict: ...

All modules of the folder are imported when an exporter is first looked for, not when the package is. So one imports
what is heavy or optional inside of its functions.
"""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..system import tensor_file
from ..system.files import require_file
from ..system.messages import did_you_mean, shortened
from ..system.modules import import_all
from ..system.progress import Callback, silent

if TYPE_CHECKING:
    from ..material.material import Material


@dataclass(frozen=True)
class Exporter:
    """The function that writes one kind of file.

    Parameters
    ----------
    suffix : str
        How its files end, in lower case.
    about : str
        What it is and who reads it, for the help.
    write : callable
        ``write(source, path, *, ...) -> dict``. It returns what is worth saying about the file, JSON types only. Its
        keyword-only arguments, but for `progress`, are the options a user may give; each has a default of its type.
    measured : bool
        True if the source may also be the path of a measured file, of any kind that :func:`mi_enhance.data.load` reads.
    """

    suffix: str
    about: str
    write: Callable[..., dict[str, Any]]
    measured: bool = False

    @property
    def options(self) -> dict[str, Any]:
        """The options and their defaults."""
        arguments = inspect.signature(self.write).parameters.values()
        return {a.name: a.default for a in arguments if a.kind is a.KEYWORD_ONLY and a.name != "progress"}

    @property
    def takes_progress(self) -> bool:
        """True if it reports its progress."""
        return "progress" in inspect.signature(self.write).parameters


_exporters: dict[str, Exporter] = {}


def exporter(suffix: str, *, about: str, measured: bool = False) -> Callable:
    """Register the decorated function as the writer of files with a suffix; the arguments are those of `Exporter`.

    Examples
    --------
    >>> ".glsl" in exporters()
    True
    """

    def register(write: Callable[..., dict[str, Any]]) -> Callable[..., dict[str, Any]]:
        _exporters[suffix] = Exporter(suffix, about, write, measured)
        return write

    return register


def exporters() -> Mapping[str, Exporter]:
    """Return all exporters by their suffix, in alphabetical order."""
    _import_all()
    return dict(sorted(_exporters.items()))


def read_source(path: str | Path) -> Material | Path:
    """Read a material; of a measured file return the path.

    Raises
    ------
    FileNotFoundError, ValueError
        If there is no such file, or it is a damaged material.

    Examples
    --------
    >>> read_source("mi_enhance/bundled/rgl/chm_mint_rgb.bsdf").name
    'chm_mint_rgb.bsdf'
    """
    from ..material.material import Material

    where = f'export("{path}")'
    file = require_file(path, where)
    if file.suffix.lower() != ".bsdf":
        return file
    fields = tensor_file.fields(file, where)
    return file if {"rgb", "spectra", "theta_i"} & set(fields) else Material.load(file)


def export_material(source: Material | Path, path: str | Path, *, progress: Callback = silent, **options) -> dict:
    """Write a material as a file that other programs read; the suffix says which kind.

    Parameters
    ----------
    source : Material or Path
        The path is one of a measured file, for the kinds that can be made of a measurement as it is.
    path : str or Path
        Replaced as a whole or not at all.
    progress : callable, optional
        See :class:`mi_enhance.system.progress.Progress`.
    **options
        What the kind allows; ``exporters()[".glsl"].options`` lists them with their defaults.

    Returns
    -------
    dict
        What is worth saying about the file: its size, its error. JSON types only.

    Raises
    ------
    ValueError
        If the suffix or an option is not known, or this kind cannot be made of a measured file.

    Examples
    --------
    >>> import tempfile
    >>> from mi_enhance import Material
    >>> path = Path(tempfile.mkdtemp()) / "grey.glsl"
    >>> facts = export_material(Material.analytic("ggx"), path)
    >>> facts["multiply_adds"], path.stat().st_size == facts["bytes"]
    (0, True)
    """
    path = Path(path)
    kinds = exporters()
    kind = kinds.get(path.suffix.lower())
    if kind is None:
        raise ValueError(
            f'export: "{path}" must end in {" or ".join(kinds)}.{did_you_mean(path.suffix.lower(), kinds)}'
        )
    if isinstance(source, (str, Path)) and not kind.measured:
        able = [suffix for suffix, k in kinds.items() if k.measured]
        raise ValueError(
            f'export: "{source}" is a measured file, of which only {", ".join(able) or "no file"} can be made. '
            "Fit it first: mi-enhance fit DATA -o material.bsdf"
        )
    given = {name: _option(kind, name, value) for name, value in options.items()}
    return kind.write(source, path, **given, **({"progress": progress} if kind.takes_progress else {}))


def _option(kind: Exporter, name: str, value: Any) -> Any:
    """Return the value of an option, of the type of its default."""
    defaults = kind.options
    if name not in defaults:
        choices = f"Choose from: {', '.join(defaults)}." if defaults else "It has none."
        raise ValueError(f'export: {kind.suffix} has no option "{name}". {choices}{did_you_mean(name, defaults)}')
    wanted = type(defaults[name])
    if wanted is float and type(value) is int:
        value = float(value)
    if defaults[name] is not None and type(value) is not wanted:
        word = {int: "a whole number", float: "a number", bool: "true or false", str: "a text"}.get(wanted, str(wanted))
        raise ValueError(f"export: option {name} of {kind.suffix} is {shortened(value)}; it must be {word}.")
    return value


@functools.cache
def _import_all() -> None:
    import_all(__package__, [str(Path(__file__).parent)])
