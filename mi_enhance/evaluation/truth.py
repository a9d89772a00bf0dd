"""The measured file that renders are held against."""

from __future__ import annotations

from pathlib import Path

from ..system.files import require_file


def rgl_file(path: str | Path, where: str) -> Path:
    """Return the path of an RGL ``.bsdf`` file, the one kind of measurement that Mitsuba can render as it is.

    Parameters
    ----------
    path : str or Path
    where : str
        Who asks, for the message.

    Raises
    ------
    ValueError, FileNotFoundError
        If the file is of another kind, or is not there.

    Examples
    --------
    >>> rgl_file("mi_enhance/bundled/nps/merl.npz", "compare()")
    Traceback (most recent call last):
    ValueError: compare(): "mi_enhance/bundled/nps/merl.npz" cannot be rendered as the ground truth: Mitsuba's "measured" reads RGL .bsdf files only. Give one; `mi-enhance fit` reads every kind and states the log-L1.
    """  # noqa: E501
    file = require_file(path, f'{where}: "{path}"')
    if file.suffix.lower() != ".bsdf":
        raise ValueError(
            f'{where}: "{path}" cannot be rendered as the ground truth: Mitsuba\'s "measured" reads RGL .bsdf files '
            "only. Give one; `mi-enhance fit` reads every kind and states the log-L1."
        )
    return file
