"""The measured file that models are held against."""

from __future__ import annotations

from pathlib import Path

from ..data.loading import kind_of
from ..data.rgl import is_renderable
from ..system.files import require_file


def rendered_truth(path: str | Path, where: str) -> dict | None:
    """Return the BSDF of a measured file, or None: Mitsuba renders RGL files in RGB as they are, no other kind.

    Parameters
    ----------
    path : str or Path
    where : str
        Who asks, for the message.

    Returns
    -------
    dict or None
        For ``mi.load_dict``.

    Raises
    ------
    ValueError, FileNotFoundError
        If no reader knows the file, or it is not there.

    Examples
    --------
    >>> rendered_truth("mi_enhance/bundled/rgl/aurora_white_rgb.bsdf", "compare()")["type"]
    'measured'
    >>> rendered_truth("mi_enhance/bundled/nps/merl.npz", "compare()")
    """
    file = require_file(path, f'{where}: "{path}"')
    rendered = kind_of(file) == "rgl" and is_renderable(file)
    return {"type": "measured", "filename": str(file)} if rendered else None
