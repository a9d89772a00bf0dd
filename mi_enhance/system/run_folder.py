"""The settings of a long run, kept in its folder: a run is continued only with the settings it began with."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

from .files import read_json, write_text


def keep_settings(file: Path, settings: Mapping, where: str, *, begun: bool = True) -> None:
    """Write the settings of a run, or check them against those of the run that `file` belongs to.

    Parameters
    ----------
    file : Path
        ``settings.json`` of the run. Its folder is made if it is missing.
    settings : mapping
        What decides the result. It must be what JSON can hold.
    where : str
        Who asks, for example ``"train()"``: the error begins so.
    begun : bool
        False if the run has no result yet: settings of an earlier run are then replaced.

    Raises
    ------
    ValueError
        If the run has begun with other settings, or the file is damaged.

    Examples
    --------
    >>> import tempfile
    >>> file = Path(tempfile.mkdtemp()) / "run" / "settings.json"
    >>> keep_settings(file, {"seed": 0}, "train()")
    >>> keep_settings(file, {"seed": 0}, "train()")
    >>> keep_settings(file, {"seed": 1}, "train()")  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    ValueError: train(): "...settings.json" is of a run with other settings (seed). Choose another folder, or ...
    """
    file = Path(file)
    text = json.dumps(settings, indent=2) + "\n"
    if begun and file.exists():
        # compared as JSON has them: a tuple is a list there
        kept, asked = read_json(file, where), json.loads(text)
        if kept != asked:
            raise ValueError(
                f'{where}: "{file}" is of a run with other settings ({_differing(kept, asked)}). '
                "Choose another folder, or start with an empty one."
            )
        return
    file.parent.mkdir(parents=True, exist_ok=True)
    write_text(file, text)


def _differing(kept: object, asked: object) -> str:
    """Return the names of the settings that differ."""
    if not isinstance(kept, dict) or not isinstance(asked, dict):
        return "it holds no settings"
    missing = object()
    return ", ".join(k for k in sorted({*kept, *asked}) if kept.get(k, missing) != asked.get(k, missing))
